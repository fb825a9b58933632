"""The command `python -m dynamics.merit`: see `dynamics.stability.merit`."""

from beamrider.io.files import run_stage
from dynamics.stability.merit import main

if __name__ == "__main__":
    run_stage(main)
