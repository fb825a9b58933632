"""Fixtures that several tests use."""

import multiprocessing
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from optics.cells.schema import Metagrating, read_metagrating

DESIGNS = Path(__file__).parents[1] / "workflow" / "designs"


@pytest.fixture(scope="session")
def te() -> Metagrating:
    """The paper's TE cell."""
    return read_metagrating(DESIGNS / "mark1e_te.yaml")


@pytest.fixture(scope="session")
def tm() -> Metagrating:
    """The paper's TM cell."""
    return read_metagrating(DESIGNS / "mark1e_tm.yaml")


@pytest.fixture(scope="module")
def apart() -> Iterator[Callable[..., Any]]:
    """Call a function in another process: importing Meep would switch denormal numbers off in this one."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("fork")) as pool:
        yield lambda function, *arguments: pool.submit(function, *arguments).result()


#: Files whose first flight compiles all kernels of its kind, for minutes: each begins on a process of its own.
COMPILING = ("tests/dynamics/membrane/test_flight_ends.py", "tests/dynamics/rigid/test_rigid.py")
#: What needs no such kernels comes next, so that no two processes compile the same.
PLAIN = "tests/optics/"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What compiles first, then what needs none of it, then the rest."""

    def turn(item: pytest.Item) -> int:
        file = item.nodeid.split("::")[0]
        return COMPILING.index(file) if file in COMPILING else len(COMPILING) + (not file.startswith(PLAIN))

    items.sort(key=turn)
