"""The command `python -m dynamics.maps`: see `dynamics.stability.maps`."""

from beamrider.io.files import run_stage
from dynamics.stability.maps import main

if __name__ == "__main__":
    run_stage(main)
