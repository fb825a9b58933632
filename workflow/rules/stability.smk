"""Which effects a scene calls for, and is the spinning sail stable: from the tables it flies on, and again from those of FDTD."""


rule scene_plan:
    input:
        scene="workflow/scenes/{scene}.yaml",
    output:
        "results/scenes/{scene}/plan.json",
    log:
        "results/logs/scenes/{scene}/plan.log",
    benchmark:
        "results/benchmarks/scenes/{scene}/plan.tsv"
    threads: 1
    resources:
        mem_mb=500,
        runtime=5,
    message:
        "Effects that {wildcards.scene} calls for"
    shell:
        "python -m dynamics.scene --scene {input.scene} --out {output} > {log} 2>&1"


rule floquet:
    input:
        scene="workflow/scenes/{scene}.yaml",
        tables=flown,
        light=lit_by,
    output:
        "results/scenes/{scene}/floquet.json",
    log:
        "results/logs/scenes/{scene}/floquet.log",
    benchmark:
        "results/benchmarks/scenes/{scene}/floquet.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    message:
        "Stability of {wildcards.scene}"
    shell:
        "python -m dynamics.floquet --scene {input.scene} --tables {input.tables} --out {output} > {log} 2>&1"


use rule floquet as floquet_fdtd with:
    input:
        scene="workflow/scenes/{scene}.yaml",
        tables=lambda wildcards: checked(plan.tables, wildcards.scene, "fdtd"),
        light=lit_by,
    output:
        "results/scenes/{scene}/floquet_fdtd.json",
    log:
        "results/logs/scenes/{scene}/floquet_fdtd.log",
    benchmark:
        "results/benchmarks/scenes/{scene}/floquet_fdtd.tsv"
    message:
        "Stability of {wildcards.scene} from FDTD tables"


# Fails where the two solvers disagree: something is wrong with one of them, or with the settings of FDTD.
rule checks:
    input:
        modal=[plan.table(design, "modal") for design in plan.fdtd_designs],
        fdtd=[plan.table(design, "fdtd") for design in plan.fdtd_designs],
        floquet=[f"results/scenes/{scene}/floquet.json" for scene in plan.fdtd_scenes],
        floquet_fdtd=[f"results/scenes/{scene}/floquet_fdtd.json" for scene in plan.fdtd_scenes],
    output:
        "results/checks.json",
    log:
        "results/logs/checks.log",
    benchmark:
        "results/benchmarks/checks.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    message:
        "FDTD against the modal method"
    shell:
        "python -m workflow.checks --modal {input.modal} --fdtd {input.fdtd}"
        " --floquet {input.floquet} --floquet-fdtd {input.floquet_fdtd} --out {output} > {log} 2>&1"


rule maps:
    input:
        scene="workflow/scenes/{scene}.yaml",
        tables=flown,
        light=lit_by,
    output:
        "results/scenes/{scene}/maps.h5",
    log:
        "results/logs/scenes/{scene}/maps.log",
    benchmark:
        "results/benchmarks/scenes/{scene}/maps.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    message:
        "Force and torque maps of {wildcards.scene}"
    shell:
        "python -m dynamics.maps --scene {input.scene} --tables {input.tables} --out {output} > {log} 2>&1"


rule maps_figure:
    input:
        maps="results/scenes/{scene}/maps.h5",
    output:
        png=report(
            "results/figures/maps_{scene}.png",
            caption="../report/maps.rst",
            category="Stability",
            labels={"figure": "force and torque on {scene}"},
        ),
        svg="results/figures/maps_{scene}.svg",
    log:
        "results/logs/figures/maps_{scene}.log",
    benchmark:
        "results/benchmarks/figures/maps_{scene}.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    message:
        "Figure of the force and torque maps of {wildcards.scene}"
    shell:
        "python -m workflow.figures.maps --maps {input.maps} --name {wildcards.scene}"
        " --out {output.png} --svg {output.svg} > {log} 2>&1"


rule payload_figure:
    input:
        scene="workflow/scenes/{scene}.yaml",
        tables=flown,
        light=lit_by,
    output:
        png=report(
            "results/figures/payload_{scene}.png",
            caption="../report/payload.rst",
            category="Stability",
            labels={"figure": "a payload behind {scene}"},
        ),
        svg="results/figures/payload_{scene}.svg",
    log:
        "results/logs/figures/payload_{scene}.log",
    benchmark:
        "results/benchmarks/figures/payload_{scene}.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    message:
        "Figure of the stability of {wildcards.scene} with a payload"
    shell:
        "python -m workflow.figures.payload --scene {input.scene} --tables {input.tables}"
        " --out {output.png} --svg {output.svg} > {log} 2>&1"


def studied(wildcards):
    """Tables of the designs of a published case."""
    from workflow.case import read_cases

    designs = checked(read_cases, CASES)[wildcards.case].designs
    return [plan.table(design, plan.config.tables) for design in designs]


def studies(wildcards):
    """Results of every published case with both incidence models."""
    from workflow.case import read_cases

    return [f"results/cases/{case}/{model}.json" for case in checked(read_cases, CASES) for model in BASE]


# Published cases, and the scene that each incidence model starts from.
CASES = "workflow/cases.yaml"
BASE = {"yaw_blind": "workflow/scenes/fig6_published.yaml", "sail_frame": "workflow/scenes/fig6.yaml"}


rule study:
    input:
        cases=CASES,
        scene=lambda wildcards: BASE[wildcards.model],
        tables=studied,
    output:
        "results/cases/{case}/{model}.json",
    log:
        "results/logs/cases/{case}/{model}.log",
    benchmark:
        "results/benchmarks/cases/{case}/{model}.tsv"
    wildcard_constraints:
        case=r"[A-Za-z0-9_]+",
        model="yaw_blind|sail_frame",
    threads: 1
    resources:
        mem_mb=1000,
        runtime=30,
    message:
        "Published case {wildcards.case}, {wildcards.model}"
    shell:
        "python -m workflow.case --cases {input.cases} --case {wildcards.case} --scene {input.scene}"
        " --tables {input.tables} --out {output} > {log} 2>&1"


rule heat:
    input:
        scene="workflow/scenes/{scene}.yaml",
        tables=flown,
        light=lit_by,
    output:
        "results/cases/heat_{scene}.json",
    log:
        "results/logs/cases/heat_{scene}.log",
    benchmark:
        "results/benchmarks/cases/heat_{scene}.tsv"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=60,
    message:
        "What the light taken up does to {wildcards.scene}"
    shell:
        "python -m workflow.heat --scene {input.scene} --tables {input.tables} --out {output} > {log} 2>&1"


rule conclusions:
    input:
        studies=studies,
        heat="results/cases/heat_fig6.json",
    output:
        csv="results/conclusions.csv",
        markdown="results/conclusions.md",
        png=report(
            "results/figures/conclusions.png",
            caption="../report/conclusions.rst",
            category="Stability",
            labels={"figure": "the paper's conclusions"},
        ),
        svg="results/figures/conclusions.svg",
    log:
        "results/logs/conclusions.log",
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    message:
        "What is left of the paper's conclusions"
    shell:
        "python -m workflow.figures.conclusions --studies {input.studies} --heat {input.heat} --csv {output.csv}"
        " --markdown {output.markdown} --out {output.png} --svg {output.svg} > {log} 2>&1"


rule merit:
    output:
        "results/merit.csv",
    log:
        "results/logs/merit.log",
    threads: 1
    resources:
        mem_mb=500,
        runtime=5,
    message:
        "Figures of merit of the materials"
    shell:
        "python -m dynamics.merit --out {output} > {log} 2>&1"
