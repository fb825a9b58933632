"""What accuracy costs in flexible flight, on tables of several tolerances. `snakemake accuracy_flight` asks for it."""


rule accuracy_flight:
    input:
        scene="workflow/scenes/fig6.yaml",
        tables=[f"results/accuracy/{design}_{level}.h5" for level in LEVELS for design in ("mark1e_te", "mark1e_tm")],
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
        tables=[
            f"'modal {level}=results/accuracy/mark1e_te_{level}.h5,results/accuracy/mark1e_tm_{level}.h5'"
            for level in LEVELS
        ],
        # FDTD tables count where they are there; nothing is solved for this.
        fdtd=lambda wildcards: (
            "'FDTD=results/tables/mark1e_te/fdtd.h5,results/tables/mark1e_tm/fdtd.h5'"
            if all(os.path.exists(f"results/tables/mark1e_{cell}/fdtd.h5") for cell in ("te", "tm"))
            else ""
        ),
    threads: 1
    resources:
        mem_mb=1000,
        runtime=30,
    message:
        "What accuracy costs in flexible flight"
    shell:
        "python workflow/benchmarks/accuracy_flight.py --scene {input.scene} --tables {params.tables} {params.fdtd}"
        " --out {output.csv} --markdown {output.markdown} --png {output.png} > {log} 2>&1"
