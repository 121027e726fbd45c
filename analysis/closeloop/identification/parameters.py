"""Physical parameters of a fitted effect, with their 90 % intervals."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from analysis.closeloop.identification.balance.model import (
    Model,
    evaluate,
    gain,
    unfitted,
    with_independent,
)
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.balance.terms import Candidate, Channel, Term
from analysis.closeloop.identification.balance.uncertainty import Fits, leave_out
from analysis.closeloop.identification.nameable import lowest
from sim.effects.catalogue import BY_NAME
from sim.effects.effect import ROUNDING, Theta
from sim.effects.motion import RecordedJoint

#: How many times the largest effort and the largest torque of the links together a torque may be
#: that an effect has: more was never there.
MOST_TORQUE = 2.0
#: Share of an interval beyond what a quantity can be with which it says nothing: [-1.9, 3.3] kg.
MOST_NONSENSE = 0.25
#: ... unless it is as short as this share of all that the quantity can be.
SHARP = 0.25
#: What friction has besides.
ITS_LIKE = {"coulomb_friction": "viscous_friction", "viscous_friction": "coulomb_friction"}


def beside_its_like(
    entries: dict[str, Any], model: Model, rows: Rows, candidate: Candidate
) -> dict[str, Any]:
    """Return parameters with the intervals that they have beside what friction has besides, too.

    Coulomb and viscous friction are hardly told apart at one speed. That one has nothing to show
    does not say that it is not there: what is known of the other is what holds either way.
    """
    name = ITS_LIKE.get(candidate.effect.name)
    if name is None or candidate.joint in rows.recording.limbs:
        # A limb's own damping is there.
        return entries
    there = {
        other
        for term in model.terms
        if term.effect is not None and term.joint == candidate.joint
        for other in (term.effect.name, *term.effect.includes)
    }
    if name in there:
        return entries
    effect, joint = BY_NAME[name], unfitted(rows.recording, candidate.joint)
    like = Candidate(effect=effect, joint=candidate.joint)
    term = Term(
        effect=effect,
        joint=candidate.joint,
        columns=effect.columns(joint, effect.thetas(joint)[0]),
        lower=lowest(model, like),
        theta=effect.thetas(joint)[0],
        candidate=like,
    )
    wider = with_independent(model, term, rows)
    # What is the same in these trials may be all of it.
    beside: Mapping[str, Any] = {key: {"ci90": (0.0, 0.0)} for key in entries}
    if wider is not model:
        coefficients = evaluate(wider, rows).coefficients
        fits = leave_out(wider, rows, coefficients)
        beside = parameters_of(wider, coefficients, fits, part_of(wider, candidate))
    return under_both(entries, beside)


def under_both(entries: Mapping[str, Any], others: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters with intervals that hold those which they have in another model, too."""
    return {
        key: entry
        | {
            word: _both(entry[word], others[key].get(word, entry[word]))
            for word in ("ci90", "free")
            if word in entry and key in others
        }
        for key, entry in entries.items()
    }


def _both(one: Sequence[float] | None, other: Sequence[float] | None) -> list[float] | None:
    """Return the interval that holds two."""
    if one is None or other is None:
        return None if one is None else list(one)
    return [min(one[0], other[0]), max(one[1], other[1])]


def part_of(model: Model, candidate: Candidate) -> Term | Channel:
    """Return the part of a model that a found effect is."""
    parts: list[Term | Channel] = [*model.terms, *model.channels]
    return next(part for part in parts if part.candidate == candidate)


def parameters_of(
    model: Model, coefficients: np.ndarray, fits: Fits, part: Term | Channel
) -> dict[str, Any]:
    """Return the physical parameters of a part of the model with their intervals."""
    candidate, theta = part.at, part.theta
    effect, joint = candidate.effect, unfitted(model.recording, candidate.joint)
    own: dict[int, float] = {}
    refitted: dict[int, np.ndarray] = {}
    for (term, found), (_, spread) in zip(
        model.split(coefficients), model.split(fits.coefficients), strict=True
    ):
        if term is part:
            own = dict(zip(term.kept, found.tolist(), strict=True))
            refitted = dict(zip(term.kept, spread.T, strict=True))
    # What several joints share a gain scales itself, as it does what is declared.
    shared = isinstance(part, Term) and len(part.columns) > 1
    scale = 1.0 if shared else gain(model, coefficients, candidate.joint)
    entries: dict[str, dict[str, Any]] = {}
    limits = dict(effect.limits(joint))
    for key, reading in effect.readings(joint, theta).items():
        free, highest = None, np.inf
        if reading.column is None:
            # Its limits here also say where another effect begins; beyond these it is nothing.
            natural = effect.parameters[key]
            limits[key] = natural.floor, natural.ceiling
            value, lowest = reading.of({}), natural.floor
            highest = max(natural.ceiling, float(value))
            every = value + _moved(fits, candidate, joint, theta, key, own)
            free = fits.interval(every, float(value))
        elif reading.column in own:
            value = reading.of(own, scale)
            bound = part.bound(reading.column) if isinstance(part, Term) else -np.inf
            lowest = reading.lowest(bound, scale)
            every = np.asarray(reading.of(refitted, scale))
            every = every + _moved(fits, candidate, joint, theta, key, own, scale)
            free = fits.interval(every, float(value)) if np.isfinite(value) else None
        else:
            continue
        unit = effect.unit_of(key, theta, joint)
        if unit in ("Nm", "N"):
            limits[key] = _within_recorded(limits[key], model, candidate.joint)
        what = effect.parameters[key].description
        if not np.isfinite(value):
            entries[key] = {"value": None, "ci90": None, "unit": unit, "description": what}
            continue
        low, high = fits.interval(every, float(value), lowest)
        interval = [low, min(high, highest)]
        entries[key] = {"value": value, "ci90": interval, "unit": unit, "description": what}
        signed = reading.column is not None and _is_difference(model, part)
        if free is not None and part.candidate is not None and not signed:
            entries[key] |= {"free": free, "limits": limits[key]}
    return entries


def spans_nonsense(interval: Sequence[float], value: float, limits: Sequence[float]) -> bool:
    """Whether so much of an interval is beyond what the quantity can be that it says nothing.

    Args:
        interval: its ends, before they are cut off at a limit.
        value: the estimate; one that ends at a limit itself may have an interval to both sides.
        limits: least and largest value that is physical.
    """
    (low, high), (least, most) = interval, limits
    if not least - ROUNDING <= value <= most + ROUNDING:
        return True
    width = high - low
    if width < SHARP * (most - least) < np.inf:
        return False
    below = (least - low) / width if width > 0 and value > least + ROUNDING else 0.0
    above = (high - most) / width if width > 0 and value < most - ROUNDING else 0.0
    return max(below, above) > MOST_NONSENSE


def of_any_size(model: Model, coefficients: np.ndarray, fits: Fits, candidate: Candidate) -> bool:
    """Whether an effect has a size that may be far beyond what is possible, and none that is sure.

    Args:
        model: with the effect.
        coefficients: its fit.
        fits: of `model`, from `leave_out`.
        candidate: the effect and its joint.
    """
    sizes = _sizes(model, coefficients, fits, candidate)
    return any(map(_says_nothing, sizes)) and not any(map(_is_sure, sizes))


def of_sure_size(model: Model, coefficients: np.ndarray, fits: Fits, candidate: Candidate) -> bool:
    """Whether a size of an effect can be told, and is not zero; arguments as of `of_any_size`."""
    return any(map(_is_sure, _sizes(model, coefficients, fits, candidate)))


def _sizes(
    model: Model, coefficients: np.ndarray, fits: Fits, candidate: Candidate
) -> list[dict[str, Any]]:
    """Return the parameters that an effect is nothing without."""
    part = part_of(model, candidate)
    found = parameters_of(model, coefficients, fits, part)
    return [found[name] for name in part.at.effect.coefficients if name in found]


def _says_nothing(size: Mapping[str, Any]) -> bool:
    """Whether so much of a size's interval is beyond what it can be that it says nothing."""
    return "free" in size and spans_nonsense(size["free"], size["value"], size["limits"])


def _is_sure(size: Mapping[str, Any]) -> bool:
    """Whether a size can be told, and is not zero."""
    if size["ci90"] is None or _says_nothing(size):
        return False
    low, high = size["ci90"]
    return bool(low > 0.0 or high < 0.0)


def _within_recorded(limits: tuple[float, float], model: Model, joint: int) -> tuple[float, float]:
    """Return the limits of a torque, no further than what the trials can have held, Nm or N."""
    recording = model.recording
    largest = np.nanmax(np.abs(recording.effort[:, joint]), initial=0.0)
    most = MOST_TORQUE * float(largest + np.abs(recording.rigid[:, joint]).max())
    return max(limits[0], -most), min(limits[1], most)


def _is_difference(model: Model, part: Term | Channel) -> bool:
    """Whether friction is declared there: then a found one is a difference of either sign."""
    joint, device = part.at.joint, model.recording.device
    damping = device.model.dof_damping[joint]
    if part.at.effect.name == "viscous_friction":
        return bool(damping)
    declared = [t for t in model.terms if t.candidate is None and t.joint == joint and t.rubs]
    return part.at.effect.rubs and bool(declared or device.friction[joint] or damping)


def _moved(
    fits: Fits,
    candidate: Candidate,
    joint: RecordedJoint,
    theta: Theta,
    key: str,
    own: Mapping[int, float],
    scale: float = 1.0,
) -> np.ndarray:
    """Return what each fit's non-linear parameters add to a physical one, to first order."""

    def read(at: Theta) -> float:
        reading = candidate.effect.readings(joint, at)[key]
        return float(reading.of(own, scale) if reading.columns else reading.of({}))

    spread = np.zeros(len(fits.coefficients))
    for (*named, theta_name), values in fits.thetas.items():
        # A declared load has the key of one that is found beside it.
        if tuple(named) != candidate.key or theta_name not in theta:
            continue
        step = 1e-6 * max(1.0, abs(theta[theta_name]))
        moved = {**theta, theta_name: theta[theta_name] + step}
        slope = (read(moved) - read(theta)) / step
        if slope and np.isfinite(slope):
            spread += slope * (values - theta[theta_name])
    return spread
