"""The command `python -m optics.nodes`: see `optics.fdtd.nodes`."""

from beamrider.io.files import run_stage
from optics.fdtd.nodes import main

if __name__ == "__main__":
    run_stage(main)
