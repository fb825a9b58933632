"""Threads that fly one sail: the first hands out work and takes its share, the others wait for it without sleeping.

A step takes tens of microseconds, less than waking a thread does. Within a piece of work what a thread does depends on
no other, so results have the same bits for any number of them. The board (24,): the ticket of the latest work, what is
to be done and how; then how many threads were done with it. Each at the start of a line of the cache.
"""

from __future__ import annotations

import numba

from beamrider.arrays import Floats, Integers
from beamrider.machine_code.atomics import add
from dynamics.membrane.effects import light_pressure
from dynamics.membrane.effects.light_pressure import HeldLight, LightPressure
from dynamics.membrane.layout import rows, sweep
from dynamics.membrane.layout.board import (
    DONE,
    LEVELS,
    MOVES,
    SEAM,
    SOURCE,
    TASK,
    TICKET,
    collect,
    hand_out,
    part,
    wait,
)
from dynamics.membrane.layout.rows import Stencil, StencilWork, StepTimes

LEAVE, SWEEP, RESPOND = range(3)


@numba.njit(cache=True, error_model="numpy")
def _sweep_together(layout: Stencil, work: StencilWork, source: int, times: StepTimes, levels: int, seam: bool) -> int:
    """The sweep of each thread; how many elements may have failed. At the seams the first thread has nothing to do."""
    scratch = work.scratch
    board, others = scratch.board, scratch.bad.size - 1
    if others > 0:
        scratch.orders[0], scratch.orders[1] = times.close, times.open
        scratch.orders[2], scratch.orders[3] = times.dt, times.share
        board[SOURCE], board[MOVES], board[LEVELS], board[SEAM] = source, times.moves, levels, seam
        hand_out(board, SWEEP)
    if not seam:
        sweep.sweep(layout, work, source, times, 0, levels, False)
    if others > 0:
        collect(board, others)
    bad = 0
    for thread in range(1 if seam else 0, others + 1):
        bad += scratch.bad[thread]
    return bad


@numba.njit(cache=True, error_model="numpy")
def sweep_all(layout: Stencil, work: StencilWork, source: int, times: StepTimes, levels: int = 1) -> int:
    """So many steps, at most those of the work space; how many elements may have failed or are not finite."""
    bad = 0
    for turn in range(2 if levels > 1 and work.scratch.bad.size > 1 else 1):
        bad += _sweep_together(layout, work, source, times, levels, turn == 1)
    return bad


@numba.njit(cache=True, error_model="numpy")
def respond_all(
    light: LightPressure, work: HeldLight, x: Floats, gone: Integers, layout: Stencil, space: StencilWork
) -> None:
    """Light on all triangles at nodes x (3, n), which must be `ahead` of the work space."""
    scratch = space.scratch
    threads, size = scratch.bad.size, light.corners.shape[1]
    if threads > 1:
        hand_out(scratch.board, RESPOND)
    begin, end = part(size, 0, threads)
    light_pressure.respond(
        light,
        work,
        rows.patch(scratch, 0),
        layout,
        x,
        gone,
        begin,
        end,
        scratch.found[0],
        scratch.seen[0],
        space.held,
    )
    if threads > 1:
        collect(scratch.board, threads - 1)
    light_pressure.note(work, scratch.found, scratch.seen)


@numba.njit(cache=True, error_model="numpy")
def dismiss(board: Integers) -> None:
    """Let the other threads go, by the board (places,)."""
    hand_out(board, LEAVE)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def assist(
    layout: Stencil, work: StencilWork, light: LightPressure, lit: HeldLight, ahead: Floats, gone: Integers, thread: int
) -> None:
    """What a thread other than the first does from the start of `step.run` to its end; the board must be empty.

    ahead (3,): of the light's time; gone (triangles,): which have failed.
    """
    scratch, ticket = work.scratch, 0
    board, orders, threads = scratch.board, scratch.orders, scratch.bad.size
    while True:
        ticket += 1
        wait(board, TICKET, ticket)
        if board[TASK] == LEAVE:
            return
        if board[TASK] == SWEEP:
            times = StepTimes(board[MOVES] == 1, orders[0], orders[1], orders[2], orders[3])
            sweep.sweep(layout, work, board[SOURCE], times, thread, board[LEVELS], board[SEAM] == 1)
        else:
            begin, end = part(light.corners.shape[1], thread, threads)
            light_pressure.respond(
                light,
                lit,
                rows.patch(scratch, thread),
                layout,
                ahead,
                gone,
                begin,
                end,
                scratch.found[thread],
                scratch.seen[thread],
                work.held,
            )
        add(board, DONE, 1)
