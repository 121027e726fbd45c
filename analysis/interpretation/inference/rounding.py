"""What coarse steps of a torque do to K: the bank's own recordings, rounded so.

A torque that changes slowly is off by the same all through a window: by a uniform distribution as
wide as a step (Widrow and Kollar 2008, Quantization noise, section 1.3). What samples that move on
from step to step would average out is not counted on.
"""

import numpy as np

from analysis.interpretation.bank.bank import Bank
from analysis.interpretation.inference.features import RECORDED
from analysis.interpretation.inference.interpreter import Interpreter
from analysis.interpretation.inference.rows import noisy
from sim.assessment.summary import AFTER, BEFORE
from sim.models import WINDOWS

#: Share of its half width that K may move by, root mean square.
ALLOWED = 0.25
#: Recordings of the bank that are rounded.
ROWS = 100


def moved_by_rounding(interpreter: Interpreter, bank: Bank, steps: np.ndarray) -> float:
    """Return by how much of its half width K moves if torques come in steps, root mean square.

    Args:
        interpreter: learnt from the bank.
        bank: whose recordings are rounded.
        steps: of each joint, Nm, shape (joints,).
    """
    samples = bank.bushing if interpreter.correction is None else bank.contact
    recorded = noisy(bank, samples)[:ROWS]
    off = np.random.default_rng(0).uniform(-0.5, 0.5, (len(recorded), len(steps), WINDOWS))
    off *= steps[:, None]
    rounded = recorded.copy()
    for joint in range(len(steps)):
        rounded[:, WINDOWS * (joint + 1) : WINDOWS * (joint + 2)] += off[:, joint]
    for row, error in zip(rounded, off[:, -1], strict=True):
        _regress(row, error)
    moved = interpreter.stiffness(rounded) - interpreter.stiffness(recorded)
    half_width = np.quantile(np.abs(interpreter.local.errors[:, 0]), 0.9)
    return float(np.sqrt(np.mean(moved**2)) / half_width)


def _regress(row: np.ndarray, error: np.ndarray) -> None:
    """Add to a recording's regressions what an error of the elbow's torque, by window, adds."""
    angle = row[:WINDOWS]
    velocity = np.gradient(angle, (BEFORE + AFTER) / WINDOWS)
    for form, columns in (
        ("affine", (angle, velocity, np.ones(WINDOWS))),
        ("paper", (angle, velocity)),
    ):
        found = np.linalg.lstsq(np.column_stack(columns), error, rcond=None)[0]
        row[RECORDED.index(f"{form}_stiffness")] += found[0]
        row[RECORDED.index(f"{form}_damping")] += found[1]
