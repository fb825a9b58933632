"""Tables of gratings on thick layers: directions at which the parts before and behind these are sampled.

Errors of the parts grow in the light between them, where a wave that runs along the layers comes back to itself, by
1/|1 − F_back ρ|. So the error of q is stated as that of the parts times their gain (`optics.waves.joined_parts.gain`)
at the very direction, scaled until it covers what is found at random directions against direct solutions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from beamrider.arrays import Floats
from beamrider.io.files import Stopwatch
from optics.cells.schema import as_stack
from optics.modal import lamellar
from optics.modal.parts import Parted, parity, part, scattering
from optics.modal.quantities import error_in_any, own_error, quantities
from optics.modal.steps import ModalCell, Slanted
from optics.modal.stretch import exact
from optics.modal.thick_fringes import thick_range
from optics.modal.truncation import LADDER, Chosen, Forces, finer_rungs, with_order
from optics.modal.windows import BEYOND, first_directions
from optics.refinement.forecast import announce, forecast, require_time
from optics.refinement.narrow_resonances import FINER, are_there, enough_orders, refine_with_resonances
from optics.refinement.regions import Refined, refine
from optics.refinement.samples import Samples, Solve, on_curves, start
from optics.table.lookup import lookup_many
from optics.table.resonances import Window
from optics.table.strips import rayleigh_curves
from optics.table.thick_membranes import GAIN, OWN, STOKES, Layers, Thick, with_thick
from optics.table.verification import cover, spread_evenly, stated
from optics.waves.incidence import AXES

# Modes that decay by so much across their layer don't see its far side.
_NEGLIGIBLE = 1e-5
# The parts are good to this share of the tolerance first, then to a part of that in each pass.
_SHARE, _FINER, _PASSES = 2.0, 0.3, 4
_STEP = 0.04  # between the first rows, and the first lines in v²
_BLOCK = 256  # directions that are worked on at a time
_COVERED = 0.985  # share of random directions that stated errors cover before those around the rest are raised
_LEAST = 1e-3  # no error is stated as less than this share of the tolerance
_AT = 0.99  # share of the directions that keep the tolerance
_MIXTURES = 8
_WITHIN = 8  # random directions in each patch


@dataclass(frozen=True)
class _Parts:
    """Solves for the parts of a cell, extrapolated where it is a staircase."""

    order: int
    fine: Parted
    half: Parted | None
    check: Callable[[], None]

    def __call__(self, u: Floats, v: Floats) -> Floats:
        """The parts (k, n_u, n_v) at u × v."""
        self.check()
        one = self._of(self.fine, u, v)
        return one if self.half is None else one + (one - self._of(self.half, u, v)) / 3

    def _of(self, of: Parted, u: Floats, v: Floats) -> Floats:
        found = [
            scattering(of, np.repeat(some, v.size), np.tile(v, some.size), self.order, _NEGLIGIBLE)
            for some in np.array_split(u, max(1, min(u.size, u.size * v.size // _BLOCK)))
        ]
        return np.concatenate(found, axis=1).reshape(-1, u.size, v.size)


@dataclass(frozen=True)
class Found:
    """What a table of a grating on thick layers holds: q and absorptance (20, ...) at its nodes and on its cut-offs.

    error, error_stokes (n_u, n_v): of q, the largest found around each node. reasons: why they are not smaller.
    """

    chosen: Chosen
    samples: Samples
    thick: Thick
    nodes: Floats
    on_curves: Floats
    error: Floats
    error_stokes: Floats
    reasons: tuple[str, ...]


def _parted(cell: ModalCell, least_nm: float, u_max: float) -> Parted:
    """The cell in solver units, parted by the layers of at least `least_nm`."""
    assert not isinstance(cell, Slanted)  # `optics.modal.thick_fringes` refuses them
    layers = thick_range(as_stack(cell), least_nm)
    assert layers is not None
    return part(lamellar.prepare(cell), *layers, u_max)


def _with_enough(chosen: Chosen, of: Parted) -> Chosen:
    """The same with so many orders that those followed in thick layers are among the exact ones."""
    for order in [n for n in LADDER if n >= chosen.order]:
        of_stretch = of.stack.stretch(order)
        held = np.ones(2 * order + 1, bool) if of_stretch is None else exact(of_stretch, 2 * order + 1)
        most = max(of.channels.highest, of.outputs.highest, of.sent.highest)
        if order > most and held[order - most : order + most + 1].all():
            break
    return chosen if order == chosen.order else with_order(chosen, order)


def layers_of(of: Parted, axis: str) -> Layers:
    """What look-ups know of a parted stack, for light along `axis`."""
    layers = [*of.chain, *([] if of.patterned_behind else of.behind)]
    front, back = of.lossless
    sides = [x for side in (of.channels, of.outputs, of.sent) for x in (side.first, 2 * side.count)]
    flags = [*sides, of.patterned_behind, not front, of.patterned_behind and not back, AXES[axis]]
    return Layers(
        np.sqrt(np.array([*(layer.background for layer in layers), of.stack.back], complex)),
        np.array([layer.thickness for layer in layers]),
        of.stack.pitch,
        of.stack.front_index,
        np.array(flags, dtype=np.int64),
    )


def _thick(refined: Refined, layers: Layers) -> Thick:
    """What look-ups join, its errors not yet known."""
    samples, found = refined.samples, refined.resonances if refined.resonances.count else None
    none = np.ones((samples.u.size, samples.v.size))
    return Thick(samples.nodes, samples.on_curves, samples.parity, none, none, layers, found)


@dataclass(frozen=True)
class _Truth:
    """At random directions u (n), v (n, m): what direct solutions give (20, n m), and their own errors (2, n m)."""

    u: Floats
    v: Floats
    exact: Floats
    orders: Floats

    @property
    def flat(self) -> tuple[Floats, Floats]:
        """The directions (n_directions,) one after the other."""
        return np.repeat(self.u, self.v.shape[1]), self.v.ravel()


def _truth(chosen: Chosen, u: Floats, v: Floats) -> _Truth:
    """Direct solutions at random directions over a window."""
    u, v = spread_evenly(u, v)
    exact, orders = [], []
    for x, y in zip(u[:, None], v, strict=True):
        response = chosen.solve(x, y)
        exact.append(quantities(response)[:, 0])
        orders.append(np.array(chosen.errors(x, y, Forces(response.q, response.q_stokes)))[:, 0])
    return _Truth(u, v, np.concatenate(exact, axis=1), np.concatenate(orders, axis=1))


def _looked_up(samples: Samples, thick: Thick, u: Floats, v: Floats) -> tuple[Floats, Floats]:
    """Quantities (20, n) and gain (n) of a table at directions u, v (n)."""
    own, stokes, gain = np.empty((u.size, 4)), np.empty((u.size, 16)), np.empty((u.size, 4))
    arrays = thick.arrays(samples.curves, samples.u, samples.v)
    for kind, out in ((OWN, own), (STOKES, stokes), (GAIN, gain)):
        lookup_many(with_thick(arrays, thick, kind), u, v, out)
    return np.concatenate([own, stokes], axis=1).T, gain[:, 0]


@dataclass(frozen=True)
class _Stated:
    """Errors (2, n_u, n_v) of the parts; the error of q that they state at 99 % of directions, and their gain there.

    by_orders: is it mostly that of the orders.
    """

    errors: Floats
    at_99: float
    gain: float
    by_orders: bool


def _state(truth: _Truth, refined: Refined, thick: Thick, tolerance: float) -> _Stated:
    """Errors of the parts that, times their gain, cover those of q."""
    samples, (u, v) = refined.samples, truth.flat
    values, gain = _looked_up(samples, thick, u, v)
    between = np.stack([own_error(truth.exact - values), error_in_any(truth.exact - values)])
    guess = np.repeat(refined.errors, 2, axis=0)
    ratio = between / gain / stated(guess, samples.u, samples.v, u, v)
    errors = guess * np.quantile(ratio, _COVERED, axis=1)[:, None, None]
    errors = errors + np.quantile(truth.orders / gain, _COVERED, axis=1)[:, None, None]
    least = _LEAST * tolerance / float(np.median(gain))
    errors = cover(errors, samples.u, samples.v, u, v, (between + truth.orders) / gain, least)
    at_99 = float(np.quantile(stated(errors, samples.u, samples.v, u, v)[0] * gain, _AT))
    by_orders = float(np.quantile(truth.orders[0], _AT)) > float(np.quantile(between[0], _AT))
    return _Stated(errors, at_99, float(np.quantile(gain, _AT)), by_orders)


def _largest(differences: Floats) -> Floats:
    """Largest error (...) of the parts (k, ...)."""
    return np.asarray(np.abs(differences).max(axis=0))


def _around_nodes(samples: Samples, thick: Thick, errors: Floats) -> Floats:
    """Largest stated error (2, n_u, n_v) of q at the nodes and at some directions in the patches around them."""
    rng, n_u, n_v = np.random.default_rng(0), samples.u.size - 1, samples.v.size - 1
    share = rng.random((2, _WITHIN, n_u, n_v))
    u = samples.u[:-1, None] + np.diff(samples.u)[:, None] * share[0]
    v = samples.v[:-1] + np.diff(samples.v) * share[1]
    gain = _looked_up(samples, thick, u.ravel(), v.ravel())[1].reshape(u.shape).max(axis=0)
    own = _looked_up(samples, thick, *(x.ravel() for x in np.meshgrid(samples.u, samples.v, indexing="ij")))[1]
    found = errors * own.reshape(n_u + 1, n_v + 1)
    corners = [(slice(a, n_u + a), slice(b, n_v + b)) for a in (0, 1) for b in (0, 1)]
    patch = gain * np.max([errors[:, i, j] for i, j in corners], axis=0)
    for i, j in corners:
        found[:, i, j] = np.maximum(found[:, i, j], patch)
    return found


def _seen(parts: _Parts) -> Solve:
    """A few mixtures of the parts (8, n_u, n_v), enough to see the poles that all of them have."""

    def mixed(u: Floats, v: Floats) -> Floats:
        found = parts(u, v)
        weights = np.random.default_rng(0).standard_normal((_MIXTURES, len(found)))
        return np.asarray(np.tensordot(weights / np.sqrt(len(found)), found, 1))

    return mixed


@dataclass(frozen=True)
class _Search:
    """A table being made: its orders, solver and samples; where narrow resonances of the parts are followed, if any."""

    chosen: Chosen
    parts: _Parts
    samples: Samples
    window: Window | None

    def refined(self, tolerance: float) -> Refined:
        """Samples from which the parts are interpolated well."""
        name = f"modal {self.chosen.cell.name}"
        if self.window is None:
            return refine(self.samples, tolerance, [_largest], name)
        finer = replace(self.parts, order=int(np.ceil(FINER * self.parts.order)))
        return refine_with_resonances(self.samples, self.window, finer, tolerance, [_largest], name)

    def with_order(self, order: int) -> _Search:
        """The same directions with other orders."""
        chosen, parts, old = with_order(self.chosen, order), replace(self.parts, order=order), self.samples
        on_them = on_curves(parts, old.curves, old.v, old.u[0], old.u[-1], old.parity.size)
        samples = replace(old, solve=parts, nodes=parts(old.u, old.v), on_curves=on_them)
        return replace(self, chosen=chosen, parts=parts, samples=samples)


def _start(chosen: Chosen, parts: _Parts, u_max: float, v_max: float, tolerance: float, most_minutes: float) -> _Search:
    """First directions, with more orders and more directions where there are narrow resonances in the parts.

    InputError where the table is forecast to take longer than `most_minutes`.
    """
    of = parts.fine
    pitch, front, back = of.stack.pitch, of.stack.front_index, float(np.sqrt(of.stack.back).real)
    indices = tuple(n for n in {front, *([back] if of.patterned_behind else [])} if n > v_max)
    curves, signs = rayleigh_curves(pitch, indices, -u_max, u_max, v_max), parity(of)
    u, v = first_directions(curves, u_max, v_max, _STEP)
    layers = len(of.front) + len(of.behind)
    announce(forecast(parts, u, v, len(curves), chosen.order, layers), chosen.cell.name, most_minutes)
    samples = start(parts, curves, u, v, signs, signs.size)
    reach = min(BEYOND, 0.9 * (float(np.sqrt(front**2 - v_max**2)) - u_max))
    window = Window(-u_max, u_max, reach, rayleigh_curves(pitch, indices, -u_max - reach, u_max + reach, v_max))
    many = replace(samples, u=first_directions(curves, u_max, v_max)[0])
    name = f"modal {chosen.cell.name}"
    if not are_there(_seen(parts), many, window, tolerance, name):
        return _Search(chosen, parts, samples, None)
    orders = finer_rungs(chosen.order)
    order = enough_orders(lambda n: _seen(replace(parts, order=n)), orders, many, window, tolerance, name)
    chosen, parts = with_order(chosen, order), replace(parts, order=order)
    samples = start(parts, curves, *first_directions(curves, u_max, v_max), signs, signs.size)
    return _Search(chosen, parts, samples, window)


def find(chosen: Chosen, least_nm: float, u_max: float, v_max: float, tolerance: float, most_minutes: float) -> Found:
    """Directions, and orders, with which look-ups keep `tolerance`; layers of at least `least_nm` are thick.

    InputError where that takes longer than `most_minutes`.
    """
    watch, cell = Stopwatch(), chosen.cell
    of = _parted(cell, least_nm, u_max)
    half = None if chosen.half is None else _parted(chosen.half, least_nm, u_max)
    chosen, layers = _with_enough(chosen, of), layers_of(of, cell.electric_axis)
    parts = _Parts(chosen.order, of, half, lambda: require_time(watch.cpu_seconds, cell.name, most_minutes))
    search = _start(chosen, parts, u_max, v_max, tolerance, most_minutes)
    truth, share = _truth(search.chosen, search.samples.u, search.samples.v), _SHARE
    for _ in range(_PASSES):
        refined = search.refined(share * tolerance)
        search, thick = replace(search, samples=refined.samples), _thick(refined, layers)
        found = _state(truth, refined, thick, tolerance)
        if found.at_99 <= tolerance:
            break
        if found.by_orders and search.chosen.order < LADDER[-1]:
            search = search.with_order(next(n for n in LADDER if n > search.chosen.order))
            truth = _truth(search.chosen, search.samples.u, search.samples.v)
        else:
            share *= _FINER
    reasons = (*search.chosen.reasons, *refined.reasons, f"errors of the parts grow {found.gain:.0f} times in between")
    return _whole(search.chosen, refined, replace(thick, error=found.errors[0], error_stokes=found.errors[1]), reasons)


def _whole(chosen: Chosen, refined: Refined, thick: Thick, reasons: tuple[str, ...]) -> Found:
    """What the table holds besides."""
    samples = refined.samples
    uu, vv = np.meshgrid(samples.u, samples.v, indexing="ij")
    nodes = thick.layers.join(uu.ravel(), vv.ravel(), samples.nodes.reshape(len(samples.nodes), -1))
    at, on_them = samples.curves.u(samples.v), np.full((len(nodes), len(samples.curves), samples.v.size), np.nan)
    held = np.isfinite(samples.on_curves).all(axis=0)
    lines = np.broadcast_to(samples.v, at.shape)
    on_them[:, held] = thick.layers.join(at[held], lines[held], samples.on_curves[:, held])
    errors = _around_nodes(samples, thick, np.stack([thick.error, thick.error_stokes]))
    return Found(chosen, samples, thick, nodes.reshape(-1, *uu.shape), on_them, errors[0], errors[1], reasons)
