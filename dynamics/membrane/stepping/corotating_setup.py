"""Setting up the semi-implicit scheme in the frame of a spinning flat sail (`corotating`)."""

from __future__ import annotations

import math

import numpy as np
from scipy.sparse import csr_matrix, diags, kron
from scipy.sparse.linalg import eigsh

from beamrider.arrays import Floats
from beamrider.io.files import InputError
from dynamics.membrane.arrays import Model
from dynamics.membrane.lattice import (
    cotangents,
    highest_frequency,
    membrane_thickness,
    over_edges,
    per_triangle,
    sheet_matrix,
)
from dynamics.membrane.plan import plan
from dynamics.membrane.stepping.corotating import Corotating, CorotatingWork
from dynamics.membrane.stepping.dissection_setup import factorise, solution_space
from dynamics.sail.mesh import Mesh
from dynamics.scene.schema import Scene

#: Turns of the sail in a step when the scene gives none, and the most.
TURN, MOST_TURN = 1 / 100, 1 / 40
#: How much stiffer than the tension of the spin the scheme takes the sail across its plane; how much of it is for
#: tensions along one side of a triangle that come with less strain along its edges.
STIFFER, SPARE = 4.0, 1.5
#: How many times stiffer than that it may get where strain or slopes ask for it, each time twice as stiff.
STIFFEST = 64.0
#: Share of the stability bound that the explicit steps of the spin-up take.
EXPLICIT = 0.8
#: Share of Δt² K beside M in the plane; ¼ is stable for waves in one direction, twice as much where slopes couple two.
#: Across it that of Δt⁴ K M⁻¹ K: with σ = (ω Δt)², leapfrog is stable for σ ≤ 4(1 + σ²/64), so for all.
IN_PLANE, ACROSS = 0.5, 1.0 / 64.0
#: The time τ of damping in steps in the plane: at 1 waves much faster than the steps are gone after one. Share of the
#: velocity of the shortest waves across it that is lost in a step.
DAMPED, DAMPED_ACROSS = 1.0, 0.02


def time_step(scene: Scene) -> float:
    """The time step in s of the scheme; InputError where it can't fly the scene."""
    _check(scene)
    most = MOST_TURN / abs(scene.release.spin_Hz)
    given = scene.flight.time_step_s
    if given is not None and given > most:
        raise InputError(
            f"{scene.name}.yaml: flight.time_step_s = {given:g}: must not exceed {most:.4g} s with integrator: "
            f"corotating, a turn of {360 * MOST_TURN:g}° of the sail"
        )
    return given or float(f"{TURN / abs(scene.release.spin_Hz):.4e}")


def chord_speed(scene: Scene, dt: float) -> float:
    """Speed of nodes with which they go round at the rate of the spin Ω along chords, over that on their circles.

    sin(Ω Δt)/(Ω Δt), the component along the circle of the chords' speed 2 r sin(Ω Δt/2)/Δt.
    """
    return float(np.sinc(2.0 * scene.release.spin_Hz * dt))


def _check(scene: Scene) -> None:
    """InputError where the stiffness of the flat, spinning sail is not that of the flight."""
    flight, effects = scene.flight, plan(scene)
    for key, value, allowed in (
        ("sail.profile", scene.sail.profile, "flat"),
        ("flight.stiffness", flight.stiffness, "triangles"),
        ("flight.on_failure", flight.on_failure, "stop"),
        ("flight.optics_every", flight.optics_every, 1),
        ("flight.heat_every", flight.heat_every, 1),
        ("effects.damping", effects["damping"].on, False),
        ("effects.spin_up", effects["spin_up"].on, True),
    ):
        if value != allowed:
            raise InputError(f"{scene.name}.yaml: {key} = {value!r}: must be {allowed!r} with integrator: corotating")
    if scene.release.spin_Hz == 0:
        raise InputError(f"{scene.name}.yaml: release.spin_Hz = 0: must not be 0 with integrator: corotating")


def _tension(scene: Scene, mesh: Mesh) -> float:
    """Largest tension (3 + ν)/8 χ Ω² R² in N/m of a spinning disc (Timoshenko & Goodier, §32)."""
    poisson, areal_mass = per_triangle(scene.sail, mesh, "poisson"), per_triangle(scene.sail, mesh, "areal_mass")
    speed = 2.0 * math.pi * scene.release.spin_Hz * float(np.hypot(*mesh.nodes[:, :2].T).max())
    return float((areal_mass * (3.0 + poisson)).max()) / 8.0 * speed**2


def _membrane(mesh: Mesh) -> csr_matrix:
    """Stiffness (n, n) across a membrane under a tension of 1 N/m: ½ cot of the angles opposite each edge."""
    n, weights, (a, b) = len(mesh.nodes), over_edges(mesh, 0.5 * cotangents(mesh)), mesh.edges.T
    joined = csr_matrix((np.tile(weights, 2), (np.r_[a, b], np.r_[b, a])), shape=(n, n))
    return csr_matrix(diags(np.asarray(joined.sum(axis=1)).ravel()) - joined)


def _fastest(membrane: csr_matrix, masses: Floats) -> float:
    """Highest frequency ω in rad/s across a membrane (n, n) under 1 N/m; 4/(Δt ω)² is the tension stable as it is."""
    scale = diags(1.0 / np.sqrt(masses))
    start = np.random.default_rng(0).standard_normal(masses.size)
    found = eigsh(scale @ membrane @ scale, k=1, which="LA", v0=start, return_eigenvectors=False, tol=1e-6)
    return float(np.sqrt(found[0]))


def corotating(scene: Scene, mesh: Mesh, masses: Floats, dt: float, stiffer: float = 1.0) -> Corotating:
    """The scheme's matrices, factorised, for steps of dt in s and masses (n,) in kg, and how its spin-up is flown.

    stiffer: how many times as stiff across its plane it takes the sail as it does at first.
    """
    n, points = masses.size, mesh.nodes[:, :2]
    angle = dt * 2.0 * math.pi * scene.release.spin_Hz
    plane = (3 * np.arange(n)[:, None] + [0, 1]).ravel()
    elastic = sheet_matrix(scene.sail, mesh)
    stiffness = elastic.tocsr()[plane][:, plane]
    inertia = np.array([[1.0, -angle], [angle, 1.0]]) / (1.0 + angle**2)
    membrane, tension = _membrane(mesh), stiffer * STIFFER * _tension(scene, mesh)
    across = dt**2 * tension * membrane
    fastest = tension * (dt * _fastest(membrane, masses)) ** 2
    spare = 4.0 * (1.0 + ACROSS * fastest**2) / fastest if fastest < 8.0 else 1.0
    gamma = IN_PLANE + 0.5 * DAMPED
    modulus = per_triangle(scene.sail, mesh, "young_Pa") * membrane_thickness(scene.sail, mesh)
    modulus /= 1.0 - per_triangle(scene.sail, mesh, "poisson") ** 2
    sides = np.zeros(len(mesh.edges), dtype=np.uint32)
    sides[mesh.triangle_edges.T.ravel()] = np.arange(mesh.triangle_edges.size)
    return Corotating(
        plane=factorise(csr_matrix(kron(diags(masses), inertia) + gamma * dt**2 * stiffness), points),
        across=factorise(csr_matrix(diags(masses) + ACROSS * across @ diags(1.0 / masses) @ across), points),
        calm=DAMPED / (gamma * dt),
        calm_across=DAMPED_ACROSS / dt,
        sides=sides,
        most=spare * tension / (SPARE * float(modulus.max())),
        substeps=math.ceil(dt * highest_frequency(elastic, masses) / (2.0 * EXPLICIT)),
    )


def corotating_work(scheme: Corotating, model: Model) -> CorotatingWork:
    """Work space of the scheme."""
    n = model.masses.size
    return CorotatingWork(
        positions=np.zeros((3, n)),
        drift=np.zeros((3, n)),
        field=np.zeros((3, n)),
        transport=np.zeros((3, n)),
        late=np.zeros((3, n)),
        plane=np.zeros(2 * n),
        across=np.zeros(n),
        frame=np.zeros((3, 3)),
        motion=np.zeros((8, 3)),
        rate=np.zeros(n if model.warm else 0),
        stiffer=np.ones(1),
        in_plane=solution_space(scheme.plane),
        out_of_plane=solution_space(scheme.across),
    )
