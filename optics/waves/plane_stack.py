"""Light in plane stacks: compiled functions on plain arrays, used through `optics.thin_film` and `optics.table.films`.

The two tangential fields are carried from the back to the front (Macleod, Thin-Film Optical Filters, ch. 2), scaled by
each layer's decay, so nothing overflows, whatever the thickness. Layers whose fringes are averaged part the stack: of
the powers that run to and fro in them only the sums are followed (Harbecke 1986, Appl. Phys. B 39, 165).
"""

from __future__ import annotations

import math

from numba import njit

from beamrider.arrays import Complexes, Floats, Integers

# At one interface: fields f and g, flux sent on and loss so far, in one arbitrary scale. s: f = E across the plane of
# incidence, g ∝ H; p: f = H across it, g ∝ E along the layer. Flux = Re(f g*); a wave along +n has g = y f. H rather
# than E for p keeps y = k_z/ε finite where k_z = 0.
Light = tuple[complex, complex, float, float]
Crossing = tuple[complex, float, float, complex]  # see _crossing
# Of a wave of power 1 that meets a part of the stack: power reflected, sent on, lost in the part, and what the part
# takes beyond 1 − reflected: in an absorbing medium the reflected wave interferes with the other one.
Powers = tuple[float, float, float, float]
_RUNS = 10.0  # a wave runs if its phase grows this many times as fast as it decays
RESCALE_EVERY = 8  # layers: even contrasts of 1e9 a layer stay far from overflow


@njit(cache=True, error_model="numpy")
def _square(z: complex) -> float:
    """|z|², without the root of abs."""
    return z.real * z.real + z.imag * z.imag


@njit(cache=True, error_model="numpy")
def normal(n: complex, s: float) -> complex:
    """k_z/k₀ = √((n − s)(n + s)) with both parts ≥ 0; the product keeps digits as s → n.

    Where k_z = 0 it is 1e-100 instead: the limit, as everything that follows is smooth there.
    """
    square = (n - s) * (n + s)
    if n.imag == 0:
        root = max(math.sqrt(abs(square.real)), 1e-100)
        return complex(0.0, root) if square.real < 0 else complex(root, 0.0)
    larger = max(math.sqrt((math.sqrt(_square(square)) + abs(square.real)) / 2), 1e-100)
    smaller = square.imag / (2 * larger)
    return complex(smaller, larger) if square.real < 0 else complex(larger, smaller)


@njit(cache=True, error_model="numpy")
def face(n: complex, s: float, p: bool) -> complex:
    """Admittance y of a half-space: g = y f of a wave along +n, for s or p light."""
    return normal(n, s) / (n * n) if p else normal(n, s)


@njit(cache=True, error_model="numpy")
def _crossing(k_z: complex, depth: float) -> Crossing:
    """Of φ = k_z d: h = (1 − exp(2iφ))/2, |exp(iφ)|², and two means over the layer that give its loss.

    Those are of the decay, and of the two waves' interference (complex). 1e-300 stands for 0: sin φ/φ has its limit.
    """
    real, imag = max(k_z.real * depth, 1e-300), 2 * max(k_z.imag * depth, 1e-300)
    sine, cosine = math.sin(real), math.cos(real)
    if k_z.imag == 0:
        return complex(sine * sine, -sine * cosine), 1.0, 1.0, 0j
    if imag < 0.7:  # each of the two from the function that keeps its digits
        drop = -math.expm1(-imag)
        decay = 1 - drop
    else:
        decay = math.exp(-imag)
        drop = 1 - decay
    half = complex(sine * sine + drop * (0.5 - sine * sine), -decay * sine * cosine)
    return half, decay, drop / imag, decay * sine / real * complex(cosine, -sine)


@njit(cache=True, error_model="numpy")
def _through(light: Light, y: complex, z: complex, loss_of_g: float, loss_of_f: float, crossing: Crossing) -> Light:
    """The light at the front of a layer with admittance y = 1/z, from the light at its back; scaled by |exp(iφ)|.

    cos φ and −i sin φ, scaled, are 1 − h and h: a layer of no depth changes no bit. The layer loses its mean of
    loss_of_g |g|² + loss_of_f |f|²; f = a exp(iφ) + b exp(−iφ) makes that two decays and their interference.
    """
    f, g, flux, loss = light
    half, decay, fading, mixing = crossing
    h = z * g
    loss *= decay
    if loss_of_f > 0 or loss_of_g > 0:
        plus, minus = f + h, f - h
        apart = fading * (_square(plus) + decay * _square(minus)) / 4
        mixed = (mixing * plus * minus.conjugate()).real / 2
        loss += loss_of_f * (apart + mixed) + loss_of_g * _square(y) * (apart - mixed)
    return f + half * (h - f), g + half * (y * f - g), decay * flux, loss


@njit(cache=True, error_model="numpy")
def _through_both(
    of_s: Light, of_p: Light, n: complex, depth: float, s: float, is_s: bool, is_p: bool
) -> tuple[Light, Light]:
    """`_through` a layer of depth k₀d for s and p light. Loss is Im ε ∫ |E|²; E of p light is g along, s f/ε across."""
    k_z, permittivity = normal(n, s), n * n
    inverse = k_z.conjugate() * (1 / _square(k_z))
    crossing = _crossing(k_z, depth)
    loss = permittivity.imag * depth
    if is_s:
        of_s = _through(of_s, k_z, inverse, 0.0, loss, crossing)
    if is_p:
        size = 1 / _square(permittivity)
        y, across = k_z * permittivity.conjugate() * size, loss * s * s * size
        of_p = _through(of_p, y, inverse * permittivity, loss, across, crossing)
    return of_s, of_p


@njit(cache=True, error_model="numpy")
def _rescaled(light: Light) -> Light:
    """The same light with fields of about 1, so that a long stack neither overflows nor underflows before it must."""
    f, g, flux, loss = light
    scale = 1 / (abs(f.real) + abs(f.imag) + abs(g.real) + abs(g.imag))
    return f * scale, g * scale, flux * scale * scale, loss * scale * scale


@njit(cache=True, error_model="numpy")
def _carried(
    index: Complexes, depth: Floats, first: int, last: int, s: float, is_s: bool, is_p: bool
) -> tuple[Light, Light]:
    """Light of s and of p at the face of medium `first` towards `last`, into which it goes; either may come first."""
    back_s, back_p = face(index[last], s, False), face(index[last], s, True)
    of_s, of_p = (1 + 0j, back_s, back_s.real, 0.0), (1 + 0j, back_p, back_p.real, 0.0)
    step = 1 if first > last else -1
    for i in range(last + step, first, step):
        of_s, of_p = _through_both(of_s, of_p, index[i], depth[i - 1], s, is_s, is_p)
        if i % RESCALE_EVERY == 0:
            of_s, of_p = _rescaled(of_s), _rescaled(of_p)
    return of_s, of_p


@njit(cache=True, error_model="numpy")
def _powers(light: Light, y: complex) -> Powers:
    """Powers of a wave in a medium of admittance y, from the light at the face it meets.

    With r = (y f − g)/(y f + g) the net flux is Re y (1 − |r|²) + 2 Im y Im r.
    """
    f, g, flux, loss = _rescaled(light)
    out = y * f - g
    sent = _square(y * f + g)
    if y.imag == 0.0:
        return _square(out) / sent, 4 * y.real * flux / sent, 4 * y.real * loss / sent, 0.0
    scale = 4 * _square(y) / (y.real * sent)
    r = out * (y * f + g).conjugate() / sent
    return _square(out) / sent, scale * flux, scale * loss, 2 * y.imag / y.real * r.imag


@njit(cache=True, error_model="numpy")
def _parting(index: Complexes, coherent: Integers, s: float, last: int) -> int:
    """The last medium before `last` in which powers, not fields, are followed: 0 is that in front.

    A wave that decays within some wavelengths makes no fringes, and the power of two such waves that run to and fro is
    not the sum of theirs: its layer is crossed as a coherent one.
    """
    for i in range(last - 1, 0, -1):
        if not coherent[i - 1]:
            k_z = normal(index[i], s)
            if k_z.real > _RUNS * k_z.imag:
                return i
    return 0


@njit(cache=True, error_model="numpy")
def _between(index: Complexes, depth: Floats, first: int, last: int, s: float, p: bool) -> Powers:
    """Powers of a wave in medium `first` that meets what lies between it and medium `last`."""
    of_s, of_p = _carried(index, depth, first, last, s, not p, p)
    return _powers(of_p if p else of_s, face(index[first], s, p))


@njit(cache=True, error_model="numpy")
def _joined(front: Powers, back: Powers, behind: Powers, once: float) -> Powers:
    """Powers of a layer between two parts: the one before seen from both sides, the one behind, 2 Im k_z d.

    The sum over all round trips. What it divides by, 1 − R_back P² R_behind, is summed from positive parts.
    """
    r_1, t_1, a_1, x_1 = front
    r_2, t_2, a_2, x_2 = back
    r_3, t_3, a_3, x_3 = behind
    passed, lost = math.exp(-once), -math.expm1(-once)
    open_back, open_behind = t_2 + a_2 - x_2, t_3 + a_3 - x_3
    leaving = open_back + r_2 * (-math.expm1(-2 * once) + passed * passed * open_behind)
    down = t_1 / leaving if t_1 > 0.0 else 0.0
    there = down * passed
    up = there * r_3 * passed
    lost_here = down * lost + there * r_3 * lost - there * x_3 - up * x_2
    return r_1 + up * t_2, there * t_3, a_1 + up * a_2 + lost_here + there * a_3, x_1


@njit(cache=True, error_model="numpy")
def _averaged(index: Complexes, depth: Floats, coherent: Integers, s: float, p: bool) -> Powers:
    """Powers of the whole stack for s or p light, fringes of layers that are not coherent averaged."""
    last = depth.size + 1
    first = _parting(index, coherent, s, last)
    behind = _between(index, depth, first, last, s, p)
    while first > 0:
        last, first = first, _parting(index, coherent, s, first)
        front, back = _between(index, depth, first, last, s, p), _between(index, depth, last, first, s, p)
        behind = _joined(front, back, behind, 2 * normal(index[last], s).imag * depth[last - 1])
    return behind


@njit(cache=True, error_model="numpy", forceinline=True)
def response(index: Complexes, depth: Floats, coherent: Integers, s: float, share: float) -> tuple[float, float, float]:
    """R, T, A of a stack: media (m,), depths k₀d (m − 2,), 1 for coherent layers, else 0 (m − 2,); share of p."""
    if coherent.sum() == coherent.size:
        of_s, of_p = _carried(index, depth, 0, depth.size + 1, s, share < 1, share > 0)
        r_s, t_s, a_s, _ = _powers(of_s, face(index[0], s, False))
        r_p, t_p, a_p, _ = _powers(of_p, face(index[0], s, True))
    else:
        r_s, t_s, a_s, _ = _averaged(index, depth, coherent, s, False)
        r_p, t_p, a_p, _ = _averaged(index, depth, coherent, s, True)
    return (1 - share) * r_s + share * r_p, (1 - share) * t_s + share * t_p, (1 - share) * a_s + share * a_p


@njit(cache=True, error_model="numpy", forceinline=True)
def reflected(index: Complexes, depth: Floats, s: float) -> tuple[complex, complex]:
    """Amplitudes r_s, r_p of a coherent stack: index (n + 2,) of layers and half-spaces, depth (n,)."""
    of_s, of_p = _carried(index, depth, 0, depth.size + 1, s, True, True)
    y_s, y_p = face(index[0], s, False), face(index[0], s, True)
    r_s = (y_s * of_s[0] - of_s[1]) / (y_s * of_s[0] + of_s[1])
    return r_s, (y_p * of_p[0] - of_p[1]) / (y_p * of_p[0] + of_p[1])


@njit(cache=True, error_model="numpy", forceinline=True)
def pressure(index: Complexes, depth: Floats, coherent: Integers, s: float, share: float) -> tuple[float, float, float]:
    """Q along k_t, q along n, and absorptance of light from the front; index (n + 2,), depth and coherent (n,).

    Momentum balance with the specular orders alone: A s along, w(1 + R) − w' T across (`optics.waves.momentum`). Light
    that enters an absorbing half-space stays there, its momentum and its power.
    """
    r, t, a = response(index, depth, coherent, s, share)
    far = index[-1]
    w, w_far = normal(index[0], s).real, normal(far, s).real
    if far.imag > 0.0:
        a, t = a + t, 0.0
    return a * s, w * (1 + r) - w_far * t, a


@njit(cache=True, error_model="numpy")
def respond_many(
    index: Complexes,
    of_index: Integers,
    depth: Floats,
    of_depth: Integers,
    coherent: Integers,
    s: Floats,
    share: Floats,
    out: Floats,
) -> None:
    """Out (3, n) = `response` for n directions: of stack index[of_index], depth[of_depth], at s, share (n,)."""
    for i in range(s.size):
        out[0, i], out[1, i], out[2, i] = response(index[of_index[i]], depth[of_depth[i]], coherent, s[i], share[i])


@njit(cache=True, error_model="numpy")
def reflect_many(
    index: Complexes, of_index: Integers, depth: Floats, of_depth: Integers, s: Floats, out: Complexes
) -> None:
    """Out (2, n) = `reflected` for n directions, as `respond_many`."""
    for i in range(s.size):
        out[0, i], out[1, i] = reflected(index[of_index[i]], depth[of_depth[i]], s[i])
