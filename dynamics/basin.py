"""The command `python -m dynamics.basin`: see `dynamics.rigid.basin`."""

from beamrider.io.files import run_stage
from dynamics.rigid.basin import main

if __name__ == "__main__":
    run_stage(main)
