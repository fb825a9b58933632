"""Compile what flights run, before the first of them: jobs that start together would each take minutes and 1 GB for it.

    python -m workflow.machine_code --out code.txt

Machine code is kept where `beamrider.machine_code.cache` says, for processors like the one that it was made on; others
make their own. Small sails fly for a moment, on made-up tables: kernels do not depend on the sail.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from beamrider.io.files import atomic, check_out, run_stage
from beamrider.machine_code.cache import digest
from beamrider.machine_code.notice import compiling
from dynamics.membrane import flight as membrane
from dynamics.rigid import basin
from dynamics.rigid import stage as rigid
from dynamics.scene.schema import Scene, read_scene
from dynamics.stability import floquet, maps
from optics.table.pressure_table import PressureTable

SCENE = Path(__file__).parent / "scenes" / "fig6.yaml"


def made_up(name: str) -> PressureTable:
    """A smooth pressure table that keeps a sail on its beam, of a made-up design."""
    u, v = np.linspace(-0.4, 0.4, 9), np.linspace(0.0, 0.4, 5)
    uu = np.broadcast_to(u[:, None], (u.size, v.size))
    q = np.stack([0.15 + uu, 0.0 * uu, 0.7 - 2.7 * uu])
    attrs = {"name": name, "wavelength_m": 1064e-9}
    return PressureTable(u, v, q, np.full(uu.shape, 1e-5), np.full(uu.shape, 1e-6), mirror_v=True, attrs=attrs)


def altered(scene: Scene, **groups: dict[str, Any]) -> Scene:
    """The scene with some keys of its groups replaced."""
    data = scene.model_dump()
    return Scene.model_validate(data | {name: data[name] | keys for name, keys in groups.items()})


def compile_all(scene: Scene) -> None:
    """Run every stage of motion for a moment: of rigid sails, and of flexible ones with either kind of steps."""
    tables = {name: made_up(name) for name in scene.sail.designs}
    scene = altered(scene, sail={"rings": 3}, rigid={"duration_s": 1e-3}, flight={"duration_s": 2e-4})
    floquet.analyse(scene, tables)
    maps.make_maps(scene, tables)
    basin.fly_cells(scene, tables, basin.Grid(duration_s=1e-3).over(scene.beam), [0])
    with tempfile.TemporaryDirectory() as folder:
        rigid.write(Path(folder) / "rigid.h5", rigid.fly(scene, tables), scene, tables)
    membrane.fly(scene, tables)
    steps = {"integrator": "corotating", "optics_every": 1, "heat_every": 1}
    membrane.fly(altered(scene, flight=steps), tables)


def main() -> None:
    """Compile what flights run."""
    parser = argparse.ArgumentParser(prog="python -m workflow.machine_code", description=main.__doc__)
    parser.add_argument("--out", required=True, help="text file to write, which names what was compiled")
    given = parser.parse_args()
    check_out(given.out)
    with compiling("1 min"):
        compile_all(read_scene(SCENE))
    with atomic(given.out) as temporary:
        Path(temporary).write_text(f"{digest()}\n", encoding="utf-8")


if __name__ == "__main__":
    run_stage(main)
