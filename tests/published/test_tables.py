"""The paper's cells against the COMSOL tables their authors published (Gao, Kelzenberg & Atwater).

Twenty directions, forty values, are written down here; with the whole data set at hand all directions are compared.
The published values carry the mesh error of the published simulation: 1e-3 in q_g, 4e-3 (TE) or 1e-3 (TM) in q_n.
"""

import numpy as np
import pytest

from optics.modal.stage import make_table, solve
from tests.published.reference import data_file, needs_reference

PUBLISHED = [  # cell, u, v, q_g, q_n
    ("te", 0.0, 0.0, 0.15211, 0.71935),
    ("te", -0.250406, -0.197657, -0.14620, 0.66631),
    ("te", -0.126690, 0.076719, -0.10104, 1.04562),
    ("te", -0.106217, -0.029666, -0.06670, 1.07019),
    ("te", -0.102466, 0.197657, -0.03761, 0.99612),
    ("te", -0.077823, -0.127065, 0.01281, 0.96396),
    ("te", -0.001741, -0.069756, 0.14875, 0.71246),
    ("te", 0.010460, -0.047106, 0.16413, 0.68883),
    ("te", 0.041646, -0.104528, 0.19813, 0.61283),
    ("te", 0.109113, 0.106264, 0.29283, 0.50027),
    ("tm", 0.0, 0.0, 0.14230, 0.23503),
    ("tm", -0.252069, 0.194585, -0.40281, 1.57596),
    ("tm", -0.120137, -0.031183, -0.24652, 0.63002),
    ("tm", -0.083678, 0.093778, 0.06332, 0.29320),
    ("tm", 0.008727, 0.097579, 0.14940, 0.23824),
    ("tm", 0.012217, 0.258800, 0.16897, 0.27623),
    ("tm", 0.020942, 0.292308, 0.18542, 0.29854),
    ("tm", 0.061049, 0.100868, 0.20076, 0.23660),
    ("tm", 0.076719, -0.121510, 0.22599, 0.23887),
    ("tm", 0.094108, 0.123053, 0.27656, 0.23831),
]


def test_forty_published_values(te, tm):
    cells = {"te": te, "tm": tm}
    q = np.array([solve(cells[name], np.array([u]), np.array([v]), 24).q[0, 0] for name, u, v, _, _ in PUBLISHED])
    lateral = np.abs(q[:, 0] - [row[3] for row in PUBLISHED])
    normal = np.abs(q[:, 2] - [row[4] for row in PUBLISHED])
    assert np.median(lateral) <= 0.0015
    assert np.median(normal) <= 0.005
    assert lateral.max() <= 0.01
    assert normal.max() <= 0.02


@needs_reference
@pytest.mark.parametrize("fixture", ["te", "tm"])
def test_whole_published_tables(fixture, request):
    """Every published direction, out to ±25°."""
    published = np.load(data_file())
    table = make_table(request.getfixturevalue(fixture), 0.4227, 0.4227, 4e-3)
    kind = fixture.upper()
    q = table.q(published[f"{kind}_u"], published[f"{kind}_v"])
    assert np.median(np.abs(q[:, 0] - published[f"{kind}_q_g"])) <= 0.0015
    assert np.median(np.abs(q[:, 2] - published[f"{kind}_q_n"])) <= 0.005
