"""What held-out trials may still refuse: a repair that makes the error of a joint worse."""

from analysis.closeloop.identification.balance.accuracy import raw_errors, rms_by_joint, settled
from analysis.closeloop.identification.balance.declared import PLACED
from analysis.closeloop.identification.balance.model import Model, evaluate
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.findings import Step
from analysis.closeloop.identification.growing import Grown
from sim.effects.catalogue import LINK_INERTIA

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
    before = _errors(declared, rows, holdouts)
    notes = []
    while grown.steps:
        after = _errors(grown.model, rows, holdouts)
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


def _errors(model: Model, rows: Rows, trials: tuple[int, ...]) -> dict[int, float]:
    """Return the error of every joint in some trials, root mean square."""
    predicted = settled(model, evaluate(model, rows).coefficients)
    errors = raw_errors(rows.recording, predicted, trials)
    return {joint: error for joint, (error, _) in rms_by_joint(errors).items()}


def _least(grown: Grown, worse: list[int]) -> Step | None:
    """Return the effect to give up: the least of a worse joint's own, or what joints share."""
    shared = {LINK_INERTIA, PLACED.name}
    own = [s for s in grown.steps if s.key[1] in worse and s.key[0] not in shared]
    own = own or [s for s in grown.steps if worse and s.key[0] in shared]
    return min(own, key=lambda step: step.share(step.taken), default=None)
