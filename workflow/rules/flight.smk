"""Rigid and flexible flight. A killed flexible flight leaves its checkpoint beside its output and goes on from there."""


rule rigid:
    input:
        scene="workflow/scenes/{scene}.yaml",
        tables=flown,
        light=lit_by,
    output:
        "results/scenes/{scene}/rigid.h5",
    log:
        "results/logs/scenes/{scene}/rigid.log",
    benchmark:
        "results/benchmarks/scenes/{scene}/rigid.tsv"
    priority: 60
    threads: 1
    resources:
        mem_mb=1000,
        runtime=60,
    message:
        "Rigid flight of {wildcards.scene}"
    shell:
        "python -m dynamics.rigid --scene {input.scene} --tables {input.tables} --out {output} > {log} 2>&1"


rule flight:
    input:
        scene="workflow/scenes/{scene}.yaml",
        tables=flown,
        light=lit_by,
    output:
        "results/scenes/{scene}/flight.vtkhdf",
    log:
        "results/logs/scenes/{scene}/flight.log",
    benchmark:
        "results/benchmarks/scenes/{scene}/flight.tsv"
    # One long job each: they start before the many short ones of FDTD, which then fill the other cores.
    priority: 70
    threads: 1
    resources:
        mem_mb=2000,
        runtime=600,
    message:
        "Flexible flight of {wildcards.scene}"
    shell:
        "python -m dynamics.membrane --scene {input.scene} --tables {input.tables} --out {output} > {log} 2>&1"
