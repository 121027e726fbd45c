"""Damping, friction and motors' inertia that a model's file has and nobody measured.

Files that are drawn, not identified, have a number there so that simulations are calm, often the
same at every joint. (A stranger's KUKA LBR: 10 Nm s/rad, 4 Nm at a joint whose whole effort was
0.26 Nm.)
"""

from dataclasses import dataclass

import numpy as np

from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.signals import rms

#: Share of the energy that a declared damping takes which has to be missing in the trials: a joint
#: that gravity or a hand moves takes it from these, and its motor's effort is small.
SEEN = 0.5


@dataclass(frozen=True)
class Guess:
    """What is declared of a joint, and alone takes more than its whole effort."""

    joint: int
    #: As the model's file has it.
    what: str
    value: float
    #: Root mean square of its torque and of the joint's effort, Nm or N.
    torque: float
    effort: float


def guesses(recording: Recording) -> list[Guess]:
    """Return what is declared of joints that takes more than their efforts, and is not there."""
    return [
        Guess(joint, what, value, torque, rms(recording.effort[rows, joint]))
        for joint in recording.joints
        for rows in [_rows(recording, joint)]
        if rows.any()
        for what, value, column in _resisting(recording, joint)
        for torque in [rms(value * column[rows])]
        if torque > rms(recording.effort[rows, joint])
        and not _taken(recording, joint, rows, value * column)
    ]


def guessed_damping(recording: Recording) -> frozenset[int]:
    """Return the joints whose declared damping nobody measured: refuted, or one that is equal."""
    refuted = {guess.value for guess in guesses(recording) if guess.what == "damping"}
    return frozenset(j for j in recording.joints if recording.motor_damping(j) in refuted)


def doubtful_guesses(recording: Recording) -> list[str]:
    """Return a sentence for everything that is declared and alone takes more than the effort."""
    return [
        f"{recording.name(guess.joint)}: the declared {guess.what} of {guess.value:.3g} alone "
        f"takes {guess.torque:.3g} in these trials, the whole effort is {guess.effort:.3g} (root "
        "mean square): did anybody measure it? Leave it out of the model's file (`<dynamics>` in a "
        f"URDF, `{guess.what}` in an MJCF) and close the loop again, which finds what there is"
        for guess in guesses(recording)
    ]


def _rows(recording: Recording, joint: int) -> np.ndarray:
    rows = np.isfinite(recording.effort[:, joint]) & recording.usable
    return np.asarray(rows & np.isin(recording.trial, recording.fit_trials))


def _resisting(recording: Recording, joint: int) -> list[tuple[str, float, np.ndarray]]:
    """Return what resists a joint by name in its file, its size, and the torque of one unit."""
    return [
        ("damping", recording.motor_damping(joint), recording.velocity[:, joint]),
        (
            "frictionloss",
            float(recording.device.friction[joint]),
            recording.built_in_direction[:, joint],
        ),
        ("armature", recording.motor_inertia(joint), recording.acceleration[:, joint]),
    ]


def _taken(recording: Recording, joint: int, rows: np.ndarray, torque: np.ndarray) -> bool:
    """Whether what the rest of the model leaves of the effort goes with a declared torque."""
    rest = recording.filtered(recording.inverse[:, [joint]] - torque[:, None])[rows, 0]
    torque = recording.filtered(torque[:, None])[rows, 0]
    left = recording.effort[rows, joint] - rest
    return float(left @ torque) > SEEN * float(torque @ torque)
