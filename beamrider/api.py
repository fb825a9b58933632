"""What a notebook imports from `beamrider`: cells, tables, scenes, and the stages as functions.

They are the functions of the commands, and give the same numbers. Tables are given as files or as they were solved.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import pandas as pd
from threadpoolctl import threadpool_limits

from beamrider.io.errors import InputError as InputError
from beamrider.machine_code.notice import compiling
from dynamics.membrane.flight import End
from dynamics.membrane.stage import fly_to, require_flyable
from dynamics.rigid import stage as rigid
from dynamics.sail.sectors import check_release, load_tables
from dynamics.scene.schema import Scene as Scene
from dynamics.scene.schema import read_scene as read_scene
from dynamics.stability import screening
from dynamics.stability.floquet import Stability, analyse
from optics.cells.schema import Cell as Cell
from optics.cells.schema import ThinFilm
from optics.cells.schema import read_cell as read_cell
from optics.modal import stage as modal
from optics.table.pressure_table import PressureTable as PressureTable
from optics.thin_film import stage as thin_film
from optics.waves.incidence import check_range

Tables = Iterable[str | Path | PressureTable]


def solve(
    cell: Cell, tolerance: float | None = None, u_max: float | None = None, v_max: float | None = None
) -> PressureTable:
    """The pressure table of a cell: of a film by the transfer matrix, of a grating by the Fourier modal method.

    tolerance: error of q that 99 % of the directions must keep. u_max, v_max: largest direction cosines of the light; a
    film has u alone. Without them those of the commands. InputError says what can't be.
    """
    front = cell.surroundings.front
    if isinstance(cell, ThinFilm):
        if v_max is not None:
            raise InputError(f"{cell.name}: v_max = {v_max:g}: must not be given for a film, which has u_max alone")
        check_range(front, u_max := u_max or thin_film.U_MAX)
        return thin_film.make_table(cell, u_max, tolerance or thin_film.TOLERANCE)
    u_max, v_max = u_max or modal.U_MAX, v_max or modal.U_MAX
    check_range(front, u_max, v_max)
    with threadpool_limits(1), compiling("20 s, or a minute on thick layers"):
        return modal.make_table(cell, u_max, v_max, tolerance or modal.TOLERANCE)


def stability(scene: Scene, tables: Tables) -> Stability:
    """Linear stability of a scene's spinning sail on the beam axis: multipliers, margin and verdict."""
    found = load_tables(tables, scene)
    with compiling("10 s"):
        return analyse(scene, found)


def fly(scene: Scene, tables: Tables, out: str | Path | None = None) -> rigid.RigidFlight:
    """Rigid flight of a scene's sail; written to an HDF5 file too, where one is named."""
    found = load_tables(tables, scene)
    check_release(scene, found)
    with compiling("1 min"):
        flight = rigid.fly(scene, found)
    if out is not None:
        rigid.write(out, flight, scene, found)
    return flight


def fly_flexible(scene: Scene, tables: Tables, out: str | Path, threads: int = 1) -> End:
    """Flexible flight of a scene's sail, written to a VTKHDF file; why and when it ended.

    One that was interrupted goes on where it was, when it is called again.
    """
    found = load_tables(tables, scene)
    require_flyable(scene, found)
    return fly_to(Path(out), scene, found, threads)[0]


def screen(
    scene: Scene, members: pd.DataFrame, cells: pd.DataFrame, by: str = "margin_1_s", at_least: Iterable[str] = ()
) -> pd.DataFrame:
    """Linear stability of the members of a family, with their rank by one of `screening.MEASURES`.

    members: a row a sail. cells: their cells' responses around normal incidence. at_least: measures in which they must
    be no worse than member 0.
    """
    return screening.rank(screening.screen(scene, members, cells), by, list(at_least))
