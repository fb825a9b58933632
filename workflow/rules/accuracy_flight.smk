"""What accuracy costs in flexible flight, on tables of several sources. `snakemake accuracy_flight` asks for it."""


rule accuracy_flight:
    input:
        scene="workflow/scenes/fig6.yaml",
        tables=lambda wildcards: [path for paths in sets(wildcards).values() for path in paths],  # of accuracy_rigid.smk
        sources=sources("workflow/benchmarks/accuracy_flight.py"),
    output:
        csv="results/accuracy/flight.csv",
        markdown="results/accuracy/flight.md",
        png="results/accuracy/flight.png",
    log:
        "results/logs/accuracy/flight.log",
    benchmark:
        "results/benchmarks/accuracy/flight.tsv"
    params:
        tables=lambda wildcards: [f"'{name}={','.join(paths)}'" for name, paths in sets(wildcards).items()],
    threads: 1
    resources:
        mem_mb=1000,
        runtime=30,
    message:
        "What accuracy costs in flexible flight"
    shell:
        "python workflow/benchmarks/accuracy_flight.py --scene {input.scene} --tables {params.tables}"
        " --out {output.csv} --markdown {output.markdown} --png {output.png} > {log} 2>&1"
