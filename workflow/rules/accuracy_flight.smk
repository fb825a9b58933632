"""What accuracy costs in flexible flight, on tables of several sources, and in tracing light within a curved sail.

`snakemake accuracy_flight accuracy_reflections` asks for both.
"""


rule accuracy_flight:
    input:
        scene="workflow/scenes/fig6.yaml",
        tables=lambda wildcards: [path for paths in sets(wildcards).values() for path in paths],  # of accuracy_rigid.smk
    output:
        csv="results/accuracy/flight.csv",
        markdown="results/accuracy/flight.md",
        png="results/accuracy/flight.png",
    log:
        "results/logs/accuracy/flight.log",
    benchmark:
        "results/benchmarks/accuracy/flight.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=30,
    params:
        tables=lambda wildcards: [f"'{name}={','.join(paths)}'" for name, paths in sets(wildcards).items()],
    message:
        "What accuracy costs in flexible flight"
    shell:
        "python -m workflow.benchmarks.accuracy_flight --scene {input.scene} --tables {params.tables}"
        " --out {output.csv} --markdown {output.markdown} --png {output.png} > {log} 2>&1"


rule accuracy_reflections:
    input:
        scene="workflow/scenes/fig4_reflections.yaml",
        tables="results/tables/si43/thin_film.h5",
    output:
        csv="results/accuracy/reflections.csv",
        markdown="results/accuracy/reflections.md",
    log:
        "results/logs/accuracy/reflections.log",
    benchmark:
        "results/benchmarks/accuracy/reflections.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=20,
    message:
        "Error of the light within a curved sail against rays and rings"
    shell:
        "python -m workflow.benchmarks.accuracy_reflections --scene {input.scene} --tables {input.tables}"
        " --out {output.csv} --markdown {output.markdown} > {log} 2>&1"
