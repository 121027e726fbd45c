"""What held-out trials may still refuse: a repair that makes the error of a joint worse."""

import numpy as np

from analysis.closeloop.identification.arms.agreed import SHARED
from analysis.closeloop.identification.balance.model import Model, evaluate
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from analysis.closeloop.identification.findings import Step
from analysis.closeloop.identification.growing.steps import Grown
from analysis.closeloop.session.signals import rms

#: By how much the error of a joint may grow: what no figure of a report shows.
ROUNDING = 1e-3


def not_worse(grown: Grown, declared: Model, rows: Rows) -> tuple[Grown, tuple[str, ...]]:
    """Take out effects until no joint is worse on the held-out trials than under what is declared.

    Nothing is fitted to these trials, and nothing is added because of them.

    Args:
        grown: the model with its effects.
        declared: the model as declared.
        rows: the samples to fit.

    Returns:
        The model with the effects that stay, and a sentence for each that went.
    """
    trials = rows.recording.session.trials
    holdouts = tuple(number for number, trial in enumerate(trials) if trial.role == "holdout")
    if not holdouts or not grown.steps:
        return grown, ()
    # Where the joint rests, the motion does not say what friction is: no model is right there.
    models = (declared, grown.model)
    rubs = any(term.rubs for model in models for term in model.terms)
    held = select_rows(
        rows.recording, holdouts, rests=not rubs and not np.any(rows.recording.device.friction)
    )
    before = _errors(declared, rows, held)
    notes = []
    while grown.steps:
        after = _errors(grown.model, rows, held)
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


def _errors(model: Model, rows: Rows, held: Rows) -> dict[int, float]:
    """Return the error of every joint in rows that no fit has seen, root mean square."""
    left = model.target(held) - model.base(held)[0] @ evaluate(model, rows).coefficients
    return {joint: rms(left[part]) for joint, part in held.parts.items() if part.stop > part.start}


def _least(grown: Grown, worse: list[int]) -> Step | None:
    """Return the effect to give up: the least of a worse joint's own, or what joints share."""
    own = [s for s in grown.steps if s.key[1] in worse and s.key[0] not in SHARED]
    own = own or [s for s in grown.steps if worse and s.key[0] in SHARED]
    return min(own, key=lambda step: step.share(step.taken), default=None)
