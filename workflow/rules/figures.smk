"""Figures, as PNG and SVG, and the table of key numbers."""


rule pressure_figure:
    input:
        modal="results/tables/{design}/modal.h5",
        fdtd=lambda wildcards: [plan.table(d, "fdtd") for d in plan.fdtd_designs if d == wildcards.design],
    output:
        png=report(
            "results/figures/pressure_{design}.png",
            caption="../report/pressure.rst",
            category="Pressure tables",
            labels={"design": "{design}"},
        ),
        svg="results/figures/pressure_{design}.svg",
    log:
        "results/logs/figures/pressure_{design}.log",
    benchmark:
        "results/benchmarks/figures/pressure_{design}.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        fdtd=lambda wildcards, input: f"--fdtd {input.fdtd}" if input.fdtd else "",
    message:
        "Figure of the tables of {wildcards.design}"
    shell:
        "python -m workflow.figures.pressure --modal {input.modal} {params.fdtd}"
        " --out {output.png} --svg {output.svg} > {log} 2>&1"


rule fdtd_figure:
    input:
        modal=[plan.table(design, "modal") for design in plan.fdtd_designs],
        parts=[part for design in plan.fdtd_designs for part in plan.parts(design)],
    output:
        png=report(
            "results/figures/fdtd.png",
            caption="../report/fdtd.rst",
            category="Pressure tables",
            labels={"design": "error and cost of FDTD"},
        ),
        svg="results/figures/fdtd.svg",
    log:
        "results/logs/figures/fdtd.log",
    benchmark:
        "results/benchmarks/figures/fdtd.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    message:
        "Figure of the error and cost of FDTD"
    shell:
        "python -m workflow.figures.fdtd --modal {input.modal} --parts {input.parts}"
        " --out {output.png} --svg {output.svg} > {log} 2>&1"


rule multipliers_figure:
    input:
        plan.all_floquet,
    output:
        png=report(
            "results/figures/multipliers.png",
            caption="../report/multipliers.rst",
            category="Stability",
            labels={"figure": "multipliers"},
        ),
        svg="results/figures/multipliers.svg",
    log:
        "results/logs/figures/multipliers.log",
    benchmark:
        "results/benchmarks/figures/multipliers.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        floquet=labelled(plan.config.floquet, "floquet.json"),
        fdtd=labelled(plan.fdtd_scenes, "floquet_fdtd.json"),
    message:
        "Figure of the multipliers"
    shell:
        "python -m workflow.figures.multipliers --floquet {params.floquet} --fdtd {params.fdtd}"
        " --out {output.png} --svg {output.svg} > {log} 2>&1"


rule flights_figure:
    input:
        plan.all_flights,
    output:
        png=report(
            "results/figures/flights.png",
            caption="../report/flights.rst",
            category="Flight",
            labels={"figure": "trajectory, tilt, temperature"},
        ),
        svg="results/figures/flights.svg",
    log:
        "results/logs/figures/flights.log",
    benchmark:
        "results/benchmarks/figures/flights.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        rigid=labelled(plan.config.rigid, "rigid.h5"),
        flexible=labelled(plan.config.flight, "flight.vtkhdf"),
    message:
        "Figure of the flights"
    shell:
        "python -m workflow.figures.flights --rigid {params.rigid} --flexible {params.flexible}"
        " --out {output.png} --svg {output.svg} > {log} 2>&1"


rule snapshots_figure:
    input:
        flight="results/scenes/{scene}/flight.vtkhdf",
    output:
        png=report(
            "results/figures/snapshots_{scene}.png",
            caption="../report/snapshots.rst",
            category="Flight",
            labels={"figure": "snapshots of {scene}"},
        ),
        svg="results/figures/snapshots_{scene}.svg",
    log:
        "results/logs/figures/snapshots_{scene}.log",
    benchmark:
        "results/benchmarks/figures/snapshots_{scene}.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    message:
        "Snapshots of {wildcards.scene}"
    shell:
        "python -m workflow.figures.snapshots --flight {input.flight} --name {wildcards.scene}"
        " --out {output.png} --svg {output.svg} > {log} 2>&1"


# Digest of the list of all figures and flights: the report is made anew where it changed, if only by a scene less.
rule contents:
    output:
        "results/contents.sha256",
    threads: 1
    resources:
        mem_mb=100,
        runtime=5,
    params:
        digest=digest_of([plan.figures, plan.all_flights, plan.all_floquet, plan.all_tables, list(plan.scenes)]),
    message:
        "What the report holds"
    shell:
        "echo {params.digest} > {output}"


rule summary:
    input:
        tables=plan.all_tables,
        floquet=plan.all_floquet,
        flights=plan.all_flights,
        benchmarks=plan.benchmarks,
    output:
        csv=report("results/summary.csv", caption="../report/summary.rst", category="Summary", labels={"table": "CSV"}),
        html=report(
            "results/summary.html",
            caption="../report/summary.rst",
            category="Summary",
            labels={"table": "key numbers"},
        ),
    log:
        "results/logs/summary.log",
    benchmark:
        "results/benchmarks/summary.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    message:
        "Table of key numbers"
    shell:
        "python -m workflow.figures.summary --tables {input.tables} --floquet {input.floquet} --flights {input.flights}"
        " --benchmarks {input.benchmarks} --out {output.csv} --html {output.html} > {log} 2>&1"
