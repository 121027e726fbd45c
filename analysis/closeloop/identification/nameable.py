"""Whether these trials can name an effect at all, beside what is declared."""

import numpy as np

from analysis.closeloop.identification.balance.model import Candidate, Model
from analysis.closeloop.identification.balance.regression import Rows, Score, takes_all

#: An effect whose torque the declared unknowns imitate to this share cannot be named.
MIN_UNIQUE = 0.02
ONE_WAY = (
    "the only trial moves in one direction: friction, damping, stiffness and neutral angle cannot "
    "be told apart"
)


def refusal(model: Model, rows: Rows, candidate: Candidate, scored: Score, current: Score) -> str:
    """Say why these trials cannot name the effect, or return nothing.

    What is declared may imitate all but a little of it. That little is seen all the same where it
    alone takes nearly all that is left, in trials that it was not fitted to.
    """
    if not rows.grouped and one_way(rows, candidate.joint):
        return ONE_WAY
    if takes_all(current.losses, scored.losses):
        return ""
    base, _ = model.base(rows)
    width = scored.variant.columns.shape[1] if scored.variant.columns.size else 0
    if not width or not base.shape[1]:
        return ""
    columns, own = scored.variant.columns, scored.coefficients[-width:]
    left = columns - base @ np.linalg.lstsq(base, columns, rcond=None)[0]
    here = {t.effect.name for t in model.terms if t.effect and t.joint == candidate.joint}
    if here.intersection(candidate.effect.includes):
        # The part that is there already does not count: only what goes beyond it has to show.
        beyond = (left**2).sum(axis=0) > MIN_UNIQUE * (columns**2).sum(axis=0)
        if beyond.any():
            columns, left, own = columns[:, beyond], left[:, beyond], own[beyond]
    unique = float(((left @ own) ** 2).sum() / max(float(((columns @ own) ** 2).sum()), 1e-300))
    if unique < MIN_UNIQUE:
        return f"what is declared imitates {100 * (1 - unique):.1f} % of its torque in these trials"
    return ""


def one_way(rows: Rows, joint: int) -> bool:
    """Whether the joint moves in one direction only."""
    velocity = rows.recording.velocity[rows.samples[joint], joint]
    forward = float(np.maximum(velocity, 0).sum())
    backward = float(np.maximum(-velocity, 0).sum())
    return min(forward, backward) < 0.05 * max(forward, backward)
