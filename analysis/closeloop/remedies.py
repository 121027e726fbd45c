"""A recording as it would be if a column of it were mended."""

from dataclasses import replace

import numpy as np

from analysis.closeloop.session.recording import Recording


def scaled(recording: Recording, factors: np.ndarray) -> Recording:
    """Return the recording with its motion times so much.

    Args:
        recording: as it was recorded.
        factors: of every joint, (joints,), or of every sample, too, (n, joints).
    """
    return replace(
        recording,
        position=recording.position * factors,
        velocity=recording.velocity * factors,
        acceleration=recording.acceleration * factors,
        cache={},
    )


def with_motions_exchanged(
    recording: Recording, pair: tuple[int, int], rows: np.ndarray | None = None
) -> Recording:
    """Return the recording with the motion of two joints taken for each other.

    Args:
        recording: as it was recorded.
        pair: the joints' numbers.
        rows: in which samples, (n,); in all if not given.
    """
    return replace(
        recording,
        position=_exchanged(recording.position, pair, rows),
        velocity=_exchanged(recording.velocity, pair, rows),
        acceleration=_exchanged(recording.acceleration, pair, rows),
        cache={},
    )


def with_efforts_exchanged(
    recording: Recording, pair: tuple[int, int], rows: np.ndarray | None = None
) -> Recording:
    """Return the recording with two joints' efforts taken for each other, as their motion above."""
    return replace(recording, effort=_exchanged(recording.effort, pair, rows), cache={})


def _exchanged(
    signal: np.ndarray, pair: tuple[int, int], rows: np.ndarray | None = None
) -> np.ndarray:
    where = slice(None) if rows is None else rows
    found, (one, other) = np.array(signal), pair
    found[where, one], found[where, other] = signal[where, other], signal[where, one]
    return found
