"""Parts of Numba that are not for everybody still do what we use them for; a failure names what a new version broke."""

import inspect
import re
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core import caching, event

from beamrider.machine_code import atomics, cache
from beamrider.machine_code.streams import streams, uncounted

ROOT = Path(__file__).parents[3]
SIGNATURE = numba.types.void(numba.types.int64, *[numba.types.float64[::1]] * 3)


def add(n, a, b, out):
    for i in range(n):
        out[i] = a[i] + 2.0 * b[i]


def header(function: numba.core.dispatcher.Dispatcher, signature: object) -> str:
    """The first line of the function itself, of its code as the compiler made it."""
    text = function.inspect_llvm(function.signatures[0])
    return next(line for line in text.splitlines() if line.startswith("define") and "cpython" not in line)


def test_streams_promise_that_arrays_share_no_memory():
    """Numba's `noalias` (`numba.core.callconv`, `CPUTargetOptions`): of three arrays, their data and meta pointers."""
    fast, plain = streams(cache=False)(add), numba.njit(error_model="numpy")(add)
    for function in (fast, plain):
        function.compile(SIGNATURE)
    assert header(fast, SIGNATURE).count("noalias") >= header(plain, SIGNATURE).count("noalias") + 3
    assert "alwaysinline" in fast.inspect_llvm(fast.signatures[0])


def test_streams_become_vector_code_without_a_test_for_overlap():
    """LLVM compares addresses first (`vector.memcheck`) where it isn't told that arrays share no memory."""
    fast, plain = streams(cache=False)(add), numba.njit(error_model="numpy")(add)
    for function in (fast, plain):
        function.compile(SIGNATURE)
    texts = [function.inspect_llvm(function.signatures[0]) for function in (fast, plain)]
    assert all(re.search(r"fadd <\d+ x double>", text) for text in texts)
    assert ["vector.memcheck" in text for text in texts] == [False, True]


def rows(a, out):
    for r in range(a.shape[0]):
        line, to = a[r], out[r]
        add_row(line, to)


@numba.njit
def add_row(line, to):
    for i in range(line.size):
        to[i] += line[i]


def test_views_within_rows_are_not_counted():
    """Numba's `_nrt = False`: no reference counts (NRT_incref) in a function that makes views only."""
    signature = numba.types.void(numba.types.float64[:, ::1], numba.types.float64[:, ::1])
    fast = uncounted(cache=False)(rows)
    fast.compile(signature)
    assert "NRT_incref" not in fast.inspect_llvm(fast.signatures[0])
    given, out = np.ones((2, 3)), np.zeros((2, 3))
    fast(given, out)
    assert out.sum() == 6.0


def test_atomic_reads_and_additions_are_atomic():
    """`llvmlite.ir` builders, `numba.core.cgutils` and contexts' `make_array`, in `beamrider.machine_code.atomics`."""

    @numba.njit
    def use(board):
        atomics.add(board, 1, 5)
        atomics.let_others()
        return atomics.look(board, 1)

    board = np.zeros(4, np.int64)
    assert use(board) == 5
    text = use.inspect_llvm(use.signatures[0])
    assert re.search(r"atomicrmw add .* acq_rel", text)
    assert re.search(r"load atomic .* acquire", text)
    assert "sched_yield" in text


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("save", ["self", "key", "data"]),
        ("load", ["self", "key"]),
        ("_dump", ["self", "obj"]),
        ("_load_index", ["self"]),
        ("_load_data", ["self", "name"]),
        ("_save_index", ["self", "overloads"]),
    ],
)
def test_numbas_cache_files_have_the_methods_that_ours_replace(name: str, parameters: list[str]):
    """`numba.core.caching.IndexDataCacheFile`; `test_compiled` tests what ours do."""
    base = next(kind for kind in cache.Checked.__mro__ if kind.__module__.startswith("numba"))
    assert list(inspect.signature(getattr(base, name)).parameters) == parameters


def test_numba_uses_our_cache_files_and_places():
    """`numba.core.caching.IndexDataCacheFile` is what caches make, `CacheImpl._locator_classes` where they look."""
    assert caching.IndexDataCacheFile is cache.Checked
    assert caching.CacheImpl._locator_classes[0] is cache.Resolved
    assert "IndexDataCacheFile(" in inspect.getsource(caching.Cache.__init__)


def test_numba_tells_when_it_compiles():
    """`numba.core.event`, for `beamrider.machine_code.notice`."""
    assert {"on_start", "on_end"} <= set(dir(event.Listener))
    with event.install_recorder("numba:compile") as recorder:
        numba.njit(lambda x: x + 1)(1)
    assert recorder.buffer


def test_the_version_has_an_upper_bound():
    """Another minor version is allowed when these tests have passed with it."""
    from packaging.requirements import Requirement

    text = (cache.ROOT / "pyproject.toml").read_text(encoding="utf-8")
    given = Requirement(re.search(r'"(numba[^"]*)"', text).group(1))
    assert numba.__version__ in given.specifier
    assert "1.0" not in given.specifier


def test_nothing_that_is_cached_is_in_two_files_that_name_each_other():
    """Numba keeps a generalised ufunc's wrapper apart from its kernel, whose name holds a number of the process.

    Two processes that compile at once may leave the wrapper of one and the kernel of the other, and who loads them
    calls an address that isn't there.
    """
    sources = [path for room in ("optics", "dynamics", "workflow") for path in (ROOT / room).rglob("*.py")]
    assert not [path for path in sources if "guvectorize" in path.read_text(encoding="utf-8")]
