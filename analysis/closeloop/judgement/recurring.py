"""What a model leaves in other passes through the same motion: no push then, but a wrong form."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from analysis.closeloop.session.recording import Recording

#: Time to a place that is another one, s.
ELSEWHERE = 1.0
#: How near another pass is (in deviations of place, speed and acceleration), which share of the
#: residual makes it the same, and of which share of such rows that is so. (The last was a third of
#: the passes, until an opponent pushed twice in the same motion.)
NEAR, ALIKE, MOSTLY = 0.3, 0.4, 0.5


def clock_of(recording: Recording) -> np.ndarray:
    """Return the time of every sample, s, (n,), one trial after the other."""
    longest = float(np.ptp(recording.time)) + 2.0 * ELSEWHERE
    return np.asarray(recording.time + longest * recording.trial)


class Way:
    """Passes through the same motion: the same place or phase, speed and acceleration."""

    def __init__(self, time: np.ndarray, signals: Sequence[np.ndarray]) -> None:
        state = np.column_stack(signals)
        self._state = state / np.maximum(state.std(axis=0), 1e-12)
        self._tree = cKDTree(self._state)
        self._time = time

    def comes_back(self, residual: np.ndarray, top: int, *, mirrored: bool = False) -> bool:
        """Whether the same residual is left in other passes as at row `top`.

        Args:
            residual: of every row, (n,).
            top: the row in question.
            mirrored: whether passes are meant that go the other way in all signals, and leave the
                opposite: what inertia and friction take is odd in the motion.
        """
        time, way = self._time, -1.0 if mirrored else 1.0
        near = np.array(self._tree.query_ball_point(way * self._state[top], NEAR), dtype=int)
        near = near[np.abs(time[near] - time[top]) > ELSEWHERE]
        # Somebody may have pushed in one of them, too.
        return len(near) > 0 and bool(
            np.mean(way * residual[near] / residual[top] > ALIKE) > MOSTLY
        )
