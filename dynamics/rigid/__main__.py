"""The command `python -m dynamics.rigid`: see `dynamics.rigid.stage`."""

from beamrider.io.files import run_stage
from dynamics.rigid.stage import main

if __name__ == "__main__":
    run_stage(main)
