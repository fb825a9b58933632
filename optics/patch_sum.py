"""The sum over one patch of a pressure table, as vector instructions.

It is written as LLVM instructions to keep four quantities in one vector: numba takes them one by one otherwise, which
is three times slower. Products and sums are fused (one rounding), the same on every machine.
"""

from __future__ import annotations

from typing import Any

import numba
from llvmlite import ir
from numba.core import cgutils
from numba.extending import intrinsic

Four = tuple[float, float, float, float]

_REAL, _LANE = ir.DoubleType(), ir.IntType(32)
# Cubic Hermite weights of (value left, value right, slope left, slope right) at s: c₀ + c₁ s + c₂ s² + c₃ s³.
_HERMITE = ((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (-3.0, 3.0, -2.0, -1.0), (2.0, -2.0, 1.0, 1.0))


class _Vectors:
    """Instructions on vectors of doubles."""

    def __init__(self, builder: ir.IRBuilder, pointer: ir.Value):
        self.b, self.pointer = builder, pointer

    def constant(self, numbers: Any) -> ir.Value:
        return ir.Constant(ir.VectorType(_REAL, len(numbers)), list(numbers))

    def pick(self, x: ir.Value, lanes: Any) -> ir.Value:
        return self.b.shuffle_vector(x, x, ir.Constant(ir.VectorType(_LANE, len(lanes)), list(lanes)))

    def spread(self, number: ir.Value, size: int = 4) -> ir.Value:
        one = self.b.insert_element(ir.Constant(ir.VectorType(_REAL, size), ir.Undefined), number, ir.Constant(_LANE, 0))
        return self.pick(one, [0] * size)

    def fused(self, x: ir.Value, y: ir.Value, z: ir.Value) -> ir.Value:
        kind = ir.FunctionType(x.type, [x.type] * 3)
        function = cgutils.get_or_insert_function(self.b.module, kind, f"llvm.fma.v{x.type.count}f64")
        return self.b.call(function, [x, y, z])

    def load(self, size: int, *steps: Any) -> ir.Value:
        place = steps[0]
        for step in steps[1:]:
            place = self.b.add(place, ir.Constant(place.type, step) if isinstance(step, int) else step)
        kind = ir.VectorType(_REAL, size).as_pointer()
        return self.b.load(self.b.bitcast(self.b.gep(self.pointer, [place]), kind), align=8)

    def sum(self, weights: list[ir.Value], groups: list[ir.Value]) -> ir.Value:
        total = self.b.fmul(weights[0], groups[0])
        for weight, group in zip(weights[1:], groups[1:], strict=True):
            total = self.fused(weight, group, total)
        return total

    def hermite(self, s: ir.Value, step: ir.Value, derivative: bool) -> ir.Value:
        """Weights of value left, value right, slope left, slope right; their derivatives by s."""
        c = [self.constant(row) for row in _HERMITE]
        if derivative:
            c = [self.constant([n * x for x in row]) for n, row in enumerate(_HERMITE)][1:]
        wide = self.spread(s)
        total = c[-1]
        for row in c[-2::-1]:
            total = self.fused(total, wide, row)
        size = self.b.shuffle_vector(
            self.constant([1.0] * 4), self.spread(step), ir.Constant(ir.VectorType(_LANE, 4), [0, 1, 4, 5])
        )
        return self.b.fmul(total, size)

    def sides(self, start: ir.Value, row: ir.Value, next_v: ir.Value) -> list[list[ir.Value]]:
        return [
            [self.load(8, start, side, *more) for more in ((), (next_v,), (8,), (next_v, 8))]
            for side in (ir.Constant(start.type, 0), row)
        ]

    def along_v(self, weights: ir.Value, sides: list[list[ir.Value]]) -> list[ir.Value]:
        """Value left, value right, slope left, slope right of four quantities."""
        weights = [self.pick(weights, [lane] * 8) for lane in range(4)]
        left, right = (self.sum(weights, nodes) for nodes in sides)
        return [self.pick(x, lanes) for lanes in (range(4), range(4, 8)) for x in (left, right)]

    def along_tau(self, weights: ir.Value, parts: list[ir.Value]) -> ir.Value:
        return self.sum([self.pick(weights, [lane] * 4) for lane in range(4)], parts)

    def sign(self, turned: ir.Value, parity: ir.Value) -> ir.Value:
        return self.b.select(turned, self.load(4, parity), self.constant([1.0] * 4))

    def lanes(self, *vectors: ir.Value) -> list[ir.Value]:
        return [self.b.extract_element(x, ir.Constant(_LANE, i)) for x in vectors for i in range(4)]


def _vectors(context: Any, builder: ir.IRBuilder, kind: Any, array: ir.Value) -> _Vectors:
    return _Vectors(builder, context.make_array(kind)(context, builder, array).data)


@intrinsic
def values(
    context: Any, n: Any, start: Any, row: Any, next_v: Any, s: Any, h: Any, r: Any, g: Any, parity: Any, turned: Any
) -> Any:
    """Tensor Hermite sum of four quantities over the patch at `start`."""

    def build(context: Any, builder: ir.IRBuilder, signature: Any, given: list[ir.Value]) -> ir.Value:
        array, start, row, next_v, s, h, r, g, parity, turned = given
        w = _vectors(context, builder, signature.args[0], array)
        parts = w.along_v(w.hermite(r, g, False), w.sides(start, row, next_v))
        total = builder.fmul(w.along_tau(w.hermite(s, h, False), parts), w.sign(turned, parity))
        return context.make_tuple(builder, signature.return_type, w.lanes(total))

    i, f = numba.int64, numba.float64
    return numba.types.UniTuple(f, 4)(n, i, i, i, f, f, f, f, i, numba.boolean), build


@intrinsic
def value_and_slopes(
    context: Any, n: Any, start: Any, row: Any, next_v: Any, s: Any, h: Any, r: Any, g: Any, parity: Any, turned: Any,
    per_u: Any, tau_v: Any, per_v: Any,
) -> Any:
    def build(context: Any, builder: ir.IRBuilder, signature: Any, given: list[ir.Value]) -> ir.Value:
        array, start, row, next_v, s, h, r, g, parity, turned, per_u, tau_v, per_v = given
        w = _vectors(context, builder, signature.args[0], array)
        sides, along, sign = w.sides(start, row, next_v), w.hermite(s, h, False), w.sign(turned, parity)
        parts = w.along_v(w.hermite(r, g, False), sides)
        value, by_tau = w.along_tau(along, parts), w.along_tau(w.hermite(s, h, True), parts)
        by_v = w.along_tau(along, w.along_v(w.hermite(r, g, True), sides))
        by_u = builder.fmul(by_tau, w.spread(per_u))
        by_v = w.fused(by_tau, w.spread(tau_v), builder.fmul(by_v, w.spread(per_v)))
        lanes = w.lanes(*(builder.fmul(x, sign) for x in (value, by_u, by_v)))
        return context.make_tuple(builder, signature.return_type, lanes)

    i, f = numba.int64, numba.float64
    return numba.types.UniTuple(f, 12)(n, i, i, i, f, f, f, f, i, numba.boolean, f, f, f), build


@intrinsic
def read(context: Any, array: Any, place: Any) -> Any:
    """array[place] for place ≥ 0: numba's own tests for places counted from the end each time."""

    def build(context: Any, builder: ir.IRBuilder, signature: Any, given: list[ir.Value]) -> ir.Value:
        pointer = context.make_array(signature.args[0])(context, builder, given[0]).data
        return builder.load(builder.gep(pointer, [given[1]]))

    return array.dtype(array, numba.int64), build


@intrinsic
def prefetch(context: Any, array: Any, place: Any) -> Any:
    def build(context: Any, builder: ir.IRBuilder, signature: Any, given: list[ir.Value]) -> ir.Value:
        pointer = context.make_array(signature.args[0])(context, builder, given[0]).data
        at = builder.bitcast(builder.gep(pointer, [given[1]]), ir.IntType(8).as_pointer())
        i32 = ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [at.type, i32, i32, i32])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        builder.call(function, [at, ir.Constant(i32, 0), ir.Constant(i32, 3), ir.Constant(i32, 1)])
        return context.get_dummy_value()

    return numba.void(array, numba.int64), build
