"""What all rules share: the checked configuration, the keys of what they make, one thread a job."""

import atexit
import os
import sys
from pathlib import Path

from snakemake.logging import logger

# The project's own modules are those beside this workflow, whichever copy of it is installed.
sys.path.insert(0, workflow.basedir)

from optics.files import InputError
from optics.sources import digest_of
from workflow.configuration import SOURCE, link_program, read_config, read_plan
from workflow.keys import WHOLE_GRAPH, Keys
from workflow.ledger import Ledger

# Jobs run the Python that runs Snakemake, each on one core, and import the modules beside this workflow, as it does itself:
# a script's path begins with its own folder, not with that of the project.
os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [workflow.basedir, os.environ.get("PYTHONPATH")]))
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
# FDTD tables that no scene flies on check the modal ones, within the limits of workflow/checks.py: a miss is shown, and stops
# nothing.
accept_missed_fdtd = "--accept-missed" if plan.config.accept_missed or plan.config.tables != "fdtd" else ""
keep_missed = " || {{ code=$?; [ $code != 3 ] || mv {output} {output}.missed; exit $code; }}"


def grid(settings):
    """Command-line arguments of a table's range and tolerance."""
    return f"--u-max {settings.u_max} --v-max {settings.v_max} --tolerance {settings.tolerance}"


def flown(wildcards):
    """Tables that a scene flies on."""
    return checked(plan.tables, wildcards.scene)


def nodes(wildcards):
    """File of the directions that FDTD solves, once they are known."""
    return checkpoints.fdtd_nodes.get(design=wildcards.design).output


def labelled(scenes, file):
    """NAME=FILE of each scene, for a script's command line."""
    return [f"{scene}=results/scenes/{scene}/{file}" for scene in scenes]


wildcard_constraints:
    design=r"[A-Za-z0-9_.-]+",
    scene=r"[A-Za-z0-9_.-]+",
    part=r"\d+",
