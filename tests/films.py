"""Plane films at 50 digits: the transfer-matrix method as textbooks have it."""

import mpmath


def exact(index, thickness, wavelength, s, kind):
    """R, T and A = 1 − R − T (mpmath numbers, 50 digits) of a stack for 's' or 'p' light; all arguments as floats."""
    with mpmath.workdps(50):
        s = mpmath.mpf(s)
        n = [mpmath.mpmathify(complex(x)) for x in index]
        k = [mpmath.sqrt((a - s) * (a + s)) for a in n]
        k = [-a if a.imag < 0 else a for a in k]
        weight = [a**2 if kind == "p" else mpmath.mpf(1) for a in n]
        first, last = k[0] / weight[0], k[-1] / weight[-1]
        f, g = mpmath.mpc(1), last
        for i in range(len(thickness), 0, -1):
            depth = 2 * mpmath.pi * mpmath.mpf(thickness[i - 1]) / mpmath.mpf(wavelength)
            cosine, sine = mpmath.cos(k[i] * depth), mpmath.sin(k[i] * depth) / k[i] if k[i] != 0 else depth
            f, g = cosine * f - 1j * sine * weight[i] * g, cosine * g - 1j * k[i] ** 2 * sine / weight[i] * f
        scale = abs(first * f + g) ** 2
        r, t = abs(first * f - g) ** 2 / scale, 4 * first.real * last.real / scale
        return r, t, 1 - r - t
