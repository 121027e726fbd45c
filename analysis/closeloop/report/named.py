"""Effects that were named or declared: parameters, intervals, evidence, in the contract's words."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from analysis.closeloop.contract import Verdict
from analysis.closeloop.identification.arms.gains import GAIN, gain_of_all
from analysis.closeloop.identification.balance.model import Model
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.balance.uncertainty import Fits, leave_out
from analysis.closeloop.identification.findings import Step, Trace
from analysis.closeloop.identification.parameters import (
    beside_its_like,
    parameters_of,
    part_of,
    spans_nonsense,
    under_both,
)
from analysis.closeloop.judgement.agreement import alternatives
from analysis.closeloop.report.separating import separating_trial
from analysis.closeloop.report.shared import MASSLESS, link_parameters
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.runs import TRAVEL
from sim.effects.catalogue import BY_NAME, LINK_INERTIA, VISCOELASTIC
from sim.effects.effect import ROUNDING
from sim.effects.laws.coupling import CoupledMotor, CrossJointCoupling
from sim.effects.laws.drive import PositionOffset
from sim.effects.laws.inertia import PLACE, GravityTorque, TurnedGravity

#: Parameters of a load that say where it hangs.
PLACES = ("distance", *PLACE)
#: A motor that turns with two joints.
MOTOR = CoupledMotor.name
#: Where links and gravity of a chain are: at no joint, though the entry stands at the first that
#: moves.
LINKS, BASE = "the links", "the base"
#: What tells a wrong zero from a base that stands askew.
LEVEL = "put a level on the base, since no movement tells it from gravity along another way"
ASKEW = "it seems to stand askew; put a level on the base"
#: What tells a coupling from wrong links beyond a joint that was only held.
ITSELF = "move this joint by itself, both ways, with the others at rest"
#: Parameters of further gravity along the axes of the world.
FURTHER_GRAVITY = tuple(GravityTorque.parameters)
#: A fitted model under another name, with the step that has it, its coefficients and its refits.
Renamed = tuple[tuple[str, int], Model, np.ndarray, Fits]


def effect_entries(found: Trace) -> list[dict[str, Any]]:
    """Return one entry for every effect of the answer, by held-out gain."""
    recording = found.rows.recording
    steps = sorted(found.steps, key=lambda step: -step.share(step.taken))
    named = found.verdict != Verdict.NOT_IDENTIFIABLE
    model, coefficients = found.fit_of_steps
    fits = leave_out(model, found.rows, coefficients) if steps else None
    renamed = _renamed(found) if len(steps) > 1 else []
    entries = []
    for step in steps:
        assert fits is not None
        candidate = step.taken.candidate
        effect, joint = candidate.effect, candidate.joint
        others = [other.candidate.effect.name for other in step.equals]
        if effect.name == GAIN.name and gain_of_all(model, coefficients, found.rows) is not None:
            others.append(LINK_INERTIA)
        trial = separating_trial(recording, joint, effect)
        if effect.name == PositionOffset.name and turns_all(recording, joint):
            others, trial = with_tilt(others, trial)
        if effect.name == CrossJointCoupling.name and only_held(recording, joint):
            others, trial = [*others, LINK_INERTIA], ITSELF
        others = [name for name in dict.fromkeys(others) if name != effect.name]
        entries.append(
            {
                "name": effect.name,
                "joint": recording.name(joint),
                "parameters": if_they_can_be(_parameters(found, step, fits, renamed)),
                "indistinguishable_from": others,
                "separating_trial": trial if others or not named else None,
                "evidence": {
                    "holdout_gain": step.share(step.taken),
                    "p_value": step.p_value,
                    "signature": effect.signature,
                },
                "mujoco_element": effect.element,
            }
        )
    return with_places(entries, recording.device.joints)


def _parameters(found: Trace, step: Step, fits: Fits, renamed: Sequence[Renamed]) -> dict[str, Any]:
    """Return the parameters of a step's effect, with intervals that hold what else is said."""
    (model, coefficients), candidate = found.fit_of_steps, step.taken.candidate
    if candidate.effect.name == LINK_INERTIA:
        return link_parameters(model, found.rows)
    own = parameters_of(model, coefficients, fits, part_of(model, candidate))
    entries = beside_its_like(own, model, found.rows, candidate)
    for key, other, sizes, left_out in renamed:
        if key != step.key and candidate in other.effects:
            there = parameters_of(other, sizes, left_out, part_of(other, candidate))
            entries = under_both(entries, there)
    return entries


def _renamed(found: Trace) -> list[Renamed]:
    """Return the fitted models under other names, each with the step that has another there.

    What is found beside an effect has an interval that holds its value under each of those names.
    """
    fits = [
        (step.key, other.model, other.score.coefficients) for step, other in alternatives(found)
    ]
    return [(key, model, own, leave_out(model, found.rows, own)) for key, model, own in fits]


def turns_all(recording: Recording, joint: int) -> bool:
    """Whether a joint turns all that moves: its wrong zero is a base that stands turned about it.

    (An opponent's device was 7 degrees out of level, and its encoder was blamed.)
    """
    model = recording.device.model
    body = model.body(recording.body(joint))
    on_base = model.body_weldid[model.body_parentid[body.id]] == 0
    return bool(on_base and model.body_jntnum[body.id] == 1 and recording.is_hinge(joint))


def only_held(recording: Recording, joint: int) -> bool:
    """Whether a robot's joint never moves: what others do to it wrong links beyond it do, too.

    (A stranger's arm of seven joints moved two of them, and three of the held were told coupled.)
    """
    return joint not in recording.limbs and np.ptp(recording.position[:, joint]) < TRAVEL


def with_tilt(others: list[str], trial: str) -> tuple[list[str], str]:
    """Return what looks like the zero of what turns all that moves, and what would tell.

    Args:
        others: effects that trials might tell from it.
        trial: that tells it from those.
    """
    return [*others, GravityTorque.name], f"{trial}; {LEVEL}" if others else LEVEL


def with_places(
    entries: Sequence[Mapping[str, Any]], joints: Sequence[str]
) -> list[dict[str, Any]]:
    """Return effects, each with where it is, in words.

    A motor that turns with two joints stands at both, for each feels it by its own share; it is one
    effect all the same, so that the second has `same_as`, the joint of the first.

    Args:
        entries: effects of a report.
        joints: names of the model's joints.
    """
    said: list[dict[str, Any]] = []
    motors: set[tuple[str, str, float]] = set()
    for entry in entries:
        place: dict[str, Any] = {"where": where(entry)}
        if entry["name"] == MOTOR:
            values = {name: entry["parameters"][name]["value"] for name in ("other_dof", "sense")}
            joint, other = entry["joint"], joints[int(values["other_dof"])]
            if (other, joint, values["sense"]) in motors:
                place = {"where": f"{joint}, the same motor as at {other}", "same_as": other}
            motors.add((joint, other, values["sense"]))
        said.append({**entry, **place})
    return said


def declared_entries(found: Trace) -> list[dict[str, Any]]:
    """Return the fitted values of every declared effect but the impedance, before and after.

    `value` and `ci90` are those of the repaired model. A coefficient that other declared effects
    explain whole has no value.
    """
    recording = found.rows.recording
    wanted = [d for d in recording.session.declared if d.effect != VISCOELASTIC.name]
    if not wanted:
        return []
    before, after = (_declared_values(*fit, found.rows) for fit in found.fits)
    entries = []
    for declared in wanted:
        key = declared.effect, declared.joint
        values = {
            name: {
                **entry,
                "before": before[key][name]["value"],
                "ci90_before": before[key][name]["ci90"],
            }
            for name, entry in after.get(key, {}).items()
        }
        entries.append({"effect": declared.effect, "joint": declared.joint, "parameters": values})
    return entries


def _declared_values(
    model: Model, coefficients: np.ndarray, rows: Rows
) -> dict[tuple[str, str], dict[str, Any]]:
    """Return the parameters of a fitted model's declared effects, by effect and joint."""
    fits = leave_out(model, rows, coefficients)
    return {
        (term.effect.name, model.recording.name(term.joint)): parameters_of(
            model, coefficients, fits, term
        )
        for term in model.terms
        if term.candidate is None and term.load is None and term.effect not in (None, VISCOELASTIC)
    }


def without_value(entries: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a warning for every declared effect that the fit gives no value."""
    lines = []
    for entry in entries:
        if not entry["parameters"]:
            why = (
                "it changes the whole effort signal; such effects are fitted only if undeclared"
                if BY_NAME[entry["effect"]].channel
                else "other declared effects explain all of it, or its joint does not move"
            )
            lines.append(f"declared {entry['effect']} of {entry['joint']} has no value: {why}")
    return lines


def if_they_can_be(entries: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return parameters as each can be (`_if_it_can_be`); what may have no mass has no place."""
    found = {name: _if_it_can_be(entry) for name, entry in entries.items()}
    if "refused" not in found.get("mass", {}):
        return found
    nowhere = {"value": None, "ci90": None, "refused": MASSLESS}
    return {
        name: entry
        if name not in PLACES or "refused" in entry
        else entry | nowhere | {"fitted": entry["value"]}
        for name, entry in found.items()
    }


def _if_it_can_be(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Return a parameter without the limits it was held to, and without a value if it has none.

    Then `fitted` is what it is in the model whose errors are told, if that is what it can be.
    """
    kept = {key: value for key, value in entry.items() if key not in ("free", "limits")}
    if "free" not in entry or not spans_nonsense(entry["free"], entry["value"], entry["limits"]):
        return kept
    (low, high), (least, most) = entry["free"], entry["limits"]
    unit = "" if entry["unit"] == "1" else f" {entry['unit']}"
    possible = least - ROUNDING <= entry["value"] <= most + ROUNDING
    return kept | {
        "value": None,
        "ci90": None,
        "fitted": entry["value"] if possible else None,
        "refused": f"its 90 % interval, {low:.3g} to {high:.3g}{unit}, reaches too far beyond what "
        f"is possible ({_between(least, most)})",
    }


def _between(least: float, most: float) -> str:
    """Say which values are possible."""
    if np.isinf(most):
        return f"{least:.3g} or more"
    return f"{most:.3g} or less" if np.isinf(least) else f"{least:.3g} to {most:.3g}"


def where(entry: Mapping[str, Any]) -> str:
    """Return where an effect of a report is: its joint, but of what all joints share."""
    if entry.get("mujoco_element") == TurnedGravity.element:
        return BASE
    return LINKS if entry["name"] == LINK_INERTIA else str(entry["joint"])


def refused_values(entries: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a warning for every parameter of a found effect whose estimate is refused."""
    return [
        f"{entry['name']} of {where(entry)}: {name} is not determined, because "
        f"{parameter['refused']}"
        for entry in entries
        for name, parameter in entry["parameters"].items()
        if "refused" in parameter
    ]


def undetermined(entries: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a warning for every found effect of which no size is surely other than zero."""
    return [
        f"{entry['name']} of {where(entry)}: the 90 % interval of {_listed(sizes)} holds "
        "zero; it lowers the error, but these trials do not show how large it is"
        for entry in entries
        if (sizes := _sizes(entry))
        and all(
            parameter["ci90"] is None or parameter["ci90"][0] <= 0.0 <= parameter["ci90"][1]
            for parameter in sizes.values()
        )
    ]


def _sizes(entry: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the parameters that an effect is nothing without; all of what has none of its own."""
    every: Mapping[str, Any] = entry["parameters"]
    known = BY_NAME[entry["name"]].coefficients if entry["name"] in BY_NAME else ()
    return {name: every[name] for name in known if name in every} or every


def _listed(sizes: Mapping[str, Any]) -> str:
    """Return which parameters, as a sentence names them."""
    return f"each of {', '.join(sizes)}" if len(sizes) > 1 else next(iter(sizes))


def supposed(entries: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a warning for every parameter of a found effect that is assumed and no estimate."""
    return [
        f"{entry['name']} of {where(entry)}: {name} is assumed to be {parameter['value']:g}, as "
        "where nothing shows it: these trials do not tell how large it is; the intervals of its "
        "other parameters hold only if it is that"
        for entry in entries
        for name, parameter in entry["parameters"].items()
        if parameter["ci90"] == [parameter["value"]] * 2
        and _neutral(entry["name"], name) == parameter["value"]
    ]


def _neutral(effect: str, parameter: str) -> float | None:
    """Return what a parameter is where nothing tells it; None for a choice, and of single links."""
    known = BY_NAME[effect].parameters.get(parameter) if effect in BY_NAME else None
    return None if known is None or known.choice else known.neutral


def of_gravity(recording: Recording, entries: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a warning for every joint at which gravity seems to be another than declared."""
    declared = recording.gravity
    lines = []
    for entry in entries:
        further = [entry["parameters"].get(name, {}).get("value") for name in FURTHER_GRAVITY]
        if None not in further and where(entry) == BASE:
            lines.append(
                f"all joints move as in a gravity of {_vector(declared + further)} m/s2, not "
                f"{_vector(declared)} as declared: {ASKEW}"
            )
        elif None not in further:
            lines.append(
                f"{entry['joint']} moves as in a gravity of {_vector(declared + further)} m/s2, "
                f"not {_vector(declared)} as declared: is its effort logged after gravity "
                "compensation, does something balance it, or is the device mounted another way?"
            )
    return lines


def late_efforts(entries: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a sentence for every effort that is late: a filter that is not declared looks so."""
    delays = [(entry, entry["parameters"].get("delay", {}).get("value")) for entry in entries]
    return [
        f"the effort of {entry['joint']} was recorded {-1e3 * delay:.3g} ms after its position; a "
        f"low-pass of {-1.0 / (2.0 * np.pi * delay):.2g} Hz looks so: if it has one, say "
        '"effort_filter_hz" in session.json'
        for entry, delay in delays
        if delay is not None and delay < 0.0
    ]


def _vector(values: np.ndarray) -> str:
    # Adding zero turns what is rounded to -0 into 0.
    return f"[{', '.join(f'{value:.3g}' for value in np.round(values, 2) + 0.0)}]"
