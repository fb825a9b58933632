"""Every published flight, for as long as published. `snakemake published_flights` asks for them, `make results` does not.

Each flight is a job of its own; one that is killed goes on from its checkpoint when it is asked for again. Flights on the
published tables are flown where these are: in the folder BEAMRIDER_REFERENCE or in ../shared/reference.
"""

from workflow.published import SOURCE as PUBLISHED, read_published
from workflow.published_tables import NAME as REFERENCE_NAME

REFERENCE = os.path.join(os.environ.get("BEAMRIDER_REFERENCE", "../shared/reference"), REFERENCE_NAME)
published = checked(read_published)


def published_sources(scene):
    """The tables that a published flight is flown on: always the project's own, the published ones where they are."""
    return [source for source in published[scene].tables if source == "modal" or os.path.exists(REFERENCE)]


def published_tables(wildcards):
    """Files of the pressure tables of one published flight."""
    if wildcards.source == "modal":
        return checked(plan.tables, wildcards.scene, "modal")
    return [f"results/tables/published/{design}.h5" for design in checked(plan.scene, wildcards.scene).sail.designs]


def published_rigid(wildcards):
    """The rigid flight of a scene, where the rigid model can fly it."""
    scene = checked(plan.scene, wildcards.scene)
    return [] if scene.sail.beyond_rigid else [f"results/scenes/{wildcards.scene}/rigid.h5"]


ALL_PUBLISHED = [(scene, source) for scene in published for source in published_sources(scene)]


rule published_flights:
    input:
        "results/published/flights.csv",
        [f"results/figures/published_{scene}.png" for scene in published],


rule published_reference:
    input:
        REFERENCE,
    output:
        "results/tables/published/mark1e_te.h5",
        "results/tables/published/mark1e_tm.h5",
    log:
        "results/logs/tables/published.log",
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    message:
        "Published pressure tables"
    shell:
        "python -m workflow.published_tables --data {input} --out $(dirname {output[0]}) > {log} 2>&1"


# The list is no input: a flight is flown again where its own mesh or duration changed, not with every remark.
rule published_scene:
    input:
        scene="workflow/scenes/{scene}.yaml",
    output:
        "results/published/{scene}/{scene}.yaml",
    log:
        "results/logs/published/{scene}/scene.log",
    threads: 1
    resources:
        mem_mb=500,
        runtime=5,
    params:
        flown=lambda wildcards: published[wildcards.scene].model_dump(include={"rings", "duration_s"}),
    message:
        "Scene of the published flight {wildcards.scene}"
    shell:
        "python -m workflow.published --scene {input.scene} --out {output} > {log} 2>&1"


rule published_flight:
    input:
        scene="results/published/{scene}/{scene}.yaml",
        tables=published_tables,
    output:
        "results/published/{scene}/{source}.vtkhdf",
    log:
        "results/logs/published/{scene}/{source}.log",
    benchmark:
        "results/benchmarks/published/{scene}/{source}.tsv"
    wildcard_constraints:
        source="modal|published",
    threads: 1
    resources:
        mem_mb=4000,
        runtime=600,
    message:
        "Published flight {wildcards.scene} on {wildcards.source} tables"
    shell:
        "python -m dynamics.membrane --scene {input.scene} --tables {input.tables} --out {output} > {log} 2>&1"


rule published_figure:
    input:
        flights=lambda wildcards: [
            f"results/published/{wildcards.scene}/{source}.vtkhdf" for source in published_sources(wildcards.scene)
        ],
        rigid=published_rigid,
        published=str(PUBLISHED),
    output:
        png="results/figures/published_{scene}.png",
        svg="results/figures/published_{scene}.svg",
    log:
        "results/logs/figures/published_{scene}.log",
    threads: 1
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        flights=lambda wildcards, input: [f"{os.path.basename(path).split('.')[0]}={path}" for path in input.flights],
        rigid=lambda wildcards, input: f"--rigid {input.rigid}" if input.rigid else "",
    message:
        "Figure of the published flight {wildcards.scene}"
    shell:
        "python -m workflow.figures.published_flight --name {wildcards.scene} --flights {params.flights} {params.rigid}"
        " --out {output.png} --svg {output.svg} > {log} 2>&1"


rule published_table:
    input:
        flights=[f"results/published/{scene}/{source}.vtkhdf" for scene, source in ALL_PUBLISHED],
        published=str(PUBLISHED),
    output:
        csv="results/published/flights.csv",
        html="results/published/flights.html",
        markdown="results/published/flights.md",
    log:
        "results/logs/published/table.log",
    threads: 1
    resources:
        mem_mb=2000,
        runtime=20,
    params:
        flights=[f"{scene}:{source}=results/published/{scene}/{source}.vtkhdf" for scene, source in ALL_PUBLISHED],
    message:
        "Published flights against the paper"
    shell:
        "python -m workflow.figures.published_table --flights {params.flights} --out {output.csv} --html {output.html}"
        " --markdown {output.markdown} > {log} 2>&1"
