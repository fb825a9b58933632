"""The command `python -m dynamics.scene`: see `dynamics.scene.schema`."""

from beamrider.io.files import run_stage
from dynamics.scene.schema import main

if __name__ == "__main__":
    run_stage(main)
