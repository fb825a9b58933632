"""The command `python -m optics.modal`: see `optics.modal.stage`."""

from beamrider.io.files import run_stage
from optics.modal.stage import main

if __name__ == "__main__":
    run_stage(main)
