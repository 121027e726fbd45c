"""Torque of a joint that no motion tells, beside which nothing is seen to stand out."""

import numpy as np
from scipy.ndimage import maximum_filter1d

from analysis.closeloop.identification.balance.model import Model, evaluate
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.balance.sticking import unknown_friction
from analysis.closeloop.identification.balance.terms import kept_columns
from analysis.closeloop.judgement.holds import AROUND, OF_MOTION, STICTION
from sim.effects.laws.backlash import Backlash


def excused(model: Model, rows: Rows, joint: int) -> np.ndarray:
    """Return how much torque of a joint may be any near each sample, Nm or N, low-passed, (n,).

    Args:
        model: what is known by now.
        rows: the samples of all joints in motion.
        joint: which.
    """
    turns = STICTION * unknown_friction(model, rows, joint)
    known = _crossing(model, rows, joint) + _recalled(model, rows, joint)
    return np.asarray(turns + known)


def _crossing(model: Model, rows: Rows, joint: int) -> np.ndarray:
    """Return how much torque flights through play take of a joint near each sample, (n,)."""
    recording, torque = model.recording, np.zeros(len(model.recording.time))
    for term, own in model.split(evaluate(model, rows).coefficients):
        if isinstance(term.effect, Backlash) and joint in term.columns:
            torque += np.abs(kept_columns(term)[joint] @ own)
    found = np.empty(len(torque))
    for piece in recording.slices:
        found[piece] = maximum_filter1d(torque[piece], int(AROUND * recording.rate) | 1)
    return found


def _recalled(model: Model, rows: Rows, joint: int) -> np.ndarray:
    """Return how much may be wrong, near each sample, of what depends on the motion before, (n,).

    A share of its torque: a reflex begins at once, and its form says how only about. (A stranger's
    reflex was known to a percent, and five pushes were told where it began and ended.)
    """
    recording, torque = model.recording, np.zeros(len(model.recording.time))
    for term, own in model.split(evaluate(model, rows).coefficients):
        if term.effect is not None and term.effect.remembers and joint in term.columns:
            torque += np.abs(kept_columns(term)[joint] @ own)
    width = int(AROUND * recording.rate) | 1
    for piece in recording.slices:
        torque[piece] = OF_MOTION * maximum_filter1d(torque[piece], width)
    return torque
