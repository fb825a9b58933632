"""Which effects a scene calls for, and why."""

from __future__ import annotations

import math

from beamrider.io.files import Strict, write_json
from dynamics.sail.shapes import rim_slope
from dynamics.scene.command_line import finish, stage_arguments
from dynamics.scene.schema import Effects, Scene, read_scene

EFFECTS = tuple(Effects.model_fields)


class Effect(Strict):
    """One line of the plan: is the effect computed, and why."""

    on: bool
    reason: str


def _reflections(scene: Scene, lit: bool) -> Effect:
    """Whether light along the axis can meet the sail twice.

    Off a slope s it leaves at 2s from where it came; the rest of the sail lies at most by the steepest slope S above
    the horizon, so 3S > 90° is needed, and a tilt adds to S.
    """
    steep = math.degrees(rim_slope(scene.sail)) + math.hypot(scene.release.pitch_deg, scene.release.roll_deg)
    bright = any(region.design or region.reflectance for region in scene.sail.regions)
    if not (lit and bright):
        return Effect(on=False, reason="nothing reflects light")
    if scene.reflections.polarisation == "tracked":
        return Effect(on=True, reason="the light's polarisation is tracked, from its first hit on")
    if scene.sail.profile == "flat":
        return Effect(on=False, reason="a flat sail does not reflect onto itself")
    if steep <= 30.0:
        return Effect(on=False, reason=f"slopes of {steep:.3g}°, up to 30° no light meets the sail twice")
    return Effect(on=True, reason=f"slopes of {steep:.3g}°, above 30°, and reflecting")


def _derived(scene: Scene) -> dict[str, Effect]:
    materials = [region.properties for region in scene.sail.regions]
    lit = scene.beam.intensity_W_m2 > 0
    heated = lit and any(
        scene.tabled(region) or region.properties.highest("absorptance") > 0 for region in scene.sail.regions
    )
    emits = any(m.highest("emissivity_front") + m.highest("emissivity_back") > 0 for m in materials)
    spins = scene.release.spin_Hz != 0
    conducts = any(m.highest("conductivity_W_mK") > 0 for m in materials)
    expansion = scene.flight.expansion_1_K
    expands = expansion != 0 if expansion is not None else any(m.highest("expansion_1_K") > 0 for m in materials)
    damps = any(m.damping_s > 0 for m in materials)
    return {
        "light": Effect(on=lit, reason=f"intensity {scene.beam.intensity_W_m2:g} W/m²"),
        "reflections": _reflections(scene, lit),
        "spin_up": Effect(on=spins, reason=f"spin {scene.release.spin_Hz:g} Hz"),
        "absorption": Effect(on=heated, reason="light on an absorber" if heated else "nothing absorbs light"),
        "emission": Effect(on=emits, reason="emissivity above zero" if emits else "emissivity zero everywhere"),
        "conduction": Effect(on=conducts, reason="conductivity above zero" if conducts else "no conductivity"),
        "expansion": Effect(on=expands, reason="expansion coefficient given" if expands else "expansion zero"),
        "damping": Effect(on=damps, reason="a material with damping" if damps else "no material has damping"),
        "held": Effect(on=scene.held is not None, reason="held" if scene.held else "nothing holds the sail"),
        "payload": Effect(on=bool(scene.payload), reason=f"{len(scene.payload)} point masses on tethers"),
        "tensile_failure": Effect(on=True, reason="every material has a strength"),
        "thermal_failure": Effect(on=True, reason="every material has a failure temperature"),
    }


def plan(scene: Scene) -> dict[str, Effect]:
    """Which effects the flexible flight computes, each with its reason; `effects:` in the scene overrides."""
    result = _derived(scene)
    for name in EFFECTS:
        override = getattr(scene.effects, name)
        if override is not None:
            result[name] = Effect(on=override, reason=f"effects.{name} in the scene")
    needs_heat = ("conduction", "expansion", "thermal_failure")
    if not (result["absorption"].on or result["emission"].on):
        for name in needs_heat:
            if getattr(scene.effects, name) is None:
                result[name] = Effect(on=False, reason="no heat comes or goes: the temperature stays uniform")
    return result


def main() -> None:
    """Write which effects a scene calls for, each with its reason."""
    arguments = stage_arguments("dynamics.scene", main.__doc__, "JSON file to write", tables=False)
    effects = plan(read_scene(arguments.scene))
    write_json(arguments.out, {name: effect.model_dump() for name, effect in effects.items()})
    on = sum(effect.on for effect in effects.values())
    finish(arguments.out, arguments.watch, f"{on} of {len(effects)} effects on")
