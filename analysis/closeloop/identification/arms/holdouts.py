"""What samples that no fit has seen refuse: a repair that makes a joint worse."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from analysis.closeloop.identification.arms.agreed import SHARED
from analysis.closeloop.identification.balance.accuracy import (
    left_out_errors,
    raw_errors,
    settled,
)
from analysis.closeloop.identification.balance.model import Model, evaluate
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from analysis.closeloop.identification.balance.sticking import unknown_friction
from analysis.closeloop.identification.balance.trial_error import TrialError
from analysis.closeloop.identification.findings import Grown, Step, exchanged
from analysis.closeloop.session.signals import rms

#: By how much the error of a joint may grow: what no figure of a report shows.
ROUNDING = 1e-3
#: Errors of every joint, by one measure or more.
Errors = dict[int, tuple[float, ...]]


def not_worse(grown: Grown, declared: Model, rows: Rows) -> tuple[Grown, tuple[str, ...]]:
    """Take out effects until no joint is worse on the held-out trials than under what is declared.

    Nothing is fitted to these trials, and nothing is added because of them. Of names that the
    fitted trials cannot tell apart they take one that no joint is worse with: a joint that is held
    in another trial refutes an offset that looks like its friction. Without any, groups that are
    left out stand for them, rests and all.

    Args:
        grown: the model with its effects.
        declared: the model as declared.
        rows: the samples to fit.

    Returns:
        The model with the effects that stay, and a sentence for each that went.
    """
    if not grown.steps:
        return Grown(declared, evaluate(declared, rows)), ()
    errors = _errors_by((declared, grown.model), rows)
    before = errors(declared)
    notes = []
    while grown.steps:
        worse = _worse(before, errors(grown.model))
        gone = _least(grown, worse)
        if gone is None:
            break
        if other := _under_another_name(grown, gone, rows, lambda m: _worse(before, errors(m))):
            grown = other
            continue
        name, joint = gone.key
        where = ", ".join(rows.recording.name(joint) for joint in worse)
        notes.append(
            f"{name} of {rows.recording.name(joint)} is not added: fitted with it, the held-out "
            f"error of {where} is larger than that of the declared model"
        )
        model = grown.model.without(gone.taken.candidate)
        left = tuple(step for step in grown.steps if step is not gone)
        grown = Grown(model, evaluate(model, rows), left)
    if not grown.steps:
        # What is declared was chosen again beside effects that are gone.
        grown = Grown(declared, evaluate(declared, rows))
    return grown, tuple(notes)


def _worse(before: Errors, after: Errors) -> list[int]:
    """Return the joints whose error grows by any measure."""
    return [
        joint
        for joint, own in after.items()
        if any(a > (1.0 + ROUNDING) * b for a, b in zip(own, before[joint], strict=True))
    ]


def _under_another_name(
    grown: Grown, step: Step, rows: Rows, worse: Callable[[Model], list[int]]
) -> Grown | None:
    """Return what was found with friction in a step's place that worsens nothing, if any does.

    It has any value at rest, where an offset that looks like it in motion has one.
    """
    still = set(worse(grown.model)) - {step.taken.candidate.joint}
    for option in step.equals:
        model = exchanged(grown.model, step.taken, option)
        rubs = option.candidate.effect.rubs and not option.refused
        if not rubs or not set(worse(model)) <= still:
            continue
        score = evaluate(model, rows)
        taken = replace(option, model=model, score=score)
        rest = tuple(o for o in step.equals if o is not option)
        again = replace(step, taken=taken, equals=rest)
        steps = tuple(again if s is step else s for s in grown.steps)
        return Grown(model, score, steps)
    return None


def _errors_by(models: tuple[Model, Model], rows: Rows) -> Callable[[Model], Errors]:
    """Return what gives every joint's error, root mean square, in samples that no fit has seen.

    By the rows that a fit would have, and by whole trials, as far as no friction explains them.
    """
    recording = rows.recording
    trials = recording.session.trials
    holdouts = tuple(number for number, trial in enumerate(trials) if trial.role == "holdout")
    beyond = _beyond_friction(models[0], rows)
    if not holdouts:
        return lambda model: beyond(left_out_errors(model, rows))
    # Where the joint rests, the motion does not say what friction is: no model is right there.
    rubs = any(term.rubs for model in models for term in model.terms)
    held = select_rows(
        recording, holdouts, rests=not rubs and not np.any(recording.device.friction)
    )

    def of(model: Model) -> Errors:
        coefficients = evaluate(model, rows).coefficients
        left = model.target(held) - model.base(held)[0] @ coefficients
        whole = beyond(raw_errors(recording, settled(model, coefficients), holdouts))
        return {
            joint: (*own, rms(left[part]) if (part := held.parts[joint]).stop > part.start else 0.0)
            for joint, own in whole.items()
        }

    return of


def _beyond_friction(declared: Model, rows: Rows) -> Callable[[list[TrialError]], Errors]:
    """Return what gives errors of raw samples as far as no friction explains them.

    Where a joint sticks its friction may be anything to either side of it, and of any model.
    """
    recording = rows.recording
    doubt = {joint: 2.0 * unknown_friction(declared, rows, joint) for joint in rows.joints}

    def of(errors: list[TrialError]) -> Errors:
        squares: dict[int, list[np.ndarray]] = {joint: [] for joint in rows.joints}
        for error in errors:
            if error.joint in squares:
                own = recording.trial == error.trial
                known = np.interp(error.time, recording.time[own], doubt[error.joint][own])
                squares[error.joint].append(np.maximum(np.abs(error.residual) - known, 0.0) ** 2)
        return {
            joint: (float(np.sqrt(np.concatenate(own).mean())),)
            for joint, own in squares.items()
            if sum(map(len, own))
        }

    return of


def _least(grown: Grown, worse: list[int]) -> Step | None:
    """Return the effect to give up: the least of a worse joint's own, or what joints share."""
    own = [s for s in grown.steps if s.key[1] in worse and s.key[0] not in SHARED]
    own = own or [s for s in grown.steps if worse and s.key[0] in SHARED]
    return min(own, key=lambda step: step.share(step.taken), default=None)
