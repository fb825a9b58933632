"""The command `python -m optics.fdtd`: see `optics.fdtd.stage`."""

from beamrider.io.files import run_stage
from optics.fdtd.stage import main

if __name__ == "__main__":
    run_stage(main)
