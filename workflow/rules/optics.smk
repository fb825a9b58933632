"""Pressure tables: by the Fourier modal method, by FDTD in resumable blocks of directions, and by transfer matrix."""


rule modal_table:
    input:
        cell="workflow/designs/{design}.yaml",
    output:
        "results/tables/{design}/modal.h5",
    log:
        "results/logs/tables/{design}/modal.log",
    benchmark:
        "results/benchmarks/tables/{design}/modal.tsv"
    priority: 100
    threads: 1
    resources:
        mem_mb=2000,
        runtime=30,
        accept=accept_missed,
    params:
        grid=grid(plan.config.modal),
    message:
        "Modal table of {wildcards.design}"
    shell:
        keys.shared(
            "python -m optics.modal --cell {input.cell} --out {output} {params.grid} {resources.accept} > {log} 2>&1"
            + keep_missed
        )


rule thin_film_table:
    input:
        cell="workflow/designs/{design}.yaml",
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
        accept=accept_missed,
    message:
        "Table of the film {wildcards.design}"
    shell:
        keys.shared(
            "python -m optics.thin_film --cell {input.cell} --out {output} {resources.accept} > {log} 2>&1"
            + keep_missed
        )


# A checkpoint, so that what follows is decided by the directions it finds: the same ones again re-run no FDTD.
checkpoint fdtd_nodes:
    input:
        cell="workflow/designs/{design}.yaml",
    output:
        "results/tables/{design}/fdtd/nodes.json",
    log:
        "results/logs/tables/{design}/fdtd/nodes.log",
    benchmark:
        "results/benchmarks/tables/{design}/fdtd/nodes.tsv"
    priority: 90
    threads: 1
    resources:
        mem_mb=2000,
        runtime=30,
    params:
        grid=grid(plan.config.fdtd_grid),
    message:
        "Directions for FDTD on {wildcards.design}"
    shell:
        keys.shared("python -m optics.nodes --cell {input.cell} --out {output} {params.grid} > {log} 2>&1")


rule fdtd_part:
    input:
        cell="workflow/designs/{design}.yaml",
        nodes=nodes,
    output:
        "results/tables/{design}/fdtd/part{part}.h5",
    log:
        "results/logs/tables/{design}/fdtd/part{part}.log",
    benchmark:
        "results/benchmarks/tables/{design}/fdtd/part{part}.tsv"
    priority: 50
    threads: 1
    resources:
        mem_mb=2000,
        runtime=240,
    params:
        parts=fdtd_parts,
        tolerance=plan.config.fdtd_tolerance,
        # Rows are kept here as they come. A job that was killed goes on from them, unless what it is made from has changed.
        rows=lambda wildcards, output: f"{output}.{keys.of(str(output))[:12]}",
    message:
        "FDTD on {wildcards.design}, part {wildcards.part} of {params.parts}"
    shell:
        keys.shared(
            "python -m optics.fdtd --cell {input.cell} --nodes {input.nodes} --tolerance {params.tolerance}"
            " --part {wildcards.part}/{params.parts} --out {params.rows} > {log} 2>&1"
            " && mv {params.rows} {output} && rm -f {output}.*"
        )


rule fdtd_table:
    input:
        parts=lambda wildcards: plan.parts(wildcards.design),
        cell="workflow/designs/{design}.yaml",
        nodes=nodes,
    output:
        "results/tables/{design}/fdtd.h5",
    log:
        "results/logs/tables/{design}/fdtd.log",
    benchmark:
        "results/benchmarks/tables/{design}/fdtd.tsv"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=10,
        accept=accept_missed_fdtd,
    params:
        tolerance=plan.config.fdtd_tolerance,
    message:
        "FDTD table of {wildcards.design}"
    shell:
        keys.shared(
            "python -m optics.fdtd --cell {input.cell} --nodes {input.nodes} --tolerance {params.tolerance}"
            " --merge {input.parts} --out {output} {resources.accept} > {log} 2>&1" + keep_missed
        )
