"""Threads that fly one sail: the first hands out work and takes its share, the others wait for it without sleeping.

A step takes tens of microseconds, less than waking a thread does. Within a piece of work what a thread does depends on
no other, so results have the same bits for any number of them. The board (24,): the ticket of the latest work, what is
to be done and how; then how many threads were done with it. Each at the start of a line of the cache.
"""

from __future__ import annotations

from typing import Any

import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from dynamics.membrane.effects import light_pressure as optical
from dynamics.membrane.effects.light_pressure import Light, LightWork
from dynamics.membrane.effects.springs import Floats, Integers
from dynamics.membrane.layout import rows as stencil
from dynamics.membrane.layout import sweep
from dynamics.membrane.layout.rows import Pace, Stencil, StencilWork

TICKET, TASK, SOURCE, MOVES, LEVELS, SEAM, DONE = 0, 8, 9, 10, 11, 12, 16
LEAVE, SWEEP, RESPOND = range(3)
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
def _add(typing: Any, board: Any, place: Any, value: Any) -> Any:
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
def _await(board: Integers, place: int, value: int) -> None:
    """Until an entry of the board is at least `value`."""
    looks = 0
    while _look(board, place) < value:
        looks += 1
        if looks > _PATIENCE:
            _let_others()


@numba.njit(cache=True)
def _hand_out(board: Integers, task: int) -> None:
    board[TASK] = task
    _add(board, TICKET, 1)


@numba.njit(cache=True)
def _collect(board: Integers, others: int) -> None:
    """Until the others are done with all work handed out so far."""
    _await(board, DONE, board[TICKET] * others)


@numba.njit(cache=True, error_model="numpy")
def _sweep_together(layout: Stencil, work: StencilWork, source: int, pace: Pace, levels: int, seam: bool) -> int:
    """The sweep of each thread; how many elements may have failed. At the seams the first thread has nothing to do."""
    scratch = work.scratch
    board, others = scratch.board, scratch.bad.size - 1
    if others > 0:
        scratch.orders[0], scratch.orders[1] = pace.close, pace.open
        scratch.orders[2], scratch.orders[3] = pace.dt, pace.share
        board[SOURCE], board[MOVES], board[LEVELS], board[SEAM] = source, pace.moves, levels, seam
        _hand_out(board, SWEEP)
    if not seam:
        sweep.sweep(layout, work, source, pace, 0, levels, False)
    if others > 0:
        _collect(board, others)
    bad = 0
    for thread in range(1 if seam else 0, others + 1):
        bad += scratch.bad[thread]
    return bad


@numba.njit(cache=True, error_model="numpy")
def sweep_all(layout: Stencil, work: StencilWork, source: int, pace: Pace, levels: int = 1) -> int:
    """So many steps, at most those of the work space; how many elements may have failed or are not finite."""
    bad = 0
    for turn in range(2 if levels > 1 and work.scratch.bad.size > 1 else 1):
        bad += _sweep_together(layout, work, source, pace, levels, turn == 1)
    return bad


@numba.njit(cache=True, error_model="numpy")
def _part(size: int, thread: int, threads: int) -> tuple[int, int]:
    """First and end of a thread's part of `size` numbers."""
    return size * thread // threads, size * (thread + 1) // threads


@numba.njit(cache=True, error_model="numpy")
def respond_all(
    light: Light, work: LightWork, x: Floats, gone: Integers, layout: Stencil, space: StencilWork
) -> None:
    """Light on all triangles at nodes x (3, n), which must be `ahead` of the work space."""
    scratch = space.scratch
    threads, size = scratch.bad.size, light.corners.shape[1]
    if threads > 1:
        _hand_out(scratch.board, RESPOND)
    begin, end = _part(size, 0, threads)
    optical.respond(
        light, work, stencil.patch(scratch, 0), layout, x, gone, begin, end, scratch.found[0], scratch.seen[0],
        space.held,
    )
    if threads > 1:
        _collect(scratch.board, threads - 1)
    optical.note(work, scratch.found, scratch.seen)


@numba.njit(cache=True)
def dismiss(board: Integers) -> None:
    """Let the other threads go."""
    _hand_out(board, LEAVE)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def assist(
    layout: Stencil, work: StencilWork, light: Light, lit: LightWork, ahead: Floats, gone: Integers, thread: int
) -> None:
    """What a thread other than the first does from the start of `step.run` to its end; the board must be empty."""
    scratch, ticket = work.scratch, 0
    board, orders, threads = scratch.board, scratch.orders, scratch.bad.size
    while True:
        ticket += 1
        _await(board, TICKET, ticket)
        if board[TASK] == LEAVE:
            return
        if board[TASK] == SWEEP:
            pace = Pace(board[MOVES] == 1, orders[0], orders[1], orders[2], orders[3])
            sweep.sweep(layout, work, board[SOURCE], pace, thread, board[LEVELS], board[SEAM] == 1)
        else:
            begin, end = _part(light.corners.shape[1], thread, threads)
            optical.respond(
                light, lit, stencil.patch(scratch, thread), layout, ahead, gone, begin, end,
                scratch.found[thread], scratch.seen[thread], work.held,
            )
        _add(board, DONE, 1)
