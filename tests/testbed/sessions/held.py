"""A trial of 20 s in which an elbow is held, and goes away from there."""

from dataclasses import replace

import numpy as np

from analysis.closeloop.session.contents import Trial
from analysis.closeloop.session.recording import Recording
from tests.testbed.sessions.moved import moved

RATE, NOISE = 50.0, 0.05
TIME = np.arange(int(20.0 * RATE)) / RATE


def bump(begin: float, seconds: float) -> np.ndarray:
    """Return a smooth rise and fall between 0 and 1, (n,)."""
    inside = (begin < TIME) & (begin + seconds > TIME)
    return np.where(inside, np.sin(np.pi * (TIME - begin) / seconds) ** 2, 0.0)


def holding(
    recording: Recording, away: np.ndarray, beyond: np.ndarray, sag: float = 0.2
) -> Recording:
    """Return a trial in which the elbow sags at first, is held then, and goes away from there.

    Args:
        recording: its device and session.
        away: of the elbow from where it is held, rad, (n,).
        beyond: effort beside what holding takes and noise, Nm, (n,).
        sag: at the beginning, rad.
    """
    elbow = 1.0 + sag * np.exp(-((TIME / 0.3) ** 2)) + away
    position = np.column_stack([np.zeros(len(TIME)), elbow])
    recording = moved(recording, position, RATE)
    noise = NOISE * np.random.default_rng(5).standard_normal(len(TIME))
    raw = recording.static[:, 1] + noise + beyond
    names = ("shoulder.position", "elbow.position", "elbow.effort")
    columns = dict(zip(names, (*position.T, raw), strict=True))
    trial = Trial(file="a.csv", label="a", group="a", role="fit", time=TIME, columns=columns)
    effort = np.full_like(position, np.nan)
    effort[:, 1] = recording.filtered(raw[:, None])[:, 0]
    session = replace(recording.session, trials=(trial,))
    return replace(recording, session=session, effort=effort, cache={})


def with_effort(recording: Recording, effort: np.ndarray) -> Recording:
    """Return the recording with another effort of the elbow, Nm, (n,)."""
    both = np.column_stack([np.full(len(TIME), np.nan), effort])
    return replace(recording, effort=recording.filtered(both), cache={})
