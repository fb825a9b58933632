"""What a flexible flight holds in memory."""

from __future__ import annotations

from pathlib import Path

import pytest

from dynamics.membrane.flight import Flight
from tests.membranes import FIG6, altered
from tests.synthetic import smooth_tables


@pytest.mark.parametrize("lit", [True, False])
def test_a_node_takes_less_than_a_kilobyte(tmp_path: Path, lit: bool):
    """With all that Fig. 6 calls for, and of the elastic sail alone; in larger ones the ends of rows count for less."""
    names = ("absorption", "emission", "conduction", "expansion", "thermal_failure")
    off = {} if lit else {"beam": {"intensity_W_m2": 0.0}, "effects": dict.fromkeys(names, False)}
    scene = altered(FIG6, **{"sail": {"rings": 60}, "flight": {"time_step_s": 1e-8}, **off})
    flight = Flight(scene, smooth_tables(), tmp_path)
    assert all(flight.membrane.plan[name].on == lit for name in names)
    assert flight.memory / flight.model.masses.size < (1000.0 if lit else 750.0)
