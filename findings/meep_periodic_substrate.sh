#!/bin/sh
# Meep 1.25 to 1.29 (Debian: apt-get install python3-meep): with a Bloch vector along x only, geometry is also repeated
# across y. A substrate drawn a little beyond the lower edge of the cell comes up again inside the absorber at the upper
# edge. Of glass nobody notices; one pixel of metal in there makes the fields grow without limit. `k_point` along x alone
# does not say otherwise: what helps is `ensure_periodicity=False`, or a block that ends at the edge of the cell.
#
# Prints the largest |E_y| after 40, 60 and 80 periods for a block that ends 1 pixel beyond the edge, with the default
# and without the repetition; exits 0 if the first grows a thousandfold and the second does not.
set -eu
PYTHON="${PYTHON:-python3}"
exec "$PYTHON" - <<'PY'
import sys
import meep as mp
import numpy as np

assert mp.__version__.startswith(("1.25", "1.26", "1.27", "1.28", "1.29")), mp.__version__
mp.verbosity(0)
F, N, NY, PML = 2.0, 11, 54, 17
PIXEL = 0.18 / N
drude = [mp.DrudeSusceptibility(frequency=F, gamma=g, sigma=s) for g, s in ((0.0, 8.2), (F, 1.57))]
silver = mp.Medium(epsilon=1.08, E_susceptibilities=drude)  # about -7.6 + 0.7i at this frequency


def largest(**settings):
    """Largest |E_y| after 40, 60 and 80 periods."""
    low, high = -NY / 2 - 1, -6  # one pixel beyond the edge
    block = mp.Block(
        size=mp.Vector3(mp.inf, (high - low) * PIXEL, mp.inf), center=mp.Vector3(0, (high + low) / 2 * PIXEL),
        material=silver,
    )
    ridge = mp.Block(size=mp.Vector3(4 * PIXEL, 5 * PIXEL, mp.inf), center=mp.Vector3(0, -3.5 * PIXEL), material=silver)
    source = mp.Source(
        mp.GaussianSource(F, fwidth=0.2 * F, cutoff=4), mp.Ex, center=mp.Vector3(0, 8 * PIXEL),
        size=mp.Vector3(N * PIXEL),
    )
    simulation = mp.Simulation(
        cell_size=mp.Vector3(N * PIXEL, NY * PIXEL), resolution=1 / PIXEL, dimensions=2, geometry=[block, ridge],
        sources=[source], boundary_layers=[mp.PML(PML * PIXEL, direction=mp.Y, mean_stretch=2.0)], Courant=0.65,
        k_point=mp.Vector3(), eps_averaging=False, **settings,
    )
    found = []
    for periods in (40, 60, 80):
        simulation.run(until=periods / F - simulation.meep_time() if simulation.fields else periods / F)
        found.append(float(np.abs(simulation.get_array(mp.Ey, center=mp.Vector3(), size=simulation.cell_size)).max()))
    return found


repeated, once = largest(), largest(ensure_periodicity=False)
print("geometry repeated across y (default):", ["%.1e" % e for e in repeated])
print("ensure_periodicity=False:            ", ["%.1e" % e for e in once])
sys.exit(not (repeated[-1] > 1e3 * repeated[0] and once[-1] <= 10 * max(once[0], 1e-6)))
PY
