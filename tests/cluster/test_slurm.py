"""The workflow on a real Slurm of one node, with accounting and without: `make test-slurm`, as root on Debian."""

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import yaml

ROOT = Path(__file__).parents[2]
CLUSTER = Path(__file__).parent / "one_node_slurm.sh"
FAULTS = Path(__file__).parent / "faults.smk"
QUICKER = ["--latency-wait", "5", "--slurm-init-seconds-before-status-checks", "5"]
#: What differs from run to run: times.
TIMES = {"seconds", "cpu_seconds", "wall_seconds"}

pytestmark = [pytest.mark.slow, pytest.mark.slurm]


def _ask(*command: str) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


@pytest.fixture(scope="module", params=["--accounting", ""], ids=["accounting", "none"])
def cluster(request) -> Iterator[str]:
    with tempfile.TemporaryDirectory() as place:
        os.chmod(place, 0o755)  # MariaDB's and munge's users look in here
        subprocess.run([CLUSTER, "start", place, *filter(None, [request.param])], check=True)
        yield request.param
        subprocess.run([CLUSTER, "stop", place], check=True)


def _environment(project: Path) -> dict[str, str]:
    """Without USER, as in some containers and from cron; with the project's own modules and machine code."""
    unset = ("USER", "LOGNAME", "SLURM_CONF", "NUMBA_CACHE_DIR")
    return {**{name: value for name, value in os.environ.items() if name not in unset}, "PYTHONPATH": str(project)}


def _command(snakefile: Path, *arguments: str) -> list[str]:
    profile = str(ROOT / "workflow/profiles/slurm")
    asked = ["--snakefile", str(snakefile), "--workflow-profile", profile, *QUICKER, *arguments]
    return [sys.executable, "-m", "snakemake", *asked]


def _start(folder: Path, *targets: str) -> subprocess.Popen[str]:
    """Snakemake with the profile on the jobs of `faults.smk`, its log in the folder."""
    command = _command(FAULTS, "--config", f"project={ROOT}", "--", *targets)
    log = (folder / "log.txt").open("a")
    return subprocess.Popen(command, cwd=folder, env=_environment(ROOT), stdout=log, stderr=log, text=True)


def _finish(folder: Path, *targets: str, status: int = 0) -> None:
    assert _start(folder, *targets).wait(600) == status, (folder / "log.txt").read_text()


def _until(what: Callable[[], Any], seconds: float = 240.0) -> None:
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end
        time.sleep(0.5)


def _runs(folder: Path, name: str) -> int:
    """How often a job began."""
    path = folder / f"runs_{name}"
    return len(path.read_text().splitlines()) if path.exists() else 0


def _queued() -> list[str]:
    return _ask("squeue", "--noheader", "--format=%i").split()


def _unlock(folder: Path) -> None:
    command = _command(FAULTS, "--config", f"project={ROOT}", "--unlock")
    subprocess.run(command, cwd=folder, env=_environment(ROOT), check=True, capture_output=True)


def test_jobs_over_their_memory_or_time_are_tried_again_with_more(cluster, tmp_path):
    _finish(tmp_path, "out/memory_taken.txt", "out/time_taken.txt", "out/plain.txt")
    assert [_runs(tmp_path, name) for name in ("memory_taken", "time_taken", "plain")] == [2, 2, 1]


def test_a_cancelled_job_is_done_again_and_no_other(cluster, tmp_path):
    head = _start(tmp_path, "out/a.txt", "out/b.txt")
    _until(lambda: _runs(tmp_path, "a") and _runs(tmp_path, "b"))
    jobs = [line.split() for line in _ask("squeue", "--noheader", "--format=%i %k").splitlines()]
    _ask("scancel", *(job for job, comment in jobs if comment.endswith("_a")))
    assert head.wait(600) == 0
    assert [_runs(tmp_path, name) for name in "ab"] == [2, 1]


def test_jobs_wait_for_a_drained_node(cluster, tmp_path):
    node = _ask("sinfo", "--noheader", "--format=%n").split()[0]
    _ask("scontrol", "update", f"NodeName={node}", "State=DRAIN", "Reason=test")
    head = _start(tmp_path, "out/a.txt")
    _until(_queued)
    time.sleep(5)
    assert _runs(tmp_path, "a") == 0
    _ask("scontrol", "update", f"NodeName={node}", "State=RESUME")
    assert head.wait(600) == 0
    assert _runs(tmp_path, "a") == 1


def test_after_a_killed_head_nothing_is_lost_or_done_twice(cluster, tmp_path):
    head = _start(tmp_path, "out/a.txt", "out/b.txt")
    _until(lambda: _runs(tmp_path, "a") and _runs(tmp_path, "b"))
    head.send_signal(signal.SIGKILL)
    head.wait()
    assert _queued()
    _unlock(tmp_path)
    _finish(tmp_path, "out/a.txt", "out/b.txt", "out/c.txt")
    assert [_runs(tmp_path, name) for name in "abc"] == [1, 1, 1]


def test_a_full_disk_is_an_error_and_the_next_run_goes_on(cluster, tmp_path):
    disk = tmp_path / "out"
    disk.mkdir()
    _ask("mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(disk))
    try:
        (disk / "a.txt").parent.joinpath("filler").write_bytes(b"0" * 65536)
        _finish(tmp_path, "out/a.txt", status=1)
        assert not (disk / "a.txt").exists()
        (disk / "filler").unlink()
        _finish(tmp_path, "out/a.txt")
        assert (disk / "a.txt").read_text() == "done\n"
    finally:
        _ask("umount", str(disk))


def _refused(folder: Path, environment: dict[str, str]) -> str:
    """The one line that Snakemake with the profile ends with."""
    command = _command(FAULTS, "--config", f"project={ROOT}", "--", "out/a.txt")
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 2, done.stderr
    (line,) = (line for line in done.stderr.splitlines() if "error" in line.lower())
    return line


def test_what_is_lacking_is_said_in_one_line(cluster, tmp_path):
    _ask("scontrol", "update", "PartitionName=main", "Default=NO")
    said = _refused(tmp_path, _environment(ROOT))
    _ask("scontrol", "update", "PartitionName=main", "Default=YES")
    assert said.startswith("error: Slurm: no default partition; set PARTITION in workflow/profiles/slurm/config.yaml")
    for name in ("which", "bash", "sh"):
        (tmp_path / name).symlink_to(str(shutil.which(name)))
    said = _refused(tmp_path, {**_environment(ROOT), "PATH": str(tmp_path)})
    assert said.startswith("error: Slurm: sbatch is not on the PATH; ")


SMALL = {
    "designs": [],
    "fdtd": True,
    "fdtd_designs": ["mark1e_te"],
    "block_minutes": 2.0,
    "fdtd_tolerance": 0.5,
    "modal": {"u_max": 0.2, "v_max": 0.2, "tolerance": 0.05},
    "fdtd_grid": {"u_max": 0.05, "v_max": 0.05, "tolerance": 0.3},
    "floquet": ["small"],
    "maps": [],
    "rigid": ["small"],
    "flight": ["small"],
    "basins": [],
}
TARGETS = [
    "results/tables/mark1e_te/modal.h5",
    "results/tables/mark1e_tm/modal.h5",
    "results/tables/mark1e_te/fdtd/nodes.json",
    "results/tables/mark1e_te/fdtd.h5",
    "results/scenes/small/floquet.json",
    "results/scenes/small/rigid.h5",
    "results/scenes/small/flight.vtkhdf",
]


def _project(folder: Path) -> Path:
    """A copy of the project with a small scene and a configuration of it, FDTD included."""
    for name in ("beamrider", "optics", "dynamics", "workflow", "tests"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "Snakefile", folder)
    scene = yaml.safe_load((folder / "workflow/scenes/fig6.yaml").read_text())
    scene |= {"name": "small", "rigid": {"duration_s": 0.05}}
    scene["sail"]["rings"] = 4
    scene["flight"] |= {"duration_s": 1e-3, "optics_every": 4, "heat_every": 4, "series_every": 8}
    (folder / "workflow/scenes/small.yaml").write_text(yaml.safe_dump(scene))
    (folder / "small.yaml").write_text(yaml.safe_dump(SMALL))
    return folder


def _content(path: Path) -> Any:
    """All that a result says but times."""
    if path.suffix == ".json":
        return json.loads(path.read_text())
    found: dict[str, Any] = {}

    def take(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and name.split("/")[-1] not in TIMES:
            values = np.asarray(item[()])
            found[name] = values.tolist() if values.dtype.hasobject else values.tobytes()
        found.update({f"{name}:{key}": str(value) for key, value in item.attrs.items() if key not in TIMES})

    with h5py.File(path) as file:
        file.visititems(take)
        take("", file)
    return found


@pytest.fixture(scope="session")
def project(tmp_path_factory) -> Path:
    """A project whose small configuration was made without Slurm, in `local`; machine code is compiled for it alone."""
    folder = _project(tmp_path_factory.mktemp("project"))
    command = [sys.executable, "-m", "snakemake", "--cores", "1", "--configfile", "small.yaml", "--", *TARGETS]
    done = subprocess.run(command, cwd=folder, env=_environment(folder), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (folder / "results").rename(folder / "local")
    return folder


def test_a_small_configuration_has_the_same_bits_as_locally(cluster, project):
    for name in ("results", ".snakemake"):
        shutil.rmtree(project / name, ignore_errors=True)

    def snakemake(*more: str) -> str:
        command = _command(project / "Snakefile", "--configfile", "small.yaml", *more, "--", *TARGETS)
        done = subprocess.run(command, cwd=project, env=_environment(project), capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout + done.stderr

    assert ("Slurm keeps no accounts here" in snakemake()) == (cluster == "")
    for target in TARGETS:
        assert _content(project / target) == _content(project / target.replace("results", "local", 1)), target
    assert "Nothing to be done" in snakemake("--dry-run")
