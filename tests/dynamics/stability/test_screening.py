"""Screening: the numbers of the stability analysis of each scene, and a ranking that knows no job split."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from beamrider.io.files import InputError
from dynamics.scene import schema as scene
from dynamics.stability import floquet, screening
from optics.table.normal_incidence import NormalResponse
from optics.table.pressure_table import PressureTable
from tests.families import many_cells, many_members
from tests.synthetic import smooth_tables

FIG6 = scene.read_scene(Path(__file__).parents[3] / "workflow" / "scenes" / "fig6.yaml")


def as_scene(member: pd.Series) -> scene.Scene:
    """The scene that a member stands for."""
    data = FIG6.model_dump(exclude_none=True)
    half = float(member["sail.sector_deg"]) / 2
    for sector, start in zip(data["sail"]["sectors"], (half, 180 - half, 180 + half, 360 - half), strict=True):
        sector["from_deg"] = start
    data["beam"]["radius_m"] = float(member["sail.beam_radius_m"])
    data["release"]["spin_Hz"] = float(member["sail.spin_Hz"])
    return scene.Scene.model_validate(data)


def table_of(cell: pd.Series, like: PressureTable) -> PressureTable:
    """A table that notes a cell's response."""
    q = np.array([cell["q_g"], 0.0, cell["q_n"]])
    gradient = np.array([[cell["q_g_u"], 0.0], [0.0, cell["absorptance"]], [cell["q_n_u"], 0.0]])
    noted = NormalResponse(q, gradient, np.zeros(3), np.zeros((3, 2)))
    return PressureTable(
        like.u,
        like.v,
        like.q_nodes,
        like.absorptance_nodes,
        like.error,
        mirror_v=True,
        attrs={**like.attrs, "normal_incidence": noted.as_dict()},
    )


def test_members_have_the_margins_of_their_scenes():
    members, cells = many_members(3), many_cells(3)
    found = screening.screen(FIG6, members, cells)
    tables = smooth_tables()
    for _, member in found[found["verdict"] != "impossible"].iterrows():
        mine = {
            design: table_of(cells.loc[int(member[f"{group}_cell"])], tables[design])
            for group, design in (("te", "mark1e_te"), ("tm", "mark1e_tm"))
        }
        want = floquet.analyse(as_scene(member), mine)
        assert member["margin_1_s"] == pytest.approx(want.margin, rel=1e-6)
        assert member["growth_1_s"] * want.model.period > -1e-12
        assert np.exp(member["growth_1_s"] / abs(member["sail.spin_Hz"])) == pytest.approx(want.max_modulus, rel=1e-9)
        report = floquet.report(as_scene(member), mine, want)
        assert member["thrust_N"] == pytest.approx(report["thrust_N"], rel=1e-9)
        assert member["tau_x_roll"] == pytest.approx(want.model.jacobian[2, 2], rel=1e-9)
        assert member["acceleration_m_s2"] == pytest.approx(member["thrust_N"] / member["mass_kg"])
    assert (found["verdict"] == "impossible").sum() == 3


def test_ranking_does_not_know_how_the_work_was_split():
    members, cells = many_members(12), many_cells(12)
    whole = screening.rank(screening.screen(FIG6, members, cells), "margin_1_s", ["thrust_N"])
    for chunk, blocks in ((7, 5), (50, 3)):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(screening, "CHUNK", chunk)
            shuffled = pd.concat([cells.iloc[k::blocks] for k in range(blocks)][::-1], ignore_index=True)
            split = screening.rank(screening.screen(FIG6, members, shuffled), "margin_1_s", ["thrust_N"])
        pd.testing.assert_frame_equal(split, whole, check_exact=True)


def test_rank_counts_survivors_the_eligible_first_and_failures_not_at_all():
    screened = pd.DataFrame(
        {
            "verdict": ["marginally_stable", "unstable", "marginally_stable", "undecided", "marginally_stable"],
            "margin_1_s": [1.0, -3.0, 5.0, 0.1, 2.0],
            "thrust_N": [0.3, 0.9, 0.2, 0.3, 0.4],
            "acceleration_m_s2": [3.0, 9.0, 2.0, 3.0, 4.0],
        }
    )
    ranked = screening.rank(screened, "margin_1_s", ["thrust_N"])
    assert ranked["rank"].tolist() == [1, -1, 2, -1, 0]
    assert ranked["eligible"].tolist() == [True, False, False, False, True]
    assert screening.rank(screened, "thrust_N", [])["rank"].tolist() == [1, -1, 2, -1, 0]


def test_members_of_a_cell_without_a_limit_are_unresolved_and_never_ranked():
    """Whatever its numbers and errors say: R = 0.23, 1.00, 0.77, 0.37, 0.90 at 20, 21, 40, 80, 150 orders."""
    members, cells = many_members(6), many_cells(6)
    before = screening.rank(screening.screen(FIG6, members, cells), "margin_1_s", [])
    loser = 0
    cells.loc[cells["cell"] == loser, "resolved"] = False
    after = screening.rank(screening.screen(FIG6, members, cells), "margin_1_s", [])
    touched = after["te_cell"] == loser
    assert set(after["verdict"][touched]) <= {"unresolved", "impossible"}
    assert (after["verdict"][touched] == "unresolved").sum() == 5
    assert not (after["verdict"][~touched] == "unresolved").any()
    assert (after["rank"][touched] == -1).all()
    assert (after["verdict"][~touched] == before["verdict"][~touched]).all()


def test_a_missing_block_is_refused():
    with pytest.raises(InputError, match="--cells: cell 2 is missing; give every block of the family's cells"):
        screening.screen(FIG6, many_members(2), many_cells(2).drop(index=2))
