"""Loads at the ends of a recording's pieces, where filters do not know the motion.

Of a start from a stop they make a load that nothing had. What hangs on a spring would ring of it,
where no sample says how it hung. (Found on limbs of the unkind bench.)
"""

import numpy as np

from sim.effects.motion import Recording


def abrupt_starts(load: np.ndarray, recording: Recording) -> list[int]:
    """Return the numbers of pieces that begin at once.

    Their load changes more while the filters begin than ever after, over as long.

    Args:
        load: Nm or N, (joints, n).
        recording: of these joints.
    """
    edge, found = recording.edge, []
    for number, piece in enumerate(recording.slices):
        own = load[:, piece]
        if own.shape[1] <= 3 * edge:
            continue
        after = own[:, edge : own.shape[1] - edge]
        changes = np.abs(after[:, edge:] - after[:, :-edge]).max(axis=1)
        if np.any(np.ptp(own[:, : edge + 1], axis=1) > changes):
            found.append(number)
    return found


def begun_calmly(load: np.ndarray, recording: Recording) -> np.ndarray:
    """Return loads, Nm or N, (joints, n), that begin every piece as they go on where known."""
    calm = load.copy()
    for piece in recording.slices:
        known = min(piece.start + recording.edge, piece.stop - 1)
        calm[:, piece.start : known] = load[:, [known]]
    return calm
