"""A recording whose two joints move as they are told, without an effort yet."""

from dataclasses import replace

import numpy as np

from analysis.closeloop.session.recording import Recording


def moved(recording: Recording, position: np.ndarray, rate: float) -> Recording:
    """Return a recording of one trial in which the joints are at `position`, rad, (n, joints).

    Args:
        recording: its device and session.
        position: evenly sampled.
        rate: Hz.
    """
    count = len(position)
    velocity = np.gradient(position, 1 / rate, axis=0)
    return replace(
        recording,
        sampling=replace(recording.sampling, recorded=rate, working=rate, cutoff=10.0),
        slices=[slice(0, count)],
        trial=np.zeros(count, dtype=int),
        time=np.arange(count) / rate,
        position=position,
        velocity=velocity,
        acceleration=np.gradient(velocity, 1 / rate, axis=0),
        measured=np.ones(count),
        extra=np.empty((count, 0)),
        joints=(1,),
        cache={},
    )
