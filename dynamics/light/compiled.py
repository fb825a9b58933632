"""What kernels know of a beam's profile: where its compiled functions are, and their numbers.

A profile's function is called by its address, for many places at once. So kernels are compiled once, whatever profiles
there are, and only the profiles that are flown are compiled at all. Coordinates are lengths across the beam in any
unit: a profile is packed for it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numba
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from beamrider.arrays import Floats, Integers

#: What stands before the profile's own numbers: share of the intensity, place of the middle, the quadratic form that
#: is 1 at the radius, and the lines of the matrix that takes the axes to the profile's, in its radii.
SHARE, X, Y, SQUARE, CROSS, MORE, UX, UY, VX, VY, OWN = range(11)

_POINTER = types.CPointer(types.float64)
_SIGNATURE = types.void(_POINTER, _POINTER, _POINTER, types.int64, _POINTER)


class Profile(NamedTuple):
    """Spots of light that add up to a beam.

    functions (k,): addresses, different in every process. numbers: of all spots, from starts (k + 1,) on for each.
    """

    functions: Integers
    starts: Integers
    numbers: Floats


@cache
def _compiled(function: Callable[..., None]) -> Any:
    return numba.cfunc(_SIGNATURE, cache=True, error_model="numpy")(function)


def address(function: Callable[..., None]) -> int:
    """Address of a profile's function (numbers, x, y, n, out), compiled when it is first asked for.

    It adds SHARE times its intensity, 1 at the brightest, to out (n,); all are pointers to float64.
    """
    return int(_compiled(function).address)


@numba.njit(cache=True, inline="always")
def squared(numbers: Floats, x: float, y: float) -> float:
    """Square of the distance from the middle of a spot (numbers (n,)) in its radii, along its axes."""
    dx, dy = x - numbers[X], y - numbers[Y]
    return numbers[SQUARE] * (dx * dx + dy * dy) + (numbers[CROSS] * dx + numbers[MORE] * dy) * dy


@intrinsic
def _call(
    typing: Any, function: Any, numbers: Any, start: Any, x: Any, y: Any, at: Any, n: Any, out: Any, begin: Any
) -> Any:
    """Call a profile's function on contiguous arrays, from a place of theirs on."""
    if any(not isinstance(a, types.Array) or a.layout != "C" for a in (numbers, x, y, out)):
        raise numba.core.errors.TypingError("contiguous arrays are needed")

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kinds = dict(enumerate(signature.args))

        def pointer(array: int, offset: int) -> Any:
            data = context.make_array(kinds[array])(context, builder, value=args[array]).data
            return builder.gep(data, [args[offset]])

        double, whole = ir.DoubleType().as_pointer(), ir.IntType(64)
        kind = ir.FunctionType(ir.VoidType(), [double, double, double, whole, double])
        where = builder.inttoptr(args[0], kind.as_pointer())
        builder.call(where, [pointer(1, 2), pointer(3, 5), pointer(4, 5), args[6], pointer(7, 8)])
        return context.get_dummy_value()

    i = types.int64
    return types.void(i, numbers, i, x, y, i, i, out, i), generate


@numba.njit(cache=True, error_model="numpy")
def shine(profile: Profile, x: Floats, y: Floats, at: int, n: int, out: Floats, begin: int) -> None:
    """Write the intensity, in units of the beam's, at n places from x[at], y[at], (m,), on to `out` from `begin` on."""
    for i in range(begin, begin + n):
        out[i] = 0.0
    for k in range(profile.functions.size):
        _call(profile.functions[k], profile.numbers, profile.starts[k], x, y, at, n, out, begin)
