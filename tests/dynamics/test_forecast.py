"""What a flight will take is known before it starts, and what cannot be is refused then, in one line."""

from __future__ import annotations

import re
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from beamrider.io import resources as machine
from beamrider.io.files import InputError, Stopwatch
from dynamics.membrane import coarse_forecast
from dynamics.membrane import flight as membrane
from dynamics.membrane import forecast as flexible
from dynamics.rigid import stage as rigid
from dynamics.sail import forecast
from dynamics.sail.mesh import sail_mesh
from dynamics.scene.schema import Scene
from dynamics.stability import screening
from tests.families import many_cells, many_members
from tests.membranes import FIG6, altered, film, small
from tests.synthetic import smooth_tables
from workflow.family import Sample, expand, read_family

ROOT = Path(__file__).parents[2]
FAMILY = read_family(ROOT / "workflow/designs/search.yaml")
GIGA = 1e9
SHORT = small(rings=4, flight={"duration_s": 2e-4, "spin_up_s": 1e-4, "optics_every": 4, "heat_every": 2})

# Linux counts what the parent had before into ru_maxrss of a child; VmHWM is the program's own.
PEAK = """
import re, sys, tempfile
from pathlib import Path
from dynamics.membrane.flight import Flight
from tests.membranes import FIG6, altered
from tests.synthetic import smooth_tables
scene = altered(FIG6, sail={"rings": int(sys.argv[1])}, flight=eval(sys.argv[2]))
Flight(scene, smooth_tables(), Path(tempfile.mkdtemp()))
print(1024 * int(re.search(r"VmHWM:\\s*(\\d+)", Path("/proc/self/status").read_text())[1]))
"""

#: Of the megabytes that a process takes, all figures but the last.
LOADED = f"{forecast.PROCESS / 1e7:.0f}"


def peak(command: list[str], text: str | None = None) -> float:
    """Bytes that a command prints as its peak, the second time: compiling takes memory of its own."""
    for _ in range(2):
        told = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True, input=text)
    return float(told.stdout)


@pytest.mark.parametrize(("outline", "profile"), [("round", {}), ("square", {}), ("hexagonal", {"profile": "cone"})])
def test_nodes_and_triangles_are_those_of_the_mesh(outline, profile):
    extra = {"depth": 0.2, **profile} if profile else {}
    sail = small(rings=7, sail={"outline": outline, "sectors": film(), **extra}).sail
    mesh = sail_mesh(sail)
    assert (forecast.nodes(sail), forecast.triangles(sail)) == (len(mesh.nodes), len(mesh.triangles))


@pytest.mark.parametrize(
    ("rings", "flight"),
    [
        (100, {}),
        (100, {"stiffness": "lattice"}),
        (50, {"integrator": "corotating", "optics_every": 1, "heat_every": 1}),
    ],
)
def test_memory_is_what_a_process_takes_at_most(rings, flight):
    """Within the margin with which `beamrider.io.resources` refuses."""
    command = [sys.executable, "-c", PEAK, str(rings), repr(flight)]
    said = flexible.flexible_memory(altered(FIG6, sail={"rings": rings}, flight=flight))
    assert said == pytest.approx(peak(command), rel=machine.MARGIN)


def test_rows_of_a_rigid_flight_take_the_memory_that_is_said(tmp_path: Path):
    rows = 500_000
    scene = altered(FIG6, rigid={"duration_s": 0.05, "output_Hz": rows / 0.05})
    code = (
        "import re, sys\nfrom pathlib import Path\nfrom dynamics.rigid import stage as rigid\n"
        "from dynamics.scene.schema import Scene\n"
        "from tests.synthetic import smooth_tables\nscene = Scene.model_validate_json(sys.stdin.read())\n"
        "tables = smooth_tables()\nrigid.write(sys.argv[1], rigid.fly(scene, tables), scene, tables)\n"
        'print(1024 * int(re.search(r"VmHWM:\\s*(\\d+)", Path("/proc/self/status").read_text())[1]))'
    )
    command = [sys.executable, "-c", code, str(tmp_path / "r.h5")]
    assert forecast.require_rows(scene) == rows
    assert forecast.PROCESS + rows * forecast.A_ROW == pytest.approx(
        peak(command, scene.model_dump_json()), rel=machine.MARGIN
    )


def said(scene: Scene, stage: str, tmp_path: Path) -> str:
    start = {"rigid": rigid.fly, "membrane": lambda *given: membrane.Flight(*given, tmp_path / "partial")}[stage]
    with pytest.raises(InputError) as caught:
        start(scene, smooth_tables())
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())
    return str(caught.value)


@pytest.mark.parametrize(
    ("stage", "changes", "line"),
    [
        (
            "membrane",
            {"sail": {"rings": 1000}},
            r"fig6.yaml: sail.rings = 1000: would take 20\.[34] GB of memory, or up to 24\.[45] GB; "
            "this machine has 8 GB free; "
            r"take at most \d+ rings, which fit",
        ),
        (
            "membrane",
            {"flight": {"duration_s": 1e9}},
            r"fig6.yaml: flight.duration_s = 1e\+09: would write 27.* PB; the disk of .* has 100 GB free; "
            "fly for a shorter "
            "time, or raise flight.snapshot_every_s = 0.001 and flight.series_every = 8",
        ),
        (
            "membrane",
            {"flight": {"duration_s": 1e9, "snapshot_every_s": 1e9, "series_every": 10**12}},
            r"fig6.yaml: flight.duration_s = 1e\+09: would take .* days on this machine \(1.*e\+14 steps\), "
            "more than the 30 "
            "days allowed; fly for a shorter time",
        ),
        (
            "membrane",
            {"flight": {"duration_s": 1e3, "snapshot_every_s": 1e9, "series_every": 10}},
            r"fig6.yaml: flight.duration_s = 1000: would (take|write) .*",
        ),
        ("membrane", {"sail": {"sectors": film(damping_s=1e3)}}, r"fig6.yaml: flight.duration_s = 0.25: would .*"),
        (
            "rigid",
            {"rigid": {"duration_s": 1e9}},
            r"fig6.yaml: rigid.duration_s = 1e\+09: would take 1.8 PB of memory, or up to 2.16 PB; "
            "this machine has 8 GB "
            r"free; fly for a shorter time, or lower rigid.output_Hz = 2000",
        ),
        (
            "rigid",
            {"rigid": {"duration_s": 1e5}},
            r"fig6.yaml: rigid.duration_s = 100000: would take 180 GB of memory, .*",
        ),
        (
            "rigid",
            {"rigid": {"duration_s": 1e9, "output_Hz": 1e-9, "most_steps": 10**12}},
            r"fig6.yaml: rigid.(duration_s = 1e\+09|most_steps = 1000000000000): would take .* (days|years) on this .*",
        ),
    ],
)
def test_what_cannot_be_flown_is_refused_before_it_starts(stage, changes, line, tmp_path, monkeypatch):
    monkeypatch.setattr(machine, "available_memory", lambda: 8 * GIGA)
    monkeypatch.setattr(flexible, "available_memory", lambda: 8 * GIGA)
    monkeypatch.setattr(forecast, "available_memory", lambda: 8 * GIGA)
    monkeypatch.setattr(machine, "free_disk", lambda path: 100 * GIGA)
    coarse = {} if "sail" in changes and "rings" in changes["sail"] else {"rings": 5}
    changes = {**changes, "sail": {**coarse, **changes.get("sail", {})}}
    assert re.fullmatch(line, said(altered(FIG6, **changes), stage, tmp_path))


def test_the_rings_that_fit_do(monkeypatch):
    monkeypatch.setattr(machine, "available_memory", lambda: 8 * GIGA)
    monkeypatch.setattr(flexible, "available_memory", lambda: 8 * GIGA)
    monkeypatch.setattr(forecast, "available_memory", lambda: 8 * GIGA)
    with pytest.raises(InputError) as caught:
        flexible.require_mesh(altered(FIG6, sail={"rings": 1000}))
    fit = int(re.search(r"at most (\d+) rings", str(caught.value))[1])
    assert 400 < fit < 1000
    flexible.require_mesh(altered(FIG6, sail={"rings": fit}))
    with pytest.raises(InputError):
        flexible.require_mesh(altered(FIG6, sail={"rings": round(1.05 * fit)}))


def test_steps_that_are_timed_leave_no_trace(tmp_path, monkeypatch):
    """The same bits with and without them, at the start and in the middle of a flight."""
    runs = []
    for timed in (True, False):
        if not timed:
            monkeypatch.setattr(membrane, "step_seconds", lambda flight: (1e-6, 1e-6))
        flight = membrane.Flight(SHORT, smooth_tables(), tmp_path / str(timed))
        flight.fly()
        runs.append([array.copy() for _, array in flight._arrays()] + [np.array(flight.journal.rows)])
    assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(*runs, strict=True))
    flight = membrane.Flight(SHORT, smooth_tables(), tmp_path / "middle")
    while flight.step < flight.model.end:
        flight.rehearse(max(flight.step, flight.model.release), 8)
        flight.advance()
    assert np.array_equal(np.array(flight.journal.rows), runs[0][-1])


def test_a_forecast_is_printed_first_and_the_bar_counts_what_is_left(tmp_path, capsys):
    flight = membrane.Flight(SHORT, smooth_tables(), tmp_path / "a")
    flight.fly()
    first, *bars = [line for line in capsys.readouterr().err.replace("\r", "\n").splitlines() if line]
    what = f"fig6: 61 nodes, {flight.model.end} steps of"
    assert re.fullmatch(rf"{what} \S+ s, .* of the disk's .*, {LOADED}\d MB of memory \(.* free\), about .* s", first)
    assert bars[0].startswith("flexible fig6:   0%")
    assert "100%" in bars[-1]


def test_the_time_of_a_flight_is_told_within_a_factor_of_two(tmp_path, monkeypatch):
    """By CPU time of the process, which other programs do not lengthen."""
    monkeypatch.setattr(Stopwatch, "seconds", Stopwatch.cpu_seconds)
    scene = altered(SHORT, flight={"duration_s": 0.02, "snapshot_every_s": 1.0})
    flight = membrane.Flight(scene, smooth_tables(), tmp_path / "a")
    before, after = membrane.step_seconds(flight)
    watch = Stopwatch()
    told = before * flight.model.release + after * (flight.model.end - flight.model.release)
    while flight.step < flight.model.end:
        flight.advance()
    assert 0.5 < told / watch.seconds < 2.0


def test_memory_of_the_machine_of_its_groups_and_of_the_process(tmp_path, monkeypatch):
    monkeypatch.setattr(resource, "getrlimit", lambda which: (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    assert machine.available_memory(tmp_path) == float("inf")
    files = {
        "proc/meminfo": "MemTotal:  9000 kB\nMemAvailable:    8000 kB\nHugePages_Total:       0\n",
        "proc/self/cgroup": "4:memory:/a/b\n1:cpu:/x\n0::/c/d\n",
        "proc/self/status": "Name:\tpython x\nVmSize:\t 1000 kB\n",
        "sys/fs/cgroup/memory/a/memory.limit_in_bytes": "7000000",
        "sys/fs/cgroup/memory/a/memory.usage_in_bytes": "1000",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    assert machine.available_memory(tmp_path) == 6999000
    for group, most, used in (("c/d", "max", 3000), ("c", "5000", 4000)):
        folder = tmp_path / "sys/fs/cgroup" / group
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "memory.max").write_text(most)
        (folder / "memory.current").write_text(str(used))
    (tmp_path / "sys/fs/cgroup/c/memory.stat").write_text("anon 10\ninactive_file 700\n")
    assert machine.available_memory(tmp_path) == 1700
    monkeypatch.setattr(resource, "getrlimit", lambda which: (1024 * 1001, 0))
    assert machine.available_memory(tmp_path) == 1024


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (0.123, "0.12 s"),
        (59.0, "59 s"),
        (600.0, "10 min"),
        (7300.0, "2 h"),
        (3e5, "3.5 days"),
        (1e9, "31.7 years"),
    ],
)
def test_times_in_words(seconds, words):
    assert machine.in_words(seconds) == words


def test_families_and_maps_beyond_memory_are_refused_before_they_are_made(tmp_path, monkeypatch):
    monkeypatch.setattr(machine, "available_memory", lambda: 0.5 * GIGA)
    draw = FAMILY.model_copy(update={"sample": Sample(kind="sobol", count=100_000)})
    for refused, line in (
        (
            lambda: expand(draw, {}),
            r"search.yaml: sample.count = 100000: 100,000 members: would take 1\.[12].*draw fewer",
        ),
        (lambda: forecast.require_cells(10**8, 1, "grid.yaml"), "grid.yaml: n_offsets · n_tilts = 100,000,000: .*"),
        (lambda: forecast.require_members(10**7, "m.parquet", "screen parts"), "m.parquet: 10,000,000 members: .*"),
    ):
        with pytest.raises(InputError) as caught:
            refused()
        assert re.fullmatch(line, str(caught.value))


def test_a_screening_says_first_what_it_takes(capsys):
    screening.screen(screening.scenes.read_scene(ROOT / "workflow/scenes/fig6.yaml"), many_members(20), many_cells(20))
    first = next(line for line in capsys.readouterr().err.splitlines() if line)
    assert re.fullmatch(rf"fig6: 380 members, {LOADED}\d MB of memory \(.* free\), about \S+ s", first)


def test_a_fine_mesh_is_forecast_from_a_coarse_one(tmp_path, monkeypatch, capsys):
    """Its nodes to the last one, its steps within a tenth; what would take too long is refused before it is built."""
    monkeypatch.setattr(coarse_forecast, "FINE", 16)
    monkeypatch.setattr(coarse_forecast, "COARSE", 8)
    scene = small(rings=20, flight={"duration_s": 2e-3, "spin_up_s": 1e-4, "heat_every": 8})

    def fly(coarse: Scene, folder: Path) -> membrane.Flight:
        assert coarse.sail.rings == 8
        return membrane.Flight(coarse, smooth_tables(), folder)

    coarse_forecast.forecast_fine(scene, fly, tmp_path)
    said = re.match(r"fig6: ([\d,]+) nodes, ([\d,]+) steps", capsys.readouterr().err)
    model = membrane.Flight(scene, smooth_tables(), tmp_path / "fine").model
    count, steps = (int(text.replace(",", "")) for text in said.groups())
    assert count == model.masses.size
    assert steps == pytest.approx(model.end, rel=0.1)
    monkeypatch.setattr(forecast, "LONGEST", 1e-3)
    with pytest.raises(InputError, match=r"fig6.yaml: flight.duration_s = 0.002: would take .* on this machine \("):
        coarse_forecast.forecast_fine(scene, fly, tmp_path)
    coarse_forecast.forecast_fine(small(rings=15), fly, tmp_path)
