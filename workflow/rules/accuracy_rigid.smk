"""What accuracy costs in rigid flight, from tables of several tolerances. `snakemake accuracy_rigid` asks for it."""

LEVELS = ("1e-3", "3e-3", "1e-2")


rule accuracy_table:
    input:
        cell="workflow/designs/{design}.yaml",
        sources=sources("optics.modal"),
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
    message:
        "Modal table of {wildcards.design} to {wildcards.level}"
    shell:
        "python -m optics.modal --cell {input.cell} --u-max 0.4227 --v-max 0.4227 --tolerance {wildcards.level}"
        " --out {output} > {log} 2>&1"


# FDTD tables count where they are there; nothing is solved for this.
rule accuracy_rigid:
    input:
        scene="workflow/scenes/fig6.yaml",
        tables=[f"results/accuracy/{design}_{level}.h5" for level in LEVELS for design in ("mark1e_te", "mark1e_tm")],
        sources=sources("workflow/benchmarks/accuracy_rigid.py"),
    output:
        csv="results/accuracy/rigid.csv",
        png="results/accuracy/rigid.png",
    log:
        "results/logs/accuracy/rigid.log",
    benchmark:
        "results/benchmarks/accuracy/rigid.tsv"
    params:
        modal=[
            f"'modal {level}=results/accuracy/mark1e_te_{level}.h5,results/accuracy/mark1e_tm_{level}.h5'"
            for level in LEVELS
        ],
        fdtd=lambda wildcards: (
            "'FDTD=results/tables/mark1e_te/fdtd.h5,results/tables/mark1e_tm/fdtd.h5'"
            if all(os.path.exists(f"results/tables/mark1e_{cell}/fdtd.h5") for cell in ("te", "tm"))
            else ""
        ),
    threads: 1
    resources:
        mem_mb=1000,
        runtime=20,
    message:
        "What accuracy costs in rigid flight"
    shell:
        "python workflow/benchmarks/accuracy_rigid.py --scene {input.scene} --tables {params.modal} {params.fdtd}"
        " --out {output.csv} --png {output.png} > {log} 2>&1"
