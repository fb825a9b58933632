"""Which effects a scene calls for, why, and what they cost."""

from __future__ import annotations

from beamrider.io.arguments import stage_arguments
from beamrider.io.files import finish, write_json
from dynamics.membrane.effects import EFFECTS
from dynamics.membrane.effects.interface import Plan
from dynamics.scene.schema import Scene, read_scene


def plan(scene: Scene) -> Plan:
    """Which effects the flexible flight computes, each with its reason; `effects:` in the scene overrides."""
    found: Plan = {}
    for effect in EFFECTS:
        for name, decide in getattr(effect, "PLAN", {}).items():
            override = getattr(scene.effects, name, None)
            decision = decide(scene, found)
            if override is not None:
                decision = decision.model_copy(update={"on": override, "reason": f"effects.{name} in the scene"})
            found[name] = decision.model_copy(update={"cost": effect.COST}) if decision.on else decision
    return found


def main() -> None:
    """Write which effects a scene calls for, each with its reason."""
    arguments = stage_arguments("dynamics.scene", main.__doc__, "JSON file to write", tables=False)
    effects = plan(read_scene(arguments.scene))
    write_json(arguments.out, {name: effect.model_dump() for name, effect in effects.items()})
    on = sum(effect.on for effect in effects.values())
    finish(arguments.out, arguments.watch, f"{on} of {len(effects)} effects on")
