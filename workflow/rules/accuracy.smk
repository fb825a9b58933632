"""What accuracy costs: error against time for every knob. None of it is part of `make results`."""

ACCURACY = ["modal", "tables", *(["fdtd"] if plan.fdtd else [])]


rule accuracy_optics:
    input:
        "results/accuracy/optics.csv",


rule accuracy_rows:
    input:
        cells=[f"workflow/designs/{name}.yaml" for name in ("mark1e_te", "mark1e_tm")],
    output:
        "results/accuracy/{part}.csv",
    log:
        "results/logs/accuracy/{part}.log",
    benchmark:
        "results/benchmarks/accuracy/{part}.tsv"
    wildcard_constraints:
        part="modal|tables|fdtd",
    threads: 1
    resources:
        mem_mb=2000,
        runtime=60,
    message:
        "Error against time: {wildcards.part}"
    shell:
        "python -m workflow.benchmarks.accuracy_{wildcards.part} --out {output} > {log} 2>&1"


rule accuracy_figure:
    input:
        rows=[f"results/accuracy/{part}.csv" for part in ACCURACY],
    output:
        csv="results/accuracy/optics.csv",
        markdown="results/accuracy/optics.md",
        png="results/figures/accuracy_optics.png",
        svg="results/figures/accuracy_optics.svg",
    log:
        "results/logs/accuracy/optics.log",
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    message:
        "Figure and table of what the accuracy of the optics costs"
    shell:
        "python -m workflow.figures.accuracy --rows {input.rows} --csv {output.csv} --markdown {output.markdown}"
        " --out {output.png} --svg {output.svg} > {log} 2>&1"
