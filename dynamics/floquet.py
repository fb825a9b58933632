"""The command `python -m dynamics.floquet`: see `dynamics.stability.floquet`."""

from beamrider.io.files import run_stage
from dynamics.stability.floquet import main

if __name__ == "__main__":
    run_stage(main)
