"""Does the sail lock to the polarisation of the beam? `snakemake polarisation` asks for the figure."""


rule polarisation:
    input:
        scene="workflow/scenes/fig6.yaml",
        cells=[f"workflow/designs/{design}.yaml" for design in ("mark1e_te", "mark1e_tm")],
        sources=sources("workflow/figures/polarisation.py"),
    output:
        png="results/figures/polarisation.png",
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
        "python workflow/figures/polarisation.py --scene {input.scene} --cells {input.cells}"
        " --out {output.png} --svg {output.svg} > {log} 2>&1"
