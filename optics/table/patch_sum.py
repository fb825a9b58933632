"""The sum over one patch of a pressure table, as vector instructions.

At each node lie the values of four quantities, then their ∂τ, ∂v and ∂τ∂v: 16 numbers side by side. The sum is written
as LLVM instructions, to keep four or eight numbers in one vector: numba takes them one by one otherwise, which is three
times slower. Products are added to sums with one rounding, as the instruction set defines it: the same bits everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numba
from llvmlite import ir
from numba.core import cgutils
from numba.extending import intrinsic

_REAL, _LANE = ir.DoubleType(), ir.IntType(32)
# Cubic Hermite weights of (value left, value right, slope left, slope right) at s: c₀ + c₁ s + c₂ s² + c₃ s³.
_HERMITE = ((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (-3.0, 3.0, -2.0, -1.0), (2.0, -2.0, 1.0, 1.0))


class _Vectors:
    """Instructions on vectors of doubles, and on the numbers of an array."""

    def __init__(self, context: Any, builder: ir.IRBuilder, kind: Any, array: ir.Value):
        self.b, self.pointer = builder, context.make_array(kind)(context, builder, array).data

    def constant(self, numbers: Sequence[float]) -> ir.Value:
        """A vector known beforehand."""
        return ir.Constant(ir.VectorType(_REAL, len(numbers)), list(numbers))

    def pick(self, x: ir.Value, lanes: Sequence[int], y: ir.Value | None = None) -> ir.Value:
        """Some of the numbers of x, followed by those of y."""
        mask = ir.Constant(ir.VectorType(_LANE, len(lanes)), list(lanes))
        return self.b.shuffle_vector(x, x if y is None else y, mask)

    def spread(self, number: ir.Value) -> ir.Value:
        """Four times the number."""
        none = ir.Constant(ir.VectorType(_REAL, 4), ir.Undefined)
        return self.pick(self.b.insert_element(none, number, ir.Constant(_LANE, 0)), [0] * 4)

    def fused(self, x: ir.Value, y: ir.Value, z: ir.Value) -> ir.Value:
        """The sum x y + z, rounded once."""
        kind = ir.FunctionType(x.type, [x.type] * 3)
        function = cgutils.get_or_insert_function(self.b.module, kind, f"llvm.fma.v{x.type.count}f64")
        return self.b.call(function, [x, y, z])

    def load(self, size: int, *steps: Any) -> ir.Value:
        """Numbers of the array, `size` of them, from the sum of the steps on."""
        place = steps[0]
        for step in steps[1:]:
            place = self.b.add(place, ir.Constant(place.type, step) if isinstance(step, int) else step)
        kind = ir.VectorType(_REAL, size).as_pointer()
        return self.b.load(self.b.bitcast(self.b.gep(self.pointer, [place]), kind), align=8)

    def sum(self, weights: ir.Value, groups: list[ir.Value]) -> ir.Value:
        """Sum of four vectors, with a weight each."""
        each = [self.pick(weights, [lane] * groups[0].type.count) for lane in range(4)]
        total = self.b.fmul(each[0], groups[0])
        for weight, group in zip(each[1:], groups[1:], strict=True):
            total = self.fused(weight, group, total)
        return total

    def hermite(self, s: ir.Value, step: ir.Value, derivative: bool = False) -> ir.Value:
        """Weights of value left, value right, slope left, slope right at s of a step; or their derivatives by s."""
        rows = [[n * x for x in row] for n, row in enumerate(_HERMITE)][1:] if derivative else _HERMITE
        wide, total = self.spread(s), self.constant(rows[-1])
        for row in rows[-2::-1]:
            total = self.fused(total, wide, self.constant(row))
        return self.b.fmul(total, self.pick(self.constant([1.0] * 4), [0, 1, 4, 5], self.spread(step)))

    def corners(self, start: ir.Value, row: ir.Value, next_v: ir.Value) -> list[list[ir.Value]]:
        """Value with ∂τ, at v and at the next v, then ∂v with ∂τ∂v; on the left in τ, then on the right."""
        return [
            [self.load(8, start, side, *more) for more in ((), (next_v,), (8,), (next_v, 8))]
            for side in (ir.Constant(start.type, 0), row)
        ]

    def along_v(self, weights: ir.Value, corners: list[list[ir.Value]]) -> list[ir.Value]:
        """Value left, value right, ∂τ left, ∂τ right of four quantities."""
        left, right = (self.sum(weights, nodes) for nodes in corners)
        return [self.pick(x, lanes) for lanes in (range(4), range(4, 8)) for x in (left, right)]

    def sign(self, turned: ir.Value, parity: ir.Value) -> ir.Value:
        """The parity of four quantities where v is turned."""
        return self.b.select(turned, self.load(4, parity), self.constant([1.0] * 4))

    def lanes(self, *vectors: ir.Value) -> list[ir.Value]:
        """The numbers of vectors of four."""
        return [self.b.extract_element(x, ir.Constant(_LANE, i)) for x in vectors for i in range(4)]


@intrinsic
def values(
    context: Any, n: Any, start: Any, row: Any, next_v: Any, s: Any, h: Any, r: Any, g: Any, parity: Any, turned: Any
) -> Any:
    """Four quantities at (s, r) in the patch at n[start], whose steps are h along τ and g along v.

    The next node in τ is `row` numbers on, that in v `next_v`. Where v is `turned` they are multiplied by the four
    numbers from n[parity] on.
    """

    def build(context: Any, builder: ir.IRBuilder, signature: Any, given: list[ir.Value]) -> ir.Value:
        array, start, row, next_v, s, h, r, g, parity, turned = given
        w = _Vectors(context, builder, signature.args[0], array)
        total = w.sum(w.hermite(s, h), w.along_v(w.hermite(r, g), w.corners(start, row, next_v)))
        lanes = w.lanes(builder.fmul(total, w.sign(turned, parity)))
        return context.make_tuple(builder, signature.return_type, lanes)

    i, f = numba.int64, numba.float64
    return numba.types.UniTuple(f, 4)(n, i, i, i, f, f, f, f, i, numba.boolean), build


@intrinsic
def value_and_slopes(
    context: Any,
    n: Any,
    start: Any,
    row: Any,
    next_v: Any,
    s: Any,
    h: Any,
    r: Any,
    g: Any,
    parity: Any,
    turned: Any,
    s_u: Any,
    s_v: Any,
    r_v: Any,
) -> Any:
    """As `values`, followed by their ∂u and ∂v, given ∂s/∂u, ∂s/∂v and ∂r/∂v."""

    def build(context: Any, builder: ir.IRBuilder, signature: Any, given: list[ir.Value]) -> ir.Value:
        array, start, row, next_v, s, h, r, g, parity, turned, s_u, s_v, r_v = given
        w = _Vectors(context, builder, signature.args[0], array)
        corners, along = w.corners(start, row, next_v), w.hermite(s, h)
        parts = w.along_v(w.hermite(r, g), corners)
        by_s = w.sum(w.hermite(s, h, derivative=True), parts)
        by_r = w.sum(along, w.along_v(w.hermite(r, g, derivative=True), corners))
        by_v = w.fused(by_s, w.spread(s_v), builder.fmul(by_r, w.spread(r_v)))
        found, sign = (w.sum(along, parts), builder.fmul(by_s, w.spread(s_u)), by_v), w.sign(turned, parity)
        lanes = w.lanes(*(builder.fmul(x, sign) for x in found))
        return context.make_tuple(builder, signature.return_type, lanes)

    i, f = numba.int64, numba.float64
    return numba.types.UniTuple(f, 12)(n, i, i, i, f, f, f, f, i, numba.boolean, f, f, f), build


@intrinsic
def read(context: Any, array: Any, place: Any) -> Any:
    """The number array[place], place ≥ 0; numba itself tests each time whether it is counted from the end."""

    def build(context: Any, builder: ir.IRBuilder, signature: Any, given: list[ir.Value]) -> ir.Value:
        pointer = context.make_array(signature.args[0])(context, builder, given[0]).data
        return builder.load(builder.gep(pointer, [given[1]]))

    return array.dtype(array, numba.int64), build


@intrinsic
def prefetch(context: Any, array: Any, place: Any) -> Any:
    """Have array[place] brought from memory to the cache."""

    def build(context: Any, builder: ir.IRBuilder, signature: Any, given: list[ir.Value]) -> ir.Value:
        pointer = context.make_array(signature.args[0])(context, builder, given[0]).data
        at = builder.bitcast(builder.gep(pointer, [given[1]]), ir.IntType(8).as_pointer())
        kind = ir.FunctionType(ir.VoidType(), [at.type, _LANE, _LANE, _LANE])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        reading, keeping, data = (ir.Constant(_LANE, x) for x in (0, 3, 1))
        builder.call(function, [at, reading, keeping, data])
        return context.get_dummy_value()

    return numba.void(array, numba.int64), build
