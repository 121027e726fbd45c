"""Impedance of the declared joints before and after the repair, in the contract's words."""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from analysis.closeloop.identification.balance.model import Model, evaluate, impedances, unfitted
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.balance.terms import Given
from analysis.closeloop.identification.balance.uncertainty import leave_out
from analysis.closeloop.identification.findings import TELLING, Outcome, Trace
from analysis.closeloop.judgement.agreement import APART, alternatives, other_forms
from analysis.closeloop.report.separating import separating_trial
from sim.effects.laws.loose_link import DAMPED

#: Effects that are listed of those that could move a stiffness.
MAX_HIDDEN = 5


class Refits:
    """A fitted model's impedances, and what they are without each trial and each place."""

    def __init__(self, model: Model, rows: Rows, coefficients: np.ndarray) -> None:
        self.values = impedances(model, coefficients)
        self.fits = leave_out(model, rows, coefficients)
        shares = {
            joint: found for (_, joint, name), found in self.fits.thetas.items() if name == DAMPED
        }
        self.refitted = [
            impedances(model, own, {joint: found[number] for joint, found in shares.items()})
            for number, own in enumerate(self.fits.coefficients)
        ]
        self.if_unsaid = [
            impedances(bent, evaluate(bent, rows).coefficients)
            for bent in with_unsaid(model, coefficients)
        ]

    def interval(self, joint: int, key: str) -> tuple[float, float]:
        """Return the 90 % interval of a joint's stiffness, damping or neutral angle."""
        every = np.array([values[joint][key] for values in self.refitted])
        low, high = self.fits.interval(every, self.values[joint][key])
        bias = self.bias(joint, key)
        return low - bias, high + bias

    def bias(self, joint: int, key: str) -> float:
        """Return how far a value is off at most by what the forms of effects leave out."""
        return sum(abs(bent[joint][key] - self.values[joint][key]) for bent in self.if_unsaid)


def with_unsaid(model: Model, coefficients: np.ndarray) -> Iterator[Model]:
    """Yield the model with what the form of each of its effects leaves out, at its largest.

    Trials cannot tell it from stiffness; an interval is as much longer as the bias may be
    (Armstrong and Kolesar 2018, Optimal inference in a class of regression models).
    """
    for term, own in model.split(coefficients):
        if term.candidate is None:
            continue
        recorded = unfitted(model.recording, term.joint)
        further = term.candidate.effect.unsaid(recorded, term.theta, own)
        if further:
            given = {} if model.given is None else model.given.torque
            torque = {joint: own + given.get(joint, 0.0) for joint, own in further.items()}
            yield replace(model, given=Given(torque={**given, **torque}))


def impedance_entries(found: Trace) -> dict[str, Any]:
    """Return stiffness, damping and neutral angle of every declared joint, before and after.

    Where names cannot be told apart, each has a value of its own; the interval holds them all.
    """
    recording = found.rows.recording
    if not impedances(*found.fits[0]):
        return {}
    before, after = (Refits(model, found.rows, own) for model, own in found.fits)
    others = _of_names(found)
    entries: dict[str, Any] = {}
    for joint in before.values:
        name = recording.name(joint)
        angle, unit = recording.device.angle_unit(name), recording.device.unit(name)
        units = {
            "stiffness": f"{unit}/{angle}",
            "damping": "Nm s/rad" if unit == "Nm" else "N s/m",
            "neutral_angle": angle,
        }
        entries[name] = {}
        for key, own_unit in units.items():
            entry: dict[str, Any] = {"unit": own_unit}
            for word, own in (("before", before), ("after", after)):
                entry[word] = own.values[joint][key]
                entry[f"ci90_{word}"] = list(own.interval(joint, key))
            if others:
                entry["after_if"] = {word: own.values[joint][key] for word, own in others.items()}
                every = [after, *others.values()]
                lows, highs = zip(*(own.interval(joint, key) for own in every), strict=True)
                entry["ci90_after"] = [min(lows), max(highs)]
            if bias := after.bias(joint, key):
                entry["may_be_off"] = bias
            entries[name][key] = entry
    return entries


def identified_entries(outcome: Outcome, impedance: Mapping[str, Any]) -> dict[str, Any]:
    """Return whether each joint's stiffness is identified, and what could move it how far.

    It is not where names that explain the trials alike move it apart, or where it may be none.

    Args:
        outcome: of the session.
        impedance: of every joint, as `impedance_entries` has it.
    """
    recording = outcome.trace.rows.recording
    values = impedances(*outcome.trace.fits[1])
    entries: dict[str, Any] = {}
    for joint, hidden in outcome.hidden.items():
        name, stiffness = recording.name(joint), abs(values[joint]["stiffness"])
        entries[name] = {
            "stiffness": outcome.identified(joint)
            and not _apart(impedance[name], TELLING)
            and not _may_be_none(impedance[name]),
            "unit": f"{recording.device.unit(name)}/{recording.device.angle_unit(name)}",
            "could_move": [
                {
                    "effect": one.effect.name,
                    "by": one.by,
                    "relative": one.by / max(stiffness, 1e-300),
                    "separating_trial": separating_trial(recording, joint, one.effect),
                }
                for one in hidden[:MAX_HIDDEN]
            ],
        }
    return entries


def _may_be_none(impedance: Mapping[str, Any]) -> bool:
    """Whether the interval of a joint's stiffness holds zero."""
    low, high = impedance["stiffness"]["ci90_after"]
    return bool(low <= 0.0 <= high)


def not_identified(entries: Mapping[str, Any]) -> list[str]:
    """Return a warning for every stiffness that effects which nobody saw could move."""
    lines = []
    for joint, entry in entries.items():
        if not entry["stiffness"]:
            said = ", ".join(
                f"{one['effect']} by {100 * one['relative']:.0f} %"
                for one in entry["could_move"]
                if one["relative"] > TELLING
            )
            if said:
                lines.append(
                    f"these trials do not identify the stiffness of {joint}: effects that "
                    f"they cannot show would change it, {said}"
                )
    return lines


def trials_that_tell(entries: Mapping[str, Any]) -> list[str]:
    """Return what to record where a stiffness is not identified."""
    return [
        f"To tell the stiffness of {joint} from {one['effect']}: {one['separating_trial']}."
        for joint, entry in entries.items()
        for one in entry["could_move"]
        if not entry["stiffness"] and one["relative"] > TELLING
    ]


def undecided(entries: Mapping[str, Any]) -> list[str]:
    """Return a warning for every stiffness that depends on which of several names is right."""
    lines = []
    for joint, values in entries.items():
        entry = values["stiffness"]
        if apart := _apart(values, APART):
            repaired = entry["after"] != entry["before"]
            given, other = "if nothing is repaired", "if the effect is"
            if repaired:
                given, other = "with the names that it has here", "with"
            said = ", ".join(f"{value:.3g} {other} {name}" for name, value in apart.items())
            instead = " in place of one that these trials do not tell from it" if repaired else ""
            lines.append(
                f"the stiffness of {joint} is {entry['after']:.3g} {entry['unit']} {given}, but "
                f"{said}{instead}; its interval holds them all"
            )
    return lines


def _apart(impedance: Mapping[str, Any], share: float) -> dict[str, float]:
    """Return the stiffness under the names by which it differs by more than a share of it."""
    entry = impedance["stiffness"]
    return {
        name: value
        for name, value in entry.get("after_if", {}).items()
        if abs(value - entry["after"]) > share * abs(entry["after"])
    }


def off_by_form(found: Trace, entries: Mapping[str, Any]) -> list[str]:
    """Return a warning for every stiffness that what an effect's form leaves out may move."""
    said = [step.taken.candidate.effect.leaves_out for step in found.steps]
    forms = " or ".join(filter(None, said))
    return [
        f"the stiffness of {joint} is off by up to {entry['may_be_off']:.2g} {entry['unit']} if "
        f"there is {forms}, which these trials cannot show; its interval allows for that"
        for joint, values in entries.items()
        if "may_be_off" in (entry := values["stiffness"])
    ]


def _of_names(found: Trace) -> dict[str, Refits]:
    """Return the fits under the names that the values before the repair do not already stand for.

    Beside a repair, the other names; where nothing is repaired, the name that is given first too.
    """
    at = {
        other.candidate.key: (other.model, other.score.coefficients)
        for _, other in alternatives(found)
    }
    if impedances(*found.fits[0]):
        at |= {key: (own, score.coefficients) for key, own, score in other_forms(found)}
    # A muscle over two joints is a coupling at each.
    twice = Counter(name for name, _ in at)
    fits = {
        f"{name} of {found.rows.recording.name(joint)}" if twice[name] > 1 else name: fit
        for (name, joint), fit in at.items()
    }
    if found.supposed is not None:
        names = " and ".join(step.taken.candidate.effect.name for step in found.steps)
        fits = {names: found.supposed, **fits}
    return {name: Refits(model, found.rows, own) for name, (model, own) in fits.items()}
