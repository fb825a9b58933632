"""Families of designs: every cell once, in blocks of jobs; stability of every member; FDTD and flights of the best alone."""


def family(name):
    """A family of designs, read and checked when it is first asked for."""
    from workflow.family import read_family

    return checked(read_family, f"workflow/designs/{name}.yaml")


def base_scene(wildcards):
    """File of the scene that a family starts from."""
    return f"workflow/scenes/{family(wildcards.family).scene}.yaml"


def base_designs(wildcards):
    """Files of that scene's designs."""
    designs = plan.scene(family(wildcards.family).scene).sail.designs
    return [f"workflow/designs/{design}.yaml" for design in designs]


def confirmed(file):
    """That file of each of the best members, once screening has found them."""

    def paths(wildcards):
        folder = Path(checkpoints.candidates.get(family=wildcards.family).output[0])
        places = sorted((path.name for path in folder.iterdir() if path.name.isdecimal()), key=int)
        return [f"results/screening/{wildcards.family}/confirmed/{place}/{file}" for place in places]

    return paths


# What each of the best members costs, and what the base scene is asked for beside them.
CONFIRMATION = ("floquet.json", "rigid.h5", "basin/sail_frame.h5", "flight.vtkhdf")


def beside(wildcards):
    """The same results of the base scene: its stability from FDTD tables too where these are made anyway."""
    scene = family(wildcards.family).scene
    files = [*CONFIRMATION, *(["floquet_fdtd.json"] if scene in plan.fdtd_scenes else [])]
    return [f"results/scenes/{scene}/{file}" for file in files]


wildcard_constraints:
    family=r"[A-Za-z0-9_]+",
    place=r"\d+",
    cell=r"te|tm",


rule family:
    input:
        family="workflow/designs/{family}.yaml",
        scene=base_scene,
        designs=base_designs,
    output:
        cells="results/screening/{family}/cells.jsonl",
        members="results/screening/{family}/members.parquet",
    log:
        "results/logs/screening/{family}/family.log",
    threads: 1
    resources:
        mem_mb=2000,
        runtime=10,
    message:
        "Members of the family {wildcards.family}"
    shell:
        "python -m workflow.family --family {input.family} --out $(dirname {output.cells}) > {log} 2>&1"


# Blocks that are done stay done: a run that was killed goes on with the others.
rule cells:
    input:
        cells="results/screening/{family}/cells.jsonl",
    output:
        "results/screening/{family}/cells/{part}.parquet",
    log:
        "results/logs/screening/{family}/cells/{part}.log",
    benchmark:
        "results/benchmarks/screening/{family}/cells/{part}.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=60,
    params:
        blocks=screening_parts,
        orders=lambda wildcards: family(wildcards.family).orders,
    message:
        "Cells of the family {wildcards.family}, part {wildcards.part} of {params.blocks}"
    shell:
        keys.shared(
            "python -m optics.local --cells {input.cells} --block {wildcards.part}/{params.blocks} --order {params.orders}"
            " --out {output} > {log} 2>&1"
        )


rule screened:
    input:
        scene=base_scene,
        members="results/screening/{family}/members.parquet",
        cells=lambda wildcards: [
            f"results/screening/{wildcards.family}/cells/{k}.parquet" for k in range(1, screening_parts(wildcards) + 1)
        ],
    output:
        "results/screening/{family}/screened.parquet",
    log:
        "results/logs/screening/{family}/screened.log",
    benchmark:
        "results/benchmarks/screening/{family}/screened.tsv"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        by=lambda wildcards: family(wildcards.family).best.by,
        at_least=lambda wildcards: family(wildcards.family).best.at_least,
    message:
        "Stability of the family {wildcards.family}"
    shell:
        "python -m dynamics.screening --scene {input.scene} --members {input.members} --cells {input.cells}"
        " --by {params.by} --at-least {params.at_least} --out {output} > {log} 2>&1"


# A checkpoint: which designs FDTD and the flights get is known only now.
checkpoint candidates:
    input:
        family="workflow/designs/{family}.yaml",
        scene=base_scene,
        screened="results/screening/{family}/screened.parquet",
        cells="results/screening/{family}/cells.jsonl",
    output:
        directory("results/screening/{family}/candidates"),
    log:
        "results/logs/screening/{family}/candidates.log",
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    message:
        "Best members of the family {wildcards.family}"
    shell:
        "python -m workflow.candidates --family {input.family} --scene {input.scene} --screened {input.screened}"
        " --cells {input.cells} --out {output} > {log} 2>&1"


CONFIRMED = "results/screening/{family}/confirmed/{place}"


def candidate(name):
    """A file of a candidate, there once the checkpoint has run."""

    def path(wildcards):
        folder = checkpoints.candidates.get(family=wildcards.family).output[0]
        return f"{folder}/{wildcards.place}/{name.format(**dict(wildcards.items()))}"

    return path


use rule modal_table as candidate_modal_table with:
    input:
        cell=candidate("{cell}.yaml"),
    output:
        f"{CONFIRMED}/{{cell}}/modal.h5",
    log:
        "results/logs/screening/{family}/{place}/{cell}/modal.log",
    benchmark:
        "results/benchmarks/screening/{family}/{place}/{cell}/modal.tsv"
    message:
        "Modal table of cell {wildcards.cell} of candidate {wildcards.place} of {wildcards.family}"


rule candidate_fdtd_nodes:
    input:
        cell=candidate("{cell}.yaml"),
    output:
        f"{CONFIRMED}/{{cell}}/fdtd/nodes.json",
    log:
        "results/logs/screening/{family}/{place}/{cell}/fdtd/nodes.log",
    threads: 1
    resources:
        mem_mb=2000,
        runtime=30,
    params:
        grid=grid(plan.config.fdtd_grid),
    message:
        "Directions for FDTD on cell {wildcards.cell} of candidate {wildcards.place} of {wildcards.family}"
    shell:
        keys.shared("python -m optics.nodes --cell {input.cell} --out {output} {params.grid} > {log} 2>&1")


use rule fdtd_part as candidate_fdtd_part with:
    input:
        cell=candidate("{cell}.yaml"),
        nodes=f"{CONFIRMED}/{{cell}}/fdtd/nodes.json",
    output:
        f"{CONFIRMED}/{{cell}}/fdtd/part{{part}}.h5",
    log:
        "results/logs/screening/{family}/{place}/{cell}/fdtd/part{part}.log",
    benchmark:
        "results/benchmarks/screening/{family}/{place}/{cell}/fdtd/part{part}.tsv"
    message:
        "FDTD on cell {wildcards.cell} of candidate {wildcards.place} of {wildcards.family}, part {wildcards.part}"


use rule fdtd_table as candidate_fdtd_table with:
    input:
        parts=lambda wildcards: [
            f"{CONFIRMED}/{{cell}}/fdtd/part{k}.h5".format(**dict(wildcards.items()))
            for k in range(1, fdtd_parts(wildcards) + 1)
        ],
        cell=candidate("{cell}.yaml"),
        nodes=f"{CONFIRMED}/{{cell}}/fdtd/nodes.json",
    output:
        f"{CONFIRMED}/{{cell}}/fdtd.h5",
    log:
        "results/logs/screening/{family}/{place}/{cell}/fdtd.log",
    benchmark:
        "results/benchmarks/screening/{family}/{place}/{cell}/fdtd.tsv"
    message:
        "FDTD table of cell {wildcards.cell} of candidate {wildcards.place} of {wildcards.family}"


use rule floquet as candidate_floquet with:
    input:
        scene=candidate("sail.yaml"),
        tables=[f"{CONFIRMED}/{cell}/modal.h5" for cell in ("te", "tm")],
    output:
        f"{CONFIRMED}/floquet.json",
    log:
        "results/logs/screening/{family}/{place}/floquet.log",
    benchmark:
        "results/benchmarks/screening/{family}/{place}/floquet.tsv"
    message:
        "Stability of candidate {wildcards.place} of {wildcards.family}"


use rule floquet as candidate_floquet_fdtd with:
    input:
        scene=candidate("sail.yaml"),
        tables=[f"{CONFIRMED}/{cell}/fdtd.h5" for cell in ("te", "tm")],
    output:
        f"{CONFIRMED}/floquet_fdtd.json",
    log:
        "results/logs/screening/{family}/{place}/floquet_fdtd.log",
    benchmark:
        "results/benchmarks/screening/{family}/{place}/floquet_fdtd.tsv"
    message:
        "Stability of candidate {wildcards.place} of {wildcards.family} from FDTD tables"


use rule rigid as candidate_rigid with:
    input:
        scene=candidate("sail.yaml"),
        tables=[f"{CONFIRMED}/{cell}/modal.h5" for cell in ("te", "tm")],
    output:
        f"{CONFIRMED}/rigid.h5",
    log:
        "results/logs/screening/{family}/{place}/rigid.log",
    benchmark:
        "results/benchmarks/screening/{family}/{place}/rigid.tsv"
    message:
        "Rigid flight of candidate {wildcards.place} of {wildcards.family}"


use rule basin_part as candidate_basin_part with:
    input:
        scene=candidate("sail.yaml"),
        tables=[f"{CONFIRMED}/{cell}/modal.h5" for cell in ("te", "tm")],
    output:
        f"{CONFIRMED}/basin/{{incidence}}/part{{part}}.h5",
    log:
        "results/logs/screening/{family}/{place}/basin/{incidence}/part{part}.log",
    benchmark:
        "results/benchmarks/screening/{family}/{place}/basin/{incidence}/part{part}.tsv"
    message:
        "Basin of candidate {wildcards.place} of {wildcards.family}, part {wildcards.part}"


use rule basin as candidate_basin with:
    input:
        scene=candidate("sail.yaml"),
        tables=[f"{CONFIRMED}/{cell}/modal.h5" for cell in ("te", "tm")],
        parts=lambda wildcards: [
            f"{CONFIRMED}/basin/{{incidence}}/part{i}.h5".format(**dict(wildcards.items()))
            for i in range(1, basin_parts(wildcards) + 1)
        ],
    output:
        f"{CONFIRMED}/basin/{{incidence}}.h5",
    log:
        "results/logs/screening/{family}/{place}/basin/{incidence}.log",
    benchmark:
        "results/benchmarks/screening/{family}/{place}/basin/{incidence}.tsv"
    message:
        "Basin of candidate {wildcards.place} of {wildcards.family}"


use rule flight as candidate_flight with:
    input:
        scene=candidate("sail.yaml"),
        tables=[f"{CONFIRMED}/{cell}/modal.h5" for cell in ("te", "tm")],
    output:
        f"{CONFIRMED}/flight.vtkhdf",
    log:
        "results/logs/screening/{family}/{place}/flight.log",
    benchmark:
        "results/benchmarks/screening/{family}/{place}/flight.tsv"
    message:
        "Flexible flight of candidate {wildcards.place} of {wildcards.family}"


rule confirmed:
    input:
        family="workflow/designs/{family}.yaml",
        screened="results/screening/{family}/screened.parquet",
        base=beside,
        floquet=confirmed("floquet.json"),
        fdtd=confirmed("floquet_fdtd.json") if plan.fdtd else [],
        rigid=confirmed("rigid.h5"),
        basin=confirmed("basin/sail_frame.h5"),
        flight=confirmed("flight.vtkhdf"),
    output:
        csv="results/screening/{family}/confirmed.csv",
        markdown="results/screening/{family}/confirmed.md",
    log:
        "results/logs/screening/{family}/confirmed.log",
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        base=lambda wildcards: f"results/scenes/{family(wildcards.family).scene}",
        candidates=lambda wildcards, input: [os.path.dirname(path) for path in input.floquet],
    message:
        "Table of the best members of the family {wildcards.family}"
    shell:
        "python -m workflow.confirmed --family {input.family} --screened {input.screened} --base {params.base}"
        " --candidates {params.candidates} --csv {output.csv} --markdown {output.markdown} > {log} 2>&1"


rule confirmed_figure:
    input:
        base=lambda wildcards: f"results/scenes/{family(wildcards.family).scene}/basin/sail_frame.h5",
        best=confirmed("basin/sail_frame.h5"),
    output:
        png=report(
            "results/figures/confirmed_{family}.png",
            caption="../report/confirmed.rst",
            category="Screening",
            labels={"family": "{family}, basins of the best"},
        ),
        svg="results/figures/confirmed_{family}.svg",
    log:
        "results/logs/figures/confirmed_{family}.log",
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        names=lambda wildcards, input: [family(wildcards.family).scene]
        + [f"'{wildcards.family}, {os.path.dirname(os.path.dirname(path)).split('/')[-1]}'" for path in input.best],
    message:
        "Basins of the best members of the family {wildcards.family}"
    shell:
        "python -m workflow.figures.basin --maps {input.base} {input.best} --names {params.names}"
        " --out {output.png} --svg {output.svg} > {log} 2>&1"


rule family_figure:
    input:
        screened="results/screening/{family}/screened.parquet",
    output:
        png=report(
            "results/figures/family_{family}.png",
            caption="../report/families.rst",
            category="Screening",
            labels={"family": "{family}"},
        ),
        svg="results/figures/family_{family}.svg",
    log:
        "results/logs/figures/family_{family}.log",
    threads: 1
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        kind=lambda wildcards: wildcards.family if wildcards.family in ("gap_study", "tolerances") else "search",
    message:
        "Figure of the family {wildcards.family}"
    shell:
        "python -m workflow.figures.families --kind {params.kind} --screened {input.screened}"
        " --out {output.png} --svg {output.svg} > {log} 2>&1"


# The paper's search around its design, and the best of it confirmed.
rule screening:
    input:
        "results/figures/family_search.png",
        "results/figures/confirmed_search.png",
        "results/screening/search/confirmed.md",


rule better_design:
    input:
        "results/figures/confirmed_wider_periods.png",
        "results/screening/wider_periods/confirmed.md",


rule gap_study:
    input:
        "results/figures/family_gap_study.png",


rule tolerances:
    input:
        "results/figures/family_tolerances.png",
