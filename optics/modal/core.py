"""A grating's patterned part between orders of admittance 1: smooth in direction, and closed at each of them.

What is not smooth in a grating's response comes from outside its patterned part: cut-offs are branch points of the
admittances in front and behind, and narrow resonances are waves that are guided along, reflected at the surfaces of the
membrane. Let every order that may run anywhere, a channel, see a medium whose admittance is 1 (as beside thick layers,
`optics.modal.parts`), and all other orders, which decay everywhere, what lies there in truth. Nothing is then guided
for long, and the scattering matrix of the channels

    [f₋ in front, f₊ behind] = S [f₊ in front, f₋ behind]

is bounded by 1 and so smooth in u and v that a few hundred solutions give its Chebyshev series to rounding (Trefethen,
Approximation Theory and Approximation Practice, SIAM 2013, chapter 8: errors fall geometrically). A direction is closed
by what its channels see in truth, f₊ = s + ρ_front f₋ in front and f₋ = ρ_back f₊ behind, in which cut-offs and layers
without ridges are exact: four unknowns a channel, instead of eigenproblems and systems of all orders.

S at −v is S at v with the signs of all x components turned: its blocks of x and x or y and y are even in v.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.polynomial.chebyshev import chebpts1, chebvander

from beamrider.arrays import Complexes, Floats
from optics.modal import lamellar
from optics.modal.parts import Orders, phases, unit
from optics.modal.response import Response, parts_of, solve
from optics.modal.scattering import NEGLIGIBLE
from optics.modal.slanted import Products, Steps, climb_steps, products, products_of, steps, upside_down
from optics.modal.steps import ModalCell
from optics.modal.stretch import exact

# Channels, as a share of all orders, beyond which closing a direction is no faster than solving it.
_MOST_CHANNELS = 0.5
# Terms that are tried along u and, of one parity, along v; directions that a series may take.
_IN_U = (8, 11, 14, 17, 20, 23, 26, 30, 35, 41, 50, 60, 72, 86, 100)
_IN_V, _MOST = (4, 5, 6, 7, 8, 9, 10, 12, 14, 17, 20, 24, 30), 3000
_LAST = (2, 1)  # terms in u, and in v, whose size is the error of a series
_PROBE = 0.31  # where in the window series in one variable are tried
# How many times as many terms are foreseen from some, with how much room, and how many more are taken when too few.
_AHEAD, _ROOM, _LONGER, _FAINT = 2.5, 1.0, 1.1, 1e-16
_BLOCK = 128  # directions that are worked on together
# S is right to this share of a tolerance, and to so much, or else to a part of that.
_GOAL, _RIGHT, _FINER = 2e-3, 2e-6, 0.03
# Directions at which a core is compared with direct solutions, and the share of a tolerance that q may be off.
_CHECKED, _SHARE = 8, 0.01


def channels(stack: lamellar.Stack, order: int, u_max: float) -> Orders | None:
    """The orders that may run in front, behind or in the layers for |u| ≤ u_max; None where they are too many.

    Only those that a stretched basis holds but for rounding.
    """
    if stack.averaged:
        return None
    most = int(np.floor((stack.densest + u_max) / stack.pitch))
    within = stack.stretch(order)
    if within:
        held = exact(within, 2 * order + 1)[order:]
        most = min(most, int(np.argmin(np.append(held, False))) - 1)
    runs = int(np.floor((max(stack.front_index, np.sqrt(stack.back).real) + u_max) / stack.pitch))
    if most < runs or 2 * most + 1 > _MOST_CHANNELS * (2 * order + 1):
        return None
    return Orders(-most, 2 * most + 1)


@dataclass(frozen=True)
class _Sampler:
    """Solves for S of a stack with channels and orders −order … order."""

    stack: lamellar.Stack
    of: Orders
    order: int

    @cached_property
    def _both_ways(self) -> list[tuple[Steps, Products]]:
        """Steps through a profile, and the same from behind."""
        cell = self.stack.slanted
        assert cell is not None
        turned = upside_down(steps(cell, self.order))
        g = cell.pitch * np.arange(-self.order, self.order + 1.0)
        return [(steps(cell, self.order), products(cell, self.order)), (turned, products_of(turned, g))]

    def __call__(self, u: Floats, v: Floats) -> Complexes:
        """S (n_u, n_v, 2, 2, 2, n, 2, 2, n) over u × v … as (n_u, n_v, 4n, 4n)."""
        uu, vv = np.repeat(u, v.size), np.tile(v, u.size)
        bases, starts, u_m = lamellar.plane_waves(self.stack, uu, self.order)
        c, source = self.of.among(self.order), unit(self.of, self.order, uu.size)
        y = lamellar.half_space(u_m, vv, complex(self.stack.front_index) ** 2)[1]
        front, back = (1 - y) / (1 + y), lamellar.tail(self.stack.behind, self.stack.back, u_m, vv)[0]
        near, far = (self._closed(rho, u_m, vv) for rho in (front, back))
        modes = [[lamellar.modes(layer, over) for layer in self.stack.patterned] for over in bases]
        found = []
        for turned, ends in ((False, (near, far)), (True, (far, near))):
            if self.stack.slanted:
                top, below = np.empty((uu.size, 2, *source.shape[1:]), complex), np.empty_like(source)
                climb_steps(*self._both_ways[turned], u_m, vv, *ends, source, top, below)
            else:
                way = -1 if turned else 1
                part, known = replace(self.stack, patterned=self.stack.patterned[::way]), [x[::way] for x in modes]
                top, below = lamellar.through_layers(part, bases, starts, vv, *ends, source, NEGLIGIBLE, known)
            found.append((top[:, 1][:, c], below[:, c]))
        (reflected, sent), (from_behind, forwards) = found
        whole = np.concatenate(
            [np.concatenate([reflected, forwards], axis=2), np.concatenate([sent, from_behind], axis=2)], axis=1
        )
        phase = np.tile(phases(bases, np.diff([*starts, uu.size]), self.order)[:, c[: self.of.count]], 4)
        return (phase[:, :, None] * whole / phase[:, None]).reshape(u.size, v.size, *whole.shape[1:])

    def _closed(self, rho: Complexes, u_m: Floats, v: Floats) -> Complexes:
        """ρ (n_d, n, 2, 2) that all orders see: 0 for the channels."""
        rho = rho.copy()
        rho[:, :, self.of.among(self.order)[: self.of.count]] = 0.0
        return lamellar.blocks(rho, u_m, v)


@dataclass(frozen=True)
class Core:
    """A stack with its channels, the directions |u|, |v| it holds for, and the series of S.

    even, odd (n_u, n_v, entries): coefficients over Chebyshev polynomials in u/u_max and v/v_max, even or odd ones, of
    the entries of S (4n, 4n) that `is_even` says are even in v, and of the others.
    """

    axis: str
    stack: lamellar.Stack
    of: Orders
    order: int
    reach: tuple[float, float]
    even: Complexes
    odd: Complexes

    def holds(self, u: Floats, v: Floats) -> bool:
        """Whether all directions u (n_u), v (n_v) are within its reach."""
        return bool((np.abs(u) <= self.reach[0]).all() and (np.abs(v) <= self.reach[1]).all())

    def solve(self, u: Floats, v: Floats) -> Response:
        """The response over directions u (n_u) × v (n_v)."""
        in_u, in_v = self._in_u(u), self._in_v(v)
        found, at_once = [], max(1, _BLOCK // v.size)
        for k in range(0, u.size, at_once):
            some = slice(k, k + at_once)
            parts = [
                np.matmul(x, _sum(in_u[some], c)).reshape(-1, c.shape[-1])
                for x, c in zip(in_v, (self.even, self.odd), strict=True)
            ]
            found.append(self._response(np.repeat(u[some], v.size), np.tile(v, u[some].size), parts))
        return _joined(found, (u.size, v.size))

    def solve_each(self, u: Floats, v: Floats) -> Response:
        """The response at single directions u, v (n): all its arrays (1, n, ...)."""
        in_u, in_v, found = self._in_u(u), self._in_v(v), []
        for k in range(0, u.size, _BLOCK):
            some = slice(k, k + _BLOCK)
            parts = [
                _sum(
                    (in_u[some, :, None] * x[some, None]).reshape(-1, x.shape[1] * in_u.shape[1]),
                    c.reshape(-1, c.shape[-1]),
                )
                for x, c in zip(in_v, (self.even, self.odd), strict=True)
            ]
            found.append(self._response(u[some], v[some], parts))
        return _joined(found, (1, u.size))

    def _in_u(self, u: Floats) -> Floats:
        return np.asarray(chebvander(u / self.reach[0], len(self.even) - 1))

    def _in_v(self, v: Floats) -> tuple[Floats, Floats]:
        every = chebvander(v / self.reach[1], 2 * self.even.shape[1] - 1)
        return np.ascontiguousarray(every[:, ::2]), np.ascontiguousarray(every[:, 1::2])

    def _response(self, u: Floats, v: Floats, entries: list[Complexes]) -> tuple[Floats, ...]:
        """Parts of a `Response` at directions u, v (n_d) from the even and odd entries (n_d, entries) of S."""
        even = is_even(self.of.count)
        s = np.empty((u.size, even.size), complex)
        s[:, even], s[:, ~even] = entries
        reflected, transmitted = _close(self.stack, self.of, u, v, s.reshape(u.size, 4 * self.of.count, -1))
        wide = [(0, 0), (0, 0), 2 * (self.order - self.of.highest,)]
        return parts_of(self.axis, self.stack, u, v, np.pad(reflected, wide), np.pad(transmitted, wide))


def is_even(count: int) -> np.ndarray:
    """Which entries ((4n)²,) of S are even in v."""
    sign = np.tile(np.repeat([-1.0, 1.0], count), 2)
    return np.asarray(np.outer(sign, sign).ravel() > 0)


def _sum(weights: Floats, coefficients: Complexes) -> Complexes:
    """Σ weight × coefficients (n_d, …), real weights (n_d, terms)."""
    flat = weights @ coefficients.reshape(len(coefficients), -1).view(float)
    return np.asarray(flat.view(complex).reshape(-1, *coefficients.shape[1:]))


def _joined(found: list[tuple[Floats, ...]], shape: tuple[int, int]) -> Response:
    parts = [np.concatenate(part) for part in zip(*found, strict=True)]
    return Response(*(part.reshape(*shape, *part.shape[1:]) for part in parts))


def _close(stack: lamellar.Stack, of: Orders, u: Floats, v: Floats, s: Complexes) -> tuple[Floats, Floats]:
    """Efficiencies (n_d, 4, n) of the channels, from S (n_d, 4n, 4n) and what lies around at directions u, v (n_d)."""
    u_m, m = u[:, None] + stack.pitch * (of.first + np.arange(of.count)), 2 * of.count
    y = lamellar.half_space(u_m, v, complex(stack.front_index) ** 2)[1]
    front = lamellar.blocks((1 - y) / (1 + y), u_m, v)
    rho, through = lamellar.tail(stack.behind, stack.back, u_m, v)
    back = lamellar.blocks(rho, u_m, v)
    e, h = lamellar.incident_light(u, v, of.highest, stack.front_index)
    system = np.empty_like(s)
    system[:, :m] = -lamellar.apply_blocks(front, s[:, :m])
    system[:, m:] = -lamellar.apply_blocks(back, s[:, m:])
    system[:, np.arange(2 * m), np.arange(2 * m)] += 1.0
    source = np.zeros((u.size, 2 * m, 2), complex)
    source[:, :m] = e + h - lamellar.apply_blocks(front, e - h)
    inwards = np.linalg.solve(system, source)
    outwards = s @ inwards
    top = np.stack([inwards[:, :m], outwards[:, :m]], axis=1)
    sent = lamellar.apply_blocks(lamellar.blocks(through, u_m, v), outwards[:, m:])
    return lamellar.outgoing(stack, u_m, v, (e, h), top, sent)


def _apart(s: Complexes) -> tuple[Complexes, Complexes]:
    """Even and odd entries (n_u, n_v, entries) of S (n_u, n_v, 4n, 4n)."""
    flat, even = s.reshape(*s.shape[:2], -1), is_even(s.shape[-1] // 4)
    return flat[..., even], flat[..., ~even]


def _series(s: Complexes, x: Floats, y: Floats) -> tuple[Complexes, Complexes]:
    """Coefficients of the even and odd entries from S at nodes x (n_u) × y (n_v) of Chebyshev's, y > 0."""
    in_u, in_v = np.linalg.inv(chebvander(x, x.size - 1)), chebvander(y, 2 * y.size - 1)
    even, odd = (
        np.ascontiguousarray(np.einsum("au,bv,uve->abe", in_u, np.linalg.inv(in_v[:, k::2]), part, optimize=True))
        for k, part in enumerate(_apart(s))
    )
    return even, odd


def _last(coefficients: Complexes, axis: int) -> float:
    """Size of the last terms along an axis."""
    return float(np.abs(np.moveaxis(coefficients, axis, 0)[-_LAST[axis] :]).max(initial=0.0))


def _terms(solve: Callable[[Floats, Floats], Complexes], reach: tuple[float, float], goal: float) -> list[int]:
    """Terms in u and, of one parity, in v whose last should be below `goal`; empty where no number of them may be.

    From few terms along one line, if they go on to fall as they did.
    """
    out = []
    for axis, ladder in enumerate((_IN_U, _IN_V)):
        k = 1
        while k < len(ladder):
            n = ladder[k]
            x, y = (chebpts1(n), np.array([_PROBE])) if axis == 0 else (np.array([_PROBE]), chebpts1(2 * n)[n:])
            parts = _series(solve(reach[0] * x, reach[1] * y), x, y)
            last = max(_last(part, axis) for part in parts)
            first = max(np.abs(part).max(initial=0.0) for part in parts)
            rate = np.log(max(first / max(last, _FAINT), 1.1)) / (n - _LAST[axis] / 2)
            needed = max(n + np.log(max(last, _FAINT) / goal) / rate, ladder[0])
            if needed <= _AHEAD * n:
                break
            k = max(k + 1, int(np.searchsorted(ladder, 1.6 * n)))
        at = int(np.searchsorted(ladder, (_ROOM if needed > n else 1.0) * needed))
        if k >= len(ladder) or at >= len(ladder):
            return []
        out.append(ladder[at])
    return out


def find_core(
    cell: ModalCell,
    order: int,
    reach: tuple[float, float],
    goal: float,
    go_on: Callable[[], None] = lambda: None,
    terms: list[int] | None = None,
) -> Core | None:
    """The core of a cell over |u|, |v| ≤ reach with S right to `goal`; None where it would be of no use.

    `go_on` is asked before every few solutions and may refuse. terms: as many as do, if that is known.
    """
    stack = lamellar.prepare(cell)
    of = channels(stack, order, reach[0])
    if of is None:
        return None
    solve = _Sampler(stack, of, order)

    def checked(u: Floats, v: Floats) -> Complexes:
        go_on()
        return solve(u, v)

    terms = terms or _terms(checked, reach, goal)
    while terms and np.prod(terms) <= _MOST:
        x, y = chebpts1(terms[0]), chebpts1(2 * terms[1])[terms[1] :]
        series = _series(np.concatenate([checked(reach[0] * a, reach[1] * y) for a in x[:, None]]), x, y)
        short = [max(_last(part, axis) for part in series) > goal for axis in (0, 1)]
        if not any(short):
            return Core(cell.electric_axis, stack, of, order, reach, *series)
        terms = [int(np.ceil(_LONGER * n)) + 1 if more else n for n, more in zip(terms, short, strict=True)]
    return None


@dataclass(frozen=True)
class Cores:
    """The cores of cells with various orders over |u|, |v| ≤ reach, found when they are first asked for.

    They are checked against direct solutions: q has to be right to `tolerance`. `go_on` may refuse.
    """

    reach: tuple[float, float]
    tolerance: float
    go_on: Callable[[], None] = lambda: None
    known: list[tuple[ModalCell, int, Core | None]] = field(default_factory=list)

    def of(self, cell: ModalCell, order: int) -> Core | None:
        """The core of a cell; None where it is of no use."""
        for other, n, core in self.known:
            if n == order and (other is cell or other == cell):
                return core
        goal = min(_GOAL * self.tolerance, _RIGHT)
        like = next((list(core.even.shape[:2]) for _, _, core in self.known if core), None)
        core = find_core(cell, order, self.reach, goal, self.go_on, like)
        if core and not self._right(cell, core):
            core = find_core(cell, order, self.reach, _FINER * goal, self.go_on)
            core = core if core and self._right(cell, core) else None
        self.known.append((cell, order, core))
        return core

    def _right(self, cell: ModalCell, core: Core) -> bool:
        """Whether q agrees with direct solutions at random directions."""
        share = np.random.default_rng(0).random((2, _CHECKED))
        u, v = self.reach[0] * (2 * (np.arange(_CHECKED) + share[0]) / _CHECKED - 1), self.reach[1] * share[1]
        found = core.solve_each(u, v).q_stokes[0]
        for i in range(_CHECKED):
            self.go_on()
            direct = solve(cell, u[i : i + 1], v[i : i + 1], core.order).q_stokes[0, 0]
            if not np.abs(direct - found[i]).max() <= _SHARE * self.tolerance:
                return False
        return True
