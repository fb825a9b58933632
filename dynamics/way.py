"""The command `python -m dynamics.way`: see `dynamics.stability.way`."""

from beamrider.io.files import run_stage
from dynamics.stability.way import main

if __name__ == "__main__":
    run_stage(main)
