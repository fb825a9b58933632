"""The command `python -m dynamics.scene`: see `dynamics.membrane.plan`."""

from beamrider.io.files import run_stage
from dynamics.membrane.plan import main

if __name__ == "__main__":
    run_stage(main)
