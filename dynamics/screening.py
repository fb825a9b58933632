"""The command `python -m dynamics.screening`: see `dynamics.stability.screening`."""

from beamrider.io.files import run_stage
from dynamics.stability.screening import main

if __name__ == "__main__":
    run_stage(main)
