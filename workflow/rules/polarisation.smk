"""Does the sail lock to the polarisation of the beam? `snakemake polarisation` asks for the figure."""


rule polarisation:
    input:
        scene="workflow/scenes/fig6.yaml",
        tables=lambda wildcards: checked(plan.tables, "fig6", "modal"),
    output:
        csv="results/polarisation.csv",
        png=report(
            "results/figures/polarisation.png",
            caption="../report/polarisation.rst",
            category="Stability",
            labels={"figure": "does the sail lock to the polarisation?"},
        ),
        svg="results/figures/polarisation.svg",
    log:
        "results/logs/figures/polarisation.log",
    benchmark:
        "results/benchmarks/figures/polarisation.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    message:
        "Spin torque and flights against the polarisation of the beam"
    shell:
        "python -m workflow.figures.polarisation --scene {input.scene} --tables {input.tables} --csv {output.csv}"
        " --out {output.png} --svg {output.svg} > {log} 2>&1"
