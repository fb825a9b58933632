"""Pressure tables: by the Fourier modal method, by FDTD in resumable blocks of directions, and by transfer matrix."""


def grid(settings):
    """Command-line arguments of a table's range and tolerance."""
    return f"--u-max {settings.u_max} --v-max {settings.v_max} --tolerance {settings.tolerance}"


def parts(design):
    """Files of the blocks that a design's FDTD table is merged from."""
    return [f"results/tables/{design}/fdtd/part{i}.h5" for i in range(1, plan.config.fdtd_parts + 1)]


rule modal_table:
    input:
        cell="workflow/designs/{design}.yaml",
        sources=sources("optics.modal"),
    output:
        "results/tables/{design}/modal.h5",
    log:
        "results/logs/tables/{design}/modal.log",
    benchmark:
        "results/benchmarks/tables/{design}/modal.tsv"
    params:
        grid=grid(plan.config.modal),
    threads: 1
    resources:
        mem_mb=2000,
        runtime=30,
    priority: 100
    message:
        "Modal table of {wildcards.design}"
    shell:
        "python -m optics.modal --cell {input.cell} --out {output} {params.grid} > {log} 2>&1"


rule thin_film_table:
    input:
        cell="workflow/designs/{design}.yaml",
        sources=sources("optics.thin_film"),
    output:
        "results/tables/{design}/thin_film.h5",
    log:
        "results/logs/tables/{design}/thin_film.log",
    benchmark:
        "results/benchmarks/tables/{design}/thin_film.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    message:
        "Table of the film {wildcards.design}"
    shell:
        "python -m optics.thin_film --cell {input.cell} --out {output} > {log} 2>&1"


rule fdtd_nodes:
    input:
        cell="workflow/designs/{design}.yaml",
        sources=sources("optics.sampling"),
    output:
        "results/tables/{design}/fdtd/nodes.json",
    log:
        "results/logs/tables/{design}/fdtd_nodes.log",
    benchmark:
        "results/benchmarks/tables/{design}/fdtd_nodes.tsv"
    params:
        grid=grid(plan.config.fdtd_grid),
    threads: 1
    resources:
        mem_mb=2000,
        runtime=30,
    priority: 90
    message:
        "Directions for FDTD on {wildcards.design}"
    shell:
        "python -m optics.sampling --cell {input.cell} --out {output} {params.grid} > {log} 2>&1"


rule fdtd_part:
    input:
        cell="workflow/designs/{design}.yaml",
        nodes="results/tables/{design}/fdtd/nodes.json",
        sources=sources("optics.fdtd"),
    output:
        "results/tables/{design}/fdtd/part{part}.h5",
    log:
        "results/logs/tables/{design}/fdtd_part{part}.log",
    benchmark:
        "results/benchmarks/tables/{design}/fdtd_part{part}.tsv"
    params:
        parts=plan.config.fdtd_parts,
    threads: 1
    resources:
        mem_mb=2000,
        runtime=240,
    priority: 50
    message:
        "FDTD on {wildcards.design}, part {wildcards.part} of {params.parts}"
    shell:
        "python -m optics.fdtd --cell {input.cell} --nodes {input.nodes}"
        " --part {wildcards.part}/{params.parts} --out {output} > {log} 2>&1"


rule fdtd_table:
    input:
        parts=lambda wildcards: parts(wildcards.design),
        cell="workflow/designs/{design}.yaml",
        nodes="results/tables/{design}/fdtd/nodes.json",
        sources=sources("optics.fdtd"),
    output:
        "results/tables/{design}/fdtd.h5",
    log:
        "results/logs/tables/{design}/fdtd_merge.log",
    benchmark:
        "results/benchmarks/tables/{design}/fdtd_merge.tsv"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=10,
    message:
        "FDTD table of {wildcards.design}"
    shell:
        "python -m optics.fdtd --cell {input.cell} --nodes {input.nodes}"
        " --merge {input.parts} --out {output} > {log} 2>&1"
