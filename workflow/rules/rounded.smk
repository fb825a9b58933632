"""Cells with rounded corners by FDTD, against the modal staircase and the sharp cells: `snakemake rounded`."""

# How the directions of each are chosen: by what FDTD finds itself, and, for the cell that is dear, by the modal method.
ROUNDED = {"te": "fdtd_adaptive", "tm": "fdtd"}


rule rounded:
    input:
        tables=[f"results/tables/rounded_{name}/{way}.h5" for name, way in ROUNDED.items()],
        rounded=[f"workflow/designs/rounded_{name}.yaml" for name in ROUNDED],
        sharp=[f"workflow/designs/mark1e_{name}.yaml" for name in ROUNDED],
    output:
        csv="results/rounded.csv",
        png="results/figures/rounded.png",
        svg="results/figures/rounded.svg",
    log:
        "results/logs/figures/rounded.log",
    benchmark:
        "results/benchmarks/figures/rounded.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    message:
        "Figure and numbers of rounded corners"
    shell:
        "python -m workflow.figures.rounded --tables {input.tables} --rounded {input.rounded} --sharp {input.sharp}"
        " --csv {output.csv} --out {output.png} --svg {output.svg} > {log} 2>&1"


rule fdtd_adaptive_table:
    input:
        cell="workflow/designs/{design}.yaml",
    output:
        "results/tables/{design}/fdtd_adaptive.h5",
    log:
        "results/logs/tables/{design}/fdtd_adaptive.log",
    benchmark:
        "results/benchmarks/tables/{design}/fdtd_adaptive.tsv"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=240,
    params:
        range=f"--u-max {plan.config.fdtd_grid.u_max} --v-max {plan.config.fdtd_grid.v_max}",
        tolerance=plan.config.fdtd_tolerance,
        # Rows are kept beside this file as they come. A job that was killed goes on from them, unless what it is made from
        # has changed.
        out=lambda wildcards, output: f"{output}.{keys.of(str(output))[:12]}",
    message:
        "FDTD table of {wildcards.design}, its directions chosen by FDTD"
    shell:
        keys.shared(
            "python -m optics.fdtd --accept-missed --cell {input.cell} {params.range} --tolerance {params.tolerance}"
            " --out {params.out} > {log} 2>&1 && mv {params.out} {output} && rm -f {output}.*"
        )
