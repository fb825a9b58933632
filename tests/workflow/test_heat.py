"""Where a heated sail is taut again: the search, and the scenes that it flies."""

from dataclasses import replace
from pathlib import Path

import pytest

from beamrider.io.files import InputError
from dynamics.sail.masses import designed
from dynamics.scene.schema import read_scene
from tests.synthetic import smooth_tables
from workflow import heat

FIG6 = read_scene(Path(__file__).parents[2] / "workflow" / "scenes" / "fig6.yaml")


def flown(edge):
    """A sail that is slack above an edge."""
    return lambda value: {"value": value, "slack": 0.2 if value > edge else 0.0}


@pytest.mark.parametrize("edge", [0.31, 0.7, 0.99])
def test_the_edge_is_found_from_the_side_that_is_taut(edge):
    found = heat.bisect(flown(edge), 0.1, 1.0)["value"]
    assert edge - 0.9 / 2**heat.HALVINGS <= found <= edge


def test_a_range_without_a_taut_sail_is_refused():
    with pytest.raises(InputError, match=r"at 0\.1 the sail is still slack over 0\.2 of its area"):
        heat.bisect(flown(0.05), 0.1, 1.0)


def test_variants_change_what_they_say_and_keep_the_masses(te, tm):
    cells = {"mark1e_te": te, "mark1e_tm": tm}
    tables = {n: replace(t, attrs={**t.attrs, "cell": cells[n].model_dump()}) for n, t in smooth_tables().items()}
    one = heat.variant(FIG6, "material", "membrane", share=0.5, emissivity=0.3)
    assert (one.absorptance, one.flight.in_plane, one.beam.intensity_W_m2) == ("material", "membrane", 5e8)
    assert {s.properties.emissivity_back for s in one.sail.sectors} == {0.3}
    thickness = [[r.properties.thickness_m for r in designed(s, tables).sail.sectors] for s in (one, FIG6)]
    assert thickness[0] == thickness[1]
