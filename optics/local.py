"""The command `python -m optics.local`: see `optics.modal.normal_incidence`."""

from beamrider.io.files import run_stage
from optics.modal.normal_incidence import main

if __name__ == "__main__":
    run_stage(main)
