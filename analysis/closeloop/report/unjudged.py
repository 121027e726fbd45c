"""Errors far above the floor that are where a residual is not judged, told all the same.

A residual is judged in motion and in the fit's band (`judgement.outcome.left_in_band`): where a
joint rests or turns around friction takes any value, and faster than the band nothing is compared.
The error of the table is over all raw samples, and who reads 5 times the floor asks where it is.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from analysis.closeloop.identification.balance.accuracy import rms_by_joint
from analysis.closeloop.identification.balance.trial_error import TrialError
from analysis.closeloop.identification.findings import AT_FLOOR, Floor, Outcome
from analysis.closeloop.session.recording import Recording

#: What such an entry of `unexplained` is the root mean square of.
OF_ALL = "the held-out error in motion, of any frequency, less the floor"

#: Share of a joint's power that is most of it.
MOSTLY = 0.5


def beyond_floor(errors: Sequence[TrialError], floor: Floor | None) -> float:
    """Return the mean square of errors of one joint less its floor's, Nm2 or N2.

    0 if they are at the floor, or nobody knows where that is.
    """
    residual = np.concatenate([np.zeros(0), *(error.residual for error in errors)])
    if floor is None or not len(residual):
        return 0.0
    square = float(np.mean(residual**2))
    return square - floor.value**2 if square > (AT_FLOOR * floor.value) ** 2 else 0.0


def where_unjudged(outcome: Outcome, entries: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return a warning for every joint whose error is far above its floor where it is not judged.

    What else stands in `unexplained` says of the others where theirs is.

    Args:
        outcome: of the session.
        entries: `unexplained` of the report.
    """
    recording = outcome.trace.rows.recording
    lines = []
    for joint, (error, _) in rms_by_joint(outcome.holdout.after).items():
        floor, name = outcome.floors.get(joint), recording.name(joint)
        own = [one for one in outcome.holdout.after if one.joint == joint]
        if floor is None or not beyond_floor(own, floor):
            continue
        turns, fast = shares(recording, own)
        if name in entries and entries[name]["rms_of"] != OF_ALL and turns < MOSTLY:
            continue
        unit = recording.device.unit(name)
        lines.append(
            f"{name}: its error after, {error:.3g} {unit}, is {error / floor.value:.1f} times the "
            f"noise of its effort (its floor, {floor.value:.3g} {unit}; {floor.source}), more than "
            f"in motion below {recording.sampling.fit_cutoff:.2g} Hz, where it is judged: "
            f"{100 * turns:.0f} % of its power is where the joint rests or turns around and "
            f"friction may have any value, {100 * fast:.0f} % is in motion and faster"
        )
    return lines


def shares(recording: Recording, errors: Sequence[TrialError]) -> tuple[float, float]:
    """Return the shares of a residual's power at rest and at turns, and in motion above the band.

    Args:
        recording: all trials.
        errors: of one joint, at least one.
    """
    turning = recording.turning(errors[0].joint)
    # Of a trial too short to be filtered nothing is left on the even clock.
    errors = [one for one in errors if len(one.time) and np.any(recording.trial == one.trial)]
    even = np.zeros(len(recording.time))
    for error in errors:
        own = recording.trial == error.trial
        even[own] = np.interp(recording.time[own], error.time, error.residual)
    slow = recording.filtered(even)
    whole = turns = fast = 0.0
    for error in errors:
        own = recording.trial == error.trial
        clock = recording.time[own]
        nearest = np.minimum(np.searchsorted(clock, error.time), len(clock) - 1)
        moves = ~turning[own][nearest]
        whole += float((error.residual**2).sum())
        turns += float((error.residual[~moves] ** 2).sum())
        above = error.residual - np.interp(error.time, clock, slow[own])
        fast += float((above[moves] ** 2).sum())
    return turns / max(whole, 1e-300), fast / max(whole, 1e-300)
