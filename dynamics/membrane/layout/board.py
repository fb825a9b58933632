"""A board on which one thread hands out work to others, without locks: atomic reads and additions; compiled.

The board (24,): the ticket of the latest work, what is to be done and how; then how many threads were done with it.
Each at the start of a line of the cache.
"""

from __future__ import annotations

from typing import Any

import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from beamrider.arrays import Integers

TICKET, TASK, SOURCE, MOVES, LEVELS, SEAM, DONE = 0, 8, 9, 10, 11, 12, 16
BOARD, ORDERS = 24, 4
#: Looks at the board, some hundred microseconds, before another process is let on the core: that may take milliseconds.
_PATIENCE = 200_000


def _place(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    array = context.make_array(signature.args[0])(context, builder, args[0])
    return builder.gep(array.data, [args[1]])


@intrinsic
def _look(typing: Any, board: Any, place: Any) -> Any:
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
def _let_others(typing: Any) -> Any:
    """Let another process have the core, if one wants it (POSIX sched_yield)."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kind = ir.FunctionType(ir.IntType(32), [])
        builder.call(cgutils.get_or_insert_function(builder.module, kind, "sched_yield"), [])
        return context.get_dummy_value()

    return types.void(), generate


@numba.njit(cache=True)
def wait(board: Integers, place: int, value: int) -> None:
    """Until an entry of the board is at least `value`."""
    looks = 0
    while _look(board, place) < value:
        looks += 1
        if looks > _PATIENCE:
            _let_others()


@numba.njit(cache=True)
def hand_out(board: Integers, task: int) -> None:
    """Let the other threads begin with a task."""
    board[TASK] = task
    add(board, TICKET, 1)


@numba.njit(cache=True)
def collect(board: Integers, others: int) -> None:
    """Until the others are done with all work handed out so far."""
    wait(board, DONE, board[TICKET] * others)


@numba.njit(cache=True, error_model="numpy")
def part(size: int, thread: int, threads: int) -> tuple[int, int]:
    """First and end of a thread's part of `size` numbers."""
    return size * thread // threads, size * (thread + 1) // threads
