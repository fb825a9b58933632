"""What all rules share: the checked configuration, the keys of what they make, one thread a job."""

import atexit
import os
import sys
from pathlib import Path

from snakemake.logging import logger

# The project's own modules are those beside this workflow, whichever copy of it is installed.
sys.path.insert(0, workflow.basedir)

from beamrider.io.files import InputError
from beamrider.machine_code.cache import digest as digest_of_kernels
from beamrider.provenance.sources import digest_of
from workflow.configuration import SOURCE, link_program, read_config, read_plan
from workflow.demands import attach
from workflow.keys import WHOLE_GRAPH, Keys
from workflow.ledger import Ledger

# Jobs run the Python that runs Snakemake, each on one core, and import the modules of the folder they run in: this project's,
# or links to them.
os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
os.environ.pop("PYTHONSAFEPATH", None)
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[variable] = "1"


def checked(read, *what):
    """`read(*what)`; a user's mistake ends Snakemake with one line."""
    try:
        return read(*what)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        raise SystemExit(2) from None


checked(link_program, Path(workflow.basedir), Path())

# Read by the project's own reader in place of `configfile:`, which takes 1e-3 for text and 0600 for 384.
settings = workflow.config_settings
own = [] if settings.replace_workflow_config else [SOURCE]
config = checked(read_config, [*own, *settings.configfiles], settings.config)
plan = checked(read_plan, config)

ledger = Ledger(Path(".snakemake/beamrider.json"))
if workflow.is_main_process:
    atexit.register(ledger.save)
keys = Keys(workflow, ledger, any(word.startswith(WHOLE_GRAPH) for word in sys.argv), checked, plan.files)

if not plan.fdtd:
    why = "fdtd: false" if plan.config.fdtd is False else "Meep is not installed (apt-get install python3-meep)"
    logger.info(f"FDTD left out, everything else runs: {why}")


# What to do with a table that missed its tolerance (exit code 3). A resource, not a parameter: tables that met theirs are
# not made again when this changes. Snakemake removes the output of a job that failed: what was made is kept beside it.
accept_missed = "--accept-missed" if plan.config.accept_missed else ""
# FDTD tables that no scene flies on check the modal ones, within the limits of workflow.checks: a miss is shown, and stops
# nothing.
accept_missed_fdtd = "--accept-missed" if plan.config.accept_missed or plan.config.tables != "fdtd" else ""
keep_missed = " || {{ code=$?; [ $code != 3 ] || mv {output} {output}.missed; exit $code; }}"


def grid(settings):
    """Command-line arguments of a table's range and tolerance."""
    return f"--u-max {settings.u_max} --v-max {settings.v_max} --tolerance {settings.tolerance}"


def flown(wildcards):
    """Tables that a scene flies on."""
    return checked(plan.tables, wildcards.scene)


def lit_by(wildcards):
    """Files that the beam of a scene is read from."""
    return checked(plan.scene, wildcards.scene).beam.files


def nodes(wildcards):
    """File of the directions that FDTD solves, once they are known."""
    return checkpoints.fdtd_nodes.get(design=wildcards.design).output


def fdtd_parts(wildcards):
    """Jobs that an FDTD table is split into; a candidate's as that of the design it varies."""
    kin = wildcards.get("family") and plan.scene(family(wildcards.family).scene).sail.designs
    return max(map(plan.fdtd_parts, kin)) if kin else checked(plan.fdtd_parts, wildcards.design)


def basin_parts(wildcards):
    """Jobs that a basin map is split into; a candidate's as that of the scene it varies."""
    scene = family(wildcards.family).scene if wildcards.get("family") else wildcards.scene
    return checked(plan.basin_parts, scene)


def screening_parts(wildcards):
    """Jobs that the cells of a family are split into."""
    made = family(wildcards.family)
    return plan.screening_parts(made.most_cells, made.orders)


def labelled(scenes, file):
    """NAME=FILE of each scene, for a script's command line."""
    return [f"{scene}=results/scenes/{scene}/{file}" for scene in scenes]


wildcard_constraints:
    design=r"[A-Za-z0-9_][A-Za-z0-9_.-]*",  # as names are (optics.files): no folder above, none that is hidden
    scene=r"[A-Za-z0-9_][A-Za-z0-9_.-]*",
    part=r"\d+",


# Jobs that start together would compile the same kernels each. Where there are many of them, on a cluster, its profile sets
# BEAMRIDER_COMPILE_FIRST, and all wait for this: minutes, for every kernel there is. One file for each state of the kernels:
# results do not depend on it, and another state's counts for nothing.
MACHINE_CODE = f"results/machine_code/{digest_of_kernels()}.txt"


rule machine_code:
    input:
        scene="workflow/scenes/fig6.yaml",
    output:
        MACHINE_CODE,
    log:
        "results/logs/machine_code.log",
    benchmark:
        "results/benchmarks/machine_code.tsv"
    priority: 110
    threads: 1
    resources:
        mem_mb=2500,
        runtime=30,
    message:
        "Machine code of flights"
    shell:
        "python -m workflow.machine_code --out {output} > {log} 2>&1"
