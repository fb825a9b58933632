"""The command `python -m dynamics.membrane`: see `dynamics.membrane.stage`."""

from beamrider.io.files import run_stage
from dynamics.membrane.stage import main

if __name__ == "__main__":
    run_stage(main)
