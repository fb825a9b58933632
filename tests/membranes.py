"""Small flexible sails for tests: a scene with parts replaced, and flights of a few rings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from dynamics.membrane.effects import thermal
from dynamics.membrane.flight import Flight
from dynamics.membrane.lattice import side_moduli
from dynamics.membrane.layout import rows
from dynamics.membrane.output.record import COLUMNS, SIZES, WIDTH
from dynamics.membrane.stepping.step import run
from dynamics.membrane.stepping.threads import sweep_all
from dynamics.scene.schema import Scene, read_scene
from tests.synthetic import smooth_tables

_SCENE = read_scene(Path(__file__).parents[1] / "workflow" / "scenes" / "fig6.yaml")
FILM = {
    "thickness_m": 400e-9,
    "density_kg_m3": 2700.0,
    "young_Pa": 270e9,
    "poisson": 0.27,
    "strength_Pa": 6.4e9,
    "conductivity_W_mK": 3.0,
    "heat_capacity_J_kgK": 800.0,
    "expansion_1_K": 2.3e-6,
    "emissivity_front": 0.1,
    "emissivity_back": 0.1,
    "absorptance": 1e-5,
    "failure_temperature_K": 1673.15,
}


def altered(base: Scene, **groups: Any) -> Scene:
    """A scene with some keys of its groups (or whole entries) replaced."""
    data = base.model_dump()
    for name, value in groups.items():
        data[name] = {**(data[name] or {}), **value} if isinstance(value, dict) else value
    return Scene.model_validate(data)


# Coarse meshes take longer steps: light, heat and rows are renewed more often than on the scene's own mesh.
FIG6 = altered(_SCENE, flight={"optics_every": 4, "heat_every": 4, "series_every": 8})


def film(**material: Any) -> list[dict[str, Any]]:
    """One sector all round, of constant reflectance, with some of its material's properties replaced."""
    reflectance = material.pop("reflectance", 0.5)
    return [{"from_deg": 0.0, "material": {**FILM, **material}, "reflectance": reflectance}]


def small(base: Scene = FIG6, rings: int = 5, **groups: Any) -> Scene:
    """`altered` with a coarse mesh."""
    return altered(base, sail={"rings": rings, **groups.pop("sail", {})}, **groups)


def dark(rings: int = 5, **groups: Any) -> Scene:
    """A small film without light, spin or heat."""
    sail = {"sectors": film(emissivity_front=0.0, emissivity_back=0.0), **groups.pop("sail", {})}
    beam = {"intensity_W_m2": 0.0, **groups.pop("beam", {})}
    release = {"offset_m": [0.0, 0.0], "pitch_deg": 0.0, "roll_deg": 0.0, "spin_Hz": 0.0, **groups.pop("release", {})}
    return small(rings=rings, sail=sail, beam=beam, release=release, **groups)


def steps(flight: Flight, count: int, fresh: bool = True) -> np.ndarray:
    """Rows of `count` steps from the flight's state, without its release."""
    rows = np.empty((count // flight.model.series_every + 3, WIDTH))
    code, n, written = run(flight.model, flight.state, flight.work, flight.step, flight.step + count, fresh, rows)
    assert code == 0
    flight.step = n
    return rows[:written]


def write_inputs(folder: Path, scene: Scene, out: str = "flight.vtkhdf") -> list[str]:
    """Scene and smooth tables as files; the arguments of a stage that goes from them to folder/out/`out`."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{scene.name}.yaml"
    path.write_text(yaml.safe_dump(scene.model_dump()), encoding="utf-8")
    names = []
    for name, table in smooth_tables().items():
        table.write(folder / f"{name}.h5")
        names.append(str(folder / f"{name}.h5"))
    return ["--scene", str(path), "--tables", *names, "--out", str(folder / "out" / out)]


def column(rows: np.ndarray, name: str) -> np.ndarray:
    """A quantity of rows (…, WIDTH): (…,) or (…, length)."""
    length = SIZES[name][0]
    values = rows[..., COLUMNS[name] : COLUMNS[name] + length]
    return values[..., 0] if length == 1 else values


def heating(flight: Flight) -> np.ndarray:
    """Rate (n,) in K/s of the temperatures of a flight's state in the dark."""
    own, work, state = flight.model.effects, flight.work.effects, flight.state
    thermal.begin(work.heat)
    thermal.add_flows(
        own.heat,
        work.heat,
        own.springs,
        flight.model.triangles.corners,
        rows.patch(flight.work.stencil.scratch, 0),
        state.x,
        state.temperature,
        work.light.absorbed,
        0.0,
    )
    thermal.end(work.heat)
    return work.heat.rate


def stencil_forces(flight: Flight, x: np.ndarray, gain: float = 0.0) -> tuple[np.ndarray, int]:
    """Forces (3, n) in N on nodes x (3, n), by the stencil; how many elements may have failed."""
    m, work = flight.model, flight.work.stencil
    rows.scatter(m.stencil.place, np.ascontiguousarray(x), work.scratch.x[0])
    bad = sweep_all(m.stencil, work, 0, rows.StepTimes(False, 0.0, 0.0, 0.0, gain / 3.0))
    found = np.empty_like(x)
    rows.gather(m.stencil.place, work.scratch.v[1], found)
    return found * m.masses, bad


#: Nodal diameters and circles of drum modes.
DRUM_MODES = [(1, 0), (2, 0), (3, 0), (0, 1), (1, 1), (2, 1)]


def drum_mode(nodes: np.ndarray, diameters: int, circles: int) -> tuple[float, np.ndarray]:
    """ω/Ω of a mode of a disc of `FILM` that spins at Ω, in the turning frame, and its two shapes (2, n) at nodes.

    ω²/Ω² = ((m + 2n)(m + 2n + 2)(3 + ν) − m²(1 + 3ν))/8, m nodal diameters, n = 0 or 1 nodal circles (Lamb & Southwell,
    Proc. R. Soc. A 99 (1921) 272). Mode (1, 0) is the tilt: ω = Ω.
    """
    k, poisson = diameters + 2 * circles, FILM["poisson"]
    square = (k * (k + 2) * (3 + poisson) - diameters**2 * (1 + 3 * poisson)) / 8
    r, angle = np.hypot(nodes[:, 0], nodes[:, 1]), np.arctan2(nodes[:, 1], nodes[:, 0])
    r /= r.max()
    a, b = 1.0, diameters + 2.0 * circles + 1.0
    radial = r**diameters * (1.0 - circles * (b + a) / (diameters + 1.0) * r**2)
    return float(np.sqrt(square)), radial * np.stack([np.cos(diameters * angle), np.sin(diameters * angle)])


def tensions(flight: Flight, x: np.ndarray) -> np.ndarray:
    """Tension over length (e,) in N/m of the edges at nodes x (3, n): of springs, or 2 ∂U/∂q of triangles beside."""
    mesh, springs = flight.membrane.mesh, flight.model.effects.springs
    a, b = mesh.edges.T
    squares = np.sum((x[:, b] - x[:, a]) ** 2, axis=0)
    if not flight.membrane.elastic_triangles:
        return springs.stiffness * (1.0 - springs.rest / np.sqrt(squares))
    excess = (squares - mesh.lengths**2)[mesh.triangle_edges]
    each = 2.0 * np.einsum("tij,tj->ti", side_moduli(flight.membrane.scene.sail, mesh), excess)
    return np.bincount(mesh.triangle_edges.ravel(), each.ravel(), minlength=len(a))


def normals(flight: Flight) -> np.ndarray:
    """Normals (3, t) of the triangles as the light met them last."""
    a, b, c = flight.work.ahead.T[flight.membrane.mesh.triangles].transpose(1, 0, 2)
    across = np.cross(b - a, c - a)
    return (across / np.linalg.norm(across, axis=1)[:, None]).T


def edge_forces(flight: Flight, x: np.ndarray) -> np.ndarray:
    """Forces (3, n) in N on nodes x (3, n), edge by edge."""
    a, b = flight.membrane.mesh.edges.T
    pull, found = tensions(flight, x) * (x[:, b] - x[:, a]), np.zeros_like(x)
    for c in range(3):
        np.add.at(found[c], a, pull[c])
        np.subtract.at(found[c], b, pull[c])
    return found
