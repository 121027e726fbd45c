"""From a found effect to a study in which its parameters are uncertain factors."""

from collections.abc import Mapping
from typing import Any

from sim.effects.catalogue import ASSESSED
from sim.effects.parameter import Parameter
from sim.models import MODELS, WITH_EFFECTS
from sim.parameters.effects import PREFIX
from sim.parameters.wearer import TABLE_1

#: An interval narrower than this share of its value holds nothing to sample.
NARROW = 1e-6


class EffectStudyError(ValueError):
    """A report from which no study can be made; the message says why and what would be right."""


def study_with_effects(
    report: Mapping[str, Any],
    *,
    model: str,
    method: str,
    rows: int,
    seed: int = 1,
    from_none: bool = False,
) -> dict[str, Any]:
    """Return a study in which the parameters of the found effects are factors beside Table 1's.

    Each parameter is uniform over its 90 % interval; one without an interval keeps its value.

    Args:
        report: `report.json` of closing the loop, with the verdict `effect_found`.
        model: a model that carries effects (`sim.models.WITH_EFFECTS`).
        method: "morris" or "saltelli".
        rows: of the design.
        seed: of the design.
        from_none: sample the size of each effect from none to the far end of its interval, which
            ranks the effect's presence instead of what is left unknown of it.

    Returns:
        The body of `POST /v1/studies`.

    Raises:
        EffectStudyError: the report names no effect, or one that the simulation cannot carry.
    """
    if model not in WITH_EFFECTS:
        raise EffectStudyError(f"{model} carries no effects; take {' or '.join(WITH_EFFECTS)}")
    effects = _found(report)
    factors: list[dict[str, Any]] = [{"name": factor.name} for factor in TABLE_1]
    fixed: dict[str, float] = {}
    for effect in effects:
        for name, entry in effect["parameters"].items():
            known = ASSESSED[effect["name"]].parameters.get(name)
            if known is None:
                raise EffectStudyError(
                    f"{effect['name']} has no parameter {name!r} in the simulation"
                )
            if entry["value"] is None:
                raise EffectStudyError(f"{effect['name']}: {name} is not determined")
            factor = f"{PREFIX}{effect['name']}.{name}"
            low, high = _interval(entry, known, from_none=from_none)
            if known.choice or high - low <= NARROW * max(abs(low), abs(high)):
                fixed[factor] = known.within_limits(float(entry["value"]))
            else:
                factors.append({"name": factor, "range": [low, high]})
    names = ", ".join(effect["name"] for effect in effects)
    return {
        "name": f"{method} with {names}",
        "model": model,
        "method": method,
        "rows": rows,
        "seed": seed,
        "factors": factors,
        "fixed": fixed,
        # What was measured is where it is.
        "outside_range": True,
        "outputs": [output for output in MODELS[model].outputs if "_authors" not in output],
    }


def _found(report: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return the report's effects once they are known to be carried by one joint."""
    try:
        verdict, effects = report["verdict"], list(report["effects"])
        joints = sorted({effect["joint"] for effect in effects})
        named = {effect["name"]: list(effect["parameters"]) for effect in effects}
        own_frame = report.get("session", {}).get("model") != "nominal"
    except (KeyError, TypeError, AttributeError):
        raise EffectStudyError(
            "this is no report.json of `rehyb close-loop`: verdict or effects are missing"
        ) from None
    if verdict != "effect_found":
        raise EffectStudyError(f"the report names no effect (its verdict is {verdict})")
    for effect, parameters in named.items():
        if effect not in ASSESSED:
            raise EffectStudyError(
                f"the simulated assessment cannot carry {effect}; it carries {', '.join(ASSESSED)}"
            )
        known = ASSESSED[effect].parameters
        angles = [name for name in parameters if name in known and known[name].in_joint_frame]
        if own_frame and angles:
            raise EffectStudyError(
                f"{effect} has {', '.join(angles)}, told by how the session's own model counts "
                'its angle; analyse the session with "model": "nominal" to carry it over'
            )
    if len(joints) != 1:
        raise EffectStudyError(
            f"the effects are at {', '.join(joints)}, and an assessment moves one joint; list the "
            "others in ignored_joints and close the loop again"
        )
    return effects


def _interval(
    entry: Mapping[str, Any], known: Parameter, *, from_none: bool
) -> tuple[float, float]:
    low, high = sorted(float(end) for end in entry["ci90"])
    if from_none and known.switches:
        far = high if abs(high - known.neutral) >= abs(low - known.neutral) else low
        low, high = sorted((known.neutral, far))
    return known.within_limits(low), known.within_limits(high)
