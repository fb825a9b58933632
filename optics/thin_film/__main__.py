"""The command `python -m optics.thin_film`: see `optics.thin_film.stage`."""

from beamrider.io.files import run_stage
from optics.thin_film.stage import main

if __name__ == "__main__":
    run_stage(main)
