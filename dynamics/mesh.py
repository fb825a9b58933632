"""The command `python -m dynamics.mesh`: see `dynamics.sail.mesh`."""

from beamrider.io.files import run_stage
from dynamics.sail.mesh import main

if __name__ == "__main__":
    run_stage(main)
