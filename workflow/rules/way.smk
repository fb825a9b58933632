"""Stability on the way to 0.2 c, as the light shifts to the red. `snakemake way` asks for it, `make results` not."""


rule band:
    input:
        cell="workflow/designs/{design}.yaml",
    output:
        "results/bands/{design}.h5",
    log:
        "results/logs/bands/{design}.log",
    benchmark:
        "results/benchmarks/bands/{design}.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=30,
        accept=accept_missed,
    message:
        "Response of {wildcards.design} over the band"
    shell:
        "python -m optics.band --cell {input.cell} --out {output} {resources.accept} > {log} 2>&1"


rule way_of_scene:
    input:
        scene="workflow/scenes/{scene}.yaml",
        responses=lambda wildcards: [
            f"results/bands/{design}.h5" for design in checked(plan.scene, wildcards.scene).sail.designs
        ],
    output:
        "results/scenes/{scene}/way.json",
    log:
        "results/logs/scenes/{scene}/way.log",
    benchmark:
        "results/benchmarks/scenes/{scene}/way.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    message:
        "Stability of {wildcards.scene} on its way"
    shell:
        "python -m dynamics.way --scene {input.scene} --responses {input.responses} --out {output} > {log} 2>&1"


rule way_figure:
    input:
        "results/scenes/{scene}/way.json",
    output:
        png=report(
            "results/figures/way_{scene}.png",
            caption="../report/way.rst",
            category="Stability",
            labels={"scene": "{scene}, on its way"},
        ),
        svg="results/figures/way_{scene}.svg",
    log:
        "results/logs/figures/way_{scene}.log",
    benchmark:
        "results/benchmarks/figures/way_{scene}.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    message:
        "Figure of the way of {wildcards.scene}"
    shell:
        "python -m workflow.figures.way --way {input} --out {output.png} --svg {output.svg} > {log} 2>&1"


rule way:
    input:
        [f"results/scenes/{scene}/way.json" for scene in plan.config.way],
        [f"results/figures/way_{scene}.png" for scene in plan.config.way],
