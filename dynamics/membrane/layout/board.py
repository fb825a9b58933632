"""A board on which one thread hands out work to others, without locks: atomic reads and additions; compiled.

The board (24,): the ticket of the latest work, what is to be done and how; then how many threads were done with it.
Each at the start of a line of the cache.
"""

from __future__ import annotations

import numba

from beamrider.arrays import Integers
from beamrider.machine_code.atomics import add, let_others, look

TICKET, TASK, SOURCE, MOVES, LEVELS, SEAM, DONE = 0, 8, 9, 10, 11, 12, 16
BOARD, ORDERS = 24, 4
#: Looks at the board, some hundred microseconds, before another process is let on the core: that may take milliseconds.
_PATIENCE = 200_000


@numba.njit(cache=True, error_model="numpy")
def wait(board: Integers, place: int, value: int) -> None:
    """Until an entry of the board (places,) is at least `value`."""
    looks = 0
    while look(board, place) < value:
        looks += 1
        if looks > _PATIENCE:
            let_others()


@numba.njit(cache=True, error_model="numpy")
def hand_out(board: Integers, task: int) -> None:
    """Let the other threads begin with a task, by the board (places,)."""
    board[TASK] = task
    add(board, TICKET, 1)


@numba.njit(cache=True, error_model="numpy")
def collect(board: Integers, others: int) -> None:
    """Until the others are done with all work handed out so far, as the board (places,) says."""
    wait(board, DONE, board[TICKET] * others)


@numba.njit(cache=True, error_model="numpy")
def part(size: int, thread: int, threads: int) -> tuple[int, int]:
    """First and end of a thread's part of `size` numbers."""
    return size * thread // threads, size * (thread + 1) // threads
