"""What accuracy costs in rigid flight, from tables of several sources and tolerances. `snakemake accuracy_rigid` asks for it."""

LEVELS = ("3e-3", "1e-2")  # beside the tables that the scenes fly on
CELLS = ("mark1e_te", "mark1e_tm")


def sets(wildcards):
    """Files of both cells' tables by the name of their source: FDTD's and the published ones where they are at hand."""
    found = {f"modal {plan.config.modal.tolerance:g}": [plan.table(cell, "modal") for cell in CELLS]}
    found |= {f"modal {level}": [f"results/accuracy/{cell}_{level}.h5" for cell in CELLS] for level in LEVELS}
    fdtd = [f"results/tables/{cell}/fdtd.h5" for cell in CELLS]
    if all(map(os.path.exists, fdtd)):
        found["FDTD"] = fdtd
    if os.path.exists(REFERENCE):  # of published.smk
        found["published"] = [f"results/tables/published/{cell}.h5" for cell in CELLS]
    return found


rule accuracy_table:
    input:
        cell="workflow/designs/{design}.yaml",
    output:
        "results/accuracy/{design}_{level}.h5",
    log:
        "results/logs/accuracy/{design}_{level}.log",
    benchmark:
        "results/benchmarks/accuracy/{design}_{level}.tsv"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        u_max=plan.config.modal.u_max,
        v_max=plan.config.modal.v_max,
    message:
        "Modal table of {wildcards.design} to {wildcards.level}"
    shell:
        keys.shared(
            "python -m optics.modal --accept-missed --cell {input.cell} --u-max {params.u_max} --v-max {params.v_max}"
            " --tolerance {wildcards.level} --out {output} > {log} 2>&1"
        )


# FDTD tables count where they are there; nothing is solved for this.
rule accuracy_rigid:
    input:
        scene="workflow/scenes/fig6.yaml",
        tables=lambda wildcards: [path for paths in sets(wildcards).values() for path in paths],
    output:
        csv="results/accuracy/rigid.csv",
        markdown="results/accuracy/rigid.md",
        png=report(
            "results/accuracy/rigid.png",
            caption="../report/accuracy_rigid.rst",
            category="Accuracy",
            labels={"figure": "rigid flight"},
        ),
    log:
        "results/logs/accuracy/rigid.log",
    benchmark:
        "results/benchmarks/accuracy/rigid.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=20,
    params:
        tables=lambda wildcards: [f"'{name}={','.join(paths)}'" for name, paths in sets(wildcards).items()],
    message:
        "What accuracy costs in rigid flight"
    shell:
        "python -m workflow.benchmarks.accuracy_rigid --scene {input.scene} --tables {params.tables}"
        " --out {output.csv} --markdown {output.markdown} --png {output.png} > {log} 2>&1"
