"""Basin maps: the same numbers however they are cut, the symmetry of the sail, and what counts as lost."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beamrider.io.files import InputError
from dynamics.rigid import basin
from dynamics.rigid import stage as rigid
from dynamics.rigid.basin import Grid
from dynamics.rigid.stage import REASONS
from dynamics.scene.schema import read_scene
from tests.membranes import altered
from tests.payloads import behind, ring
from tests.synthetic import smooth_tables

FIG6 = read_scene(Path(__file__).parents[3] / "workflow" / "scenes" / "fig6.yaml")
TABLES = smooth_tables()
GRID = Grid(offsets_m=[0.0, 0.1], n_offsets=2, tilts_deg=[-3.0, 3.0], n_tilts=3, duration_s=0.02)


def flown(grid: Grid, sign: float = 1.0) -> basin.Basin:
    return basin.fly_cells(FIG6, smooth_tables(sign), grid, basin.block_cells(grid, (1, 1)))


def test_blocks_put_together_are_the_map_to_the_bit(tmp_path: Path):
    whole, paths = flown(GRID), []
    for i in (2, 1):
        part = basin.fly_cells(FIG6, TABLES, GRID, basin.block_cells(GRID, (i, 2)))
        paths.append(tmp_path / f"part{i}.h5")
        basin.write(paths[-1], part, FIG6, TABLES, GRID)
    merged = basin.merge(paths, FIG6, TABLES, GRID)
    assert np.array_equal(merged.cells, whole.cells)
    for name, values in whole.columns.items():
        assert np.array_equal(merged.columns[name], values)
    with pytest.raises(InputError, match="3 flights of 6: give every block once"):
        basin.merge(paths[:1], FIG6, TABLES, GRID)
    with pytest.raises(InputError, match="belongs to another scene, grid or tables"):
        basin.merge(paths, FIG6, TABLES, GRID.model_copy(update={"duration_s": 0.03}))


@pytest.mark.parametrize("payload", [[], [behind(1e-4, 0.3, ring(3, 0.3, 400.0))]])
def test_a_cell_is_the_flight_of_its_release(payload: list[dict[str, Any]]):
    """Offset and tilt of the paper's release: 45° both, 5 cm √2 and 2° √2."""
    scene = altered(FIG6, payload=payload)
    grid = Grid(
        offsets_m=[0.05 * np.sqrt(2.0)] * 2, n_offsets=1, tilts_deg=[2.0 * np.sqrt(2.0)] * 2, n_tilts=1, duration_s=0.02
    )
    release = grid.release(0, -120.0)
    assert np.allclose(release.offset_m, FIG6.release.offset_m)
    assert np.allclose([release.pitch_deg, release.roll_deg], 2.0)
    released = altered(scene, rigid={"duration_s": 0.02, "output_Hz": 1e5}, release=release.model_dump())
    flight = rigid.fly(released, TABLES)
    cell = basin.fly_cells(scene, smooth_tables(), grid, basin.block_cells(grid, (1, 1))).columns
    assert cell["distance_max"][0] == pytest.approx(np.hypot(*flight.position[:, :2].T).max(), rel=1e-3)
    assert cell["tilt_max"][0] == pytest.approx(np.arccos(flight.rotation[:, 2, 2]).max(), rel=1e-2)
    assert cell["steps"][0] == flight.steps


def test_half_a_turn_of_the_release_ends_alike():
    """The sail is its own image after half a turn: on the axis, opposite tilts are the same flight."""
    columns = {name: values.reshape(2, 3) for name, values in flown(GRID).columns.items()}
    for name in ("end_time", "end_code", "distance_max", "tilt_max"):
        assert np.allclose(columns[name][0, 0], columns[name][0, 2], rtol=1e-6, atol=1e-9)
    assert columns["distance_max"][0, 1] < 1e-15


def test_a_sail_that_is_pushed_out_is_lost_at_the_limit():
    grid = GRID.model_copy(update={"limit_m": 0.12, "duration_s": 1.0})
    columns = flown(grid, sign=-1.0).columns
    lost = columns["end_code"] == REASONS.index("fly_away")
    assert lost[3:].all()
    assert columns["distance_max"][lost] == pytest.approx(0.12, abs=1e-9)
    assert (columns["end_time"][lost] < 1.0).all()
