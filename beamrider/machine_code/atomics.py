"""Atomic reads and additions, for compiled code of several threads, and a way to let another process have the core.

Numba has them for GPUs only. Its compiler's own parts (`numba.core.cgutils`, contexts, builders) are used here and in
`streams`, `cache` and `notice` beside it, and nowhere else but in `optics.table.patch_sum`; tests tell what breaks.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic


def _place(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    array = context.make_array(signature.args[0])(context, builder, args[0])
    return builder.gep(array.data, [args[1]])


@intrinsic
def look(typing: Any, board: Any, place: Any) -> Any:
    """Entry of the board; what was written before it was written is seen from here on."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.load_atomic(_place(context, builder, signature, args), "acquire", 8)

    return types.int64(board, types.intp), generate


@intrinsic
def add(typing: Any, board: Any, place: Any, value: Any) -> Any:
    """Add to an entry of the board; who sees it also sees what was written before."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.atomic_rmw("add", _place(context, builder, signature, args), args[2], "acq_rel")

    return types.int64(board, types.intp, types.int64), generate


@intrinsic
def let_others(typing: Any) -> Any:
    """Let another process have the core, if one wants it (POSIX sched_yield)."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kind = ir.FunctionType(ir.IntType(32), [])
        builder.call(cgutils.get_or_insert_function(builder.module, kind, "sched_yield"), [])
        return context.get_dummy_value()

    return types.void(), generate
