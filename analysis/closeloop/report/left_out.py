"""Joints with a recorded effort of which a report says nothing."""

from collections.abc import Collection

import numpy as np

from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.runs import MOVING


def of_left_out(recording: Recording, said: Collection[str]) -> list[str]:
    """Say which joints with a recorded effort have no error here, and why.

    Args:
        recording: all trials.
        said: joints of which the report has an error.
    """
    fitted = [recording.session.trials[number] for number in recording.fit_trials]
    left = [
        name
        for name in recording.device.recorded_joints
        if name not in said and any(f"{name}.effort" in trial.columns for trial in fitted)
    ]
    lines = []
    for name in left:
        moves = any(np.ptp(trial.columns[f"{name}.position"]) > MOVING for trial in fitted)
        why = "has no effort throughout a piece of" if moves else "does not move in"
        lines.append(f"{name} {why} the trials that are fitted: nothing is said of it")
    return lines
