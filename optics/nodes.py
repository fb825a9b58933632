"""The command `python -m optics.nodes`: see `optics.modal.fdtd_directions`."""

from beamrider.io.files import run_stage
from optics.modal.fdtd_directions import main

if __name__ == "__main__":
    run_stage(main)
