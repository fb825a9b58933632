"""Figures of merit against Table 1 of Gao, Kelzenberg & Atwater, and the formulae against the laws they come from."""

import csv
import sys

import numpy as np
import pytest
from scipy.optimize import brentq

from dynamics.stability import merit

# Computed by hand from the inputs as printed: thickness in nm, burst diameter in m, spin limit in Hz.
COMPUTED = {
    ("silicon (111)", "Table 1"): (42.9, 1.26, 132.7),
    ("diamond, nano", "Table 1"): (39.7, 4.29, 250.0),
    ("diamond, nano", "Table S1"): (30.6, 1.80, 179.0),
    ("tempered glass", "Table 1"): (41.3, 0.657, 90.4),
    ("silicon nitride", "Table 1"): (37.0, 4.74, 214.8),
    ("MoS2, bilayer", "Table 1"): (19.9, 16.1, 285.0),
    ("aluminium", "Table 1"): (35.7, 0.178, 58.4),
    ("polyimide", "Table 1"): (70.4, 0.096, 30.4),
}


@pytest.mark.parametrize("entry", merit.TABLE, ids=lambda entry: f"{entry.material}, {entry.source}")
def test_burst_and_spin_follow_from_the_balance_of_forces(entry):
    """At the burst diameter the stresses of a cap, from pressure and from stretching, meet at the strength."""
    film = merit.thickness(entry.density)
    radius = merit.burst_diameter(entry.young, entry.strength, entry.density, entry.poisson) / 2.0

    def mismatch(height):
        stretched = entry.young / (1.0 - entry.poisson) * 2.0 / 3.0 * (height / radius) ** 2
        return merit.PRESSURE * radius**2 / (4.0 * height * film) - stretched

    height = brentq(mismatch, 1e-6 * radius, radius, xtol=1e-15, rtol=1e-14)
    assert merit.PRESSURE * radius**2 / (4.0 * height * film) == pytest.approx(entry.strength, rel=1e-9)
    omega = 2.0 * np.pi * merit.spin_limit(entry.strength, entry.density, entry.poisson)
    stress = (3.0 + entry.poisson) / 8.0 * entry.density * omega**2 * merit.AREA / np.pi
    assert stress == pytest.approx(entry.strength, rel=1e-12)


def test_table_holds_the_computed_and_the_printed_values(tmp_path, monkeypatch):
    out = tmp_path / "merit.csv"
    monkeypatch.setattr(sys, "argv", ["merit", "--out", str(out)])
    merit.main()
    with open(out, encoding="utf-8") as stream:
        rows = {(row["material"], row["inputs"]): row for row in csv.DictReader(stream)}
    assert set(COMPUTED) <= set(rows)
    for key, want in COMPUTED.items():
        found = [float(rows[key][name]) for name in ("thickness_nm", "burst_diameter_m", "spin_limit_Hz")]
        assert found == pytest.approx(want, rel=5e-3)
    for row in rows.values():
        if row["remark"] == merit.SAME:
            for name, allowed in (("thickness_nm", 0.02), ("burst_diameter_m", 0.05), ("spin_limit_Hz", 0.03)):
                assert float(row[name]) == pytest.approx(float(row[f"printed_{name}"]), rel=allowed)
