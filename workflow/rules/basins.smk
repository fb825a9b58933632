"""Basin maps: from which offsets and tilts a sail stays on its beam. `snakemake basins` asks for them, `make results` not."""


wildcard_constraints:
    incidence="sail_frame|yaw_blind",


rule basin_part:
    input:
        scene="workflow/scenes/{scene}.yaml",
        tables=flown,
        light=lit_by,
    output:
        "results/scenes/{scene}/basin/{incidence}/part{part}.h5",
    log:
        "results/logs/scenes/{scene}/basin/{incidence}/part{part}.log",
    benchmark:
        "results/benchmarks/scenes/{scene}/basin/{incidence}/part{part}.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=30,
    params:
        parts=basin_parts,
    message:
        "Basin of {wildcards.scene}, {wildcards.incidence}, part {wildcards.part} of {params.parts}"
    shell:
        "python -m dynamics.basin --scene {input.scene} --tables {input.tables} --incidence {wildcards.incidence}"
        " --block {wildcards.part}/{params.parts} --out {output} > {log} 2>&1"


rule basin:
    input:
        scene="workflow/scenes/{scene}.yaml",
        tables=flown,
        light=lit_by,
        parts=lambda wildcards: [
            f"results/scenes/{wildcards.scene}/basin/{wildcards.incidence}/part{i}.h5"
            for i in range(1, basin_parts(wildcards) + 1)
        ],
    output:
        "results/scenes/{scene}/basin/{incidence}.h5",
    log:
        "results/logs/scenes/{scene}/basin/{incidence}.log",
    benchmark:
        "results/benchmarks/scenes/{scene}/basin/{incidence}.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    message:
        "Basin of {wildcards.scene}, {wildcards.incidence}"
    shell:
        "python -m dynamics.basin --scene {input.scene} --tables {input.tables} --incidence {wildcards.incidence}"
        " --parts {input.parts} --out {output} > {log} 2>&1"


rule basin_figure:
    input:
        maps=[f"results/scenes/{{scene}}/basin/{incidence}.h5" for incidence in ("sail_frame", "yaw_blind")],
    output:
        png=report(
            "results/figures/basin_{scene}.png",
            caption="../report/basin.rst",
            category="Stability",
            labels={"scene": "{scene}"},
        ),
        svg="results/figures/basin_{scene}.svg",
    log:
        "results/logs/figures/basin_{scene}.log",
    benchmark:
        "results/benchmarks/figures/basin_{scene}.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    message:
        "Figure of the basin of {wildcards.scene}"
    shell:
        "python -m workflow.figures.basin --maps {input.maps} --out {output.png} --svg {output.svg} > {log} 2>&1"


rule basins:
    input:
        [f"results/figures/basin_{scene}.png" for scene in plan.config.basins],
