"""What samples that no fit has seen refuse: a repair that makes a joint worse."""

from collections.abc import Callable

import numpy as np

from analysis.closeloop.identification.arms.agreed import SHARED
from analysis.closeloop.identification.balance.accuracy import left_out_errors
from analysis.closeloop.identification.balance.model import Model, evaluate
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from analysis.closeloop.identification.balance.sticking import friction_of, sticking
from analysis.closeloop.identification.findings import Step
from analysis.closeloop.identification.growing.steps import Grown
from analysis.closeloop.session.signals import rms

#: By how much the error of a joint may grow: what no figure of a report shows.
ROUNDING = 1e-3


def not_worse(grown: Grown, declared: Model, rows: Rows) -> tuple[Grown, tuple[str, ...]]:
    """Take out effects until no joint is worse on the held-out trials than under what is declared.

    Nothing is fitted to these trials, and nothing is added because of them. Without any, groups
    that are left out stand for them, rests and all.

    Args:
        grown: the model with its effects.
        declared: the model as declared.
        rows: the samples to fit.

    Returns:
        The model with the effects that stay, and a sentence for each that went.
    """
    if not grown.steps:
        return grown, ()
    errors = _errors_by((declared, grown.model), rows)
    before = errors(declared)
    notes = []
    while grown.steps:
        after = errors(grown.model)
        worse = [joint for joint in after if after[joint] > (1.0 + ROUNDING) * before[joint]]
        gone = _least(grown, worse)
        if gone is None:
            break
        name, joint = gone.key
        where = ", ".join(rows.recording.name(joint) for joint in worse)
        notes.append(
            f"{name} of {rows.recording.name(joint)} is not added: fitted with it, the held-out "
            f"error of {where} is larger than that of the declared model"
        )
        model = grown.model.without(gone.taken.candidate)
        left = tuple(step for step in grown.steps if step is not gone)
        grown = Grown(model, evaluate(model, rows), left)
    return grown, tuple(notes)


def _errors_by(models: tuple[Model, Model], rows: Rows) -> Callable[[Model], dict[int, float]]:
    """Return what gives every joint's error, root mean square, in samples that no fit has seen."""
    recording = rows.recording
    trials = recording.session.trials
    holdouts = tuple(number for number, trial in enumerate(trials) if trial.role == "holdout")
    if not holdouts:
        return _of_left_out(models[0], rows)
    # Where the joint rests, the motion does not say what friction is: no model is right there.
    rubs = any(term.rubs for model in models for term in model.terms)
    held = select_rows(
        recording, holdouts, rests=not rubs and not np.any(recording.device.friction)
    )

    def of(model: Model) -> dict[int, float]:
        left = model.target(held) - model.base(held)[0] @ evaluate(model, rows).coefficients
        parts = held.parts.items()
        return {joint: rms(left[part]) for joint, part in parts if part.stop > part.start}

    return of


def _of_left_out(declared: Model, rows: Rows) -> Callable[[Model], dict[int, float]]:
    """Return the same of raw samples of left-out groups, as far as no friction explains it.

    Where a joint sticks its friction may be anything to either side of it, and of any model.
    """
    recording = rows.recording
    doubt = {
        joint: 2.0 * friction_of(declared, rows, joint) * sticking(recording, joint)
        for joint in rows.joints
    }

    def of(model: Model) -> dict[int, float]:
        squares: dict[int, list[np.ndarray]] = {joint: [] for joint in rows.joints}
        for error in left_out_errors(model, rows):
            own = recording.trial == error.trial
            known = np.interp(error.time, recording.time[own], doubt[error.joint][own])
            squares[error.joint].append(np.maximum(np.abs(error.residual) - known, 0.0) ** 2)
        return {
            joint: float(np.sqrt(np.concatenate(own).mean()))
            for joint, own in squares.items()
            if sum(map(len, own))
        }

    return of


def _least(grown: Grown, worse: list[int]) -> Step | None:
    """Return the effect to give up: the least of a worse joint's own, or what joints share."""
    own = [s for s in grown.steps if s.key[1] in worse and s.key[0] not in SHARED]
    own = own or [s for s in grown.steps if worse and s.key[0] in SHARED]
    return min(own, key=lambda step: step.share(step.taken), default=None)
