"""Whether angle and effort are counted the same way round: in a session, and in each trial."""

from dataclasses import dataclass

import numpy as np

from analysis.closeloop.errors import SessionError
from analysis.closeloop.misdeclared import turned_efforts
from analysis.closeloop.remedies import scaled
from analysis.closeloop.session.faults import fault
from analysis.closeloop.session.plausibility import LEAST_MOTION, in_motion, unknown_columns
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.runs import AWAY, MOVING, TRAVEL

#: The others predict a turned trial worse than its own mean does, which leaves 1, and turned back
#: they leave less than this share: a tenth is a poor model, and no effect nor posture comes near,
#: for both have to hold.
TURNED_LEAVES = 0.1


def check_signs(recording: Recording) -> None:
    """Refuse a session whose effort has the opposite sign of the joint axis.

    A passive joint takes energy from the motor, and inertia and gravity are declared: if
    the joint drives the motor, and inertia or stiffness comes out negative too, a sign is wrong.

    Raises:
        SessionError: names the first such joint's effort column in the first trial, and the others.
    """
    driving = {recording.name(j) for j in recording.joints if _drives_its_motor(recording, j)}
    if not driving:
        return
    first = recording.session.trials[recording.fit_trials[0]].file
    wrong = driving.union(turned_efforts(recording))
    name, *others = (joint for joint in map(recording.name, recording.joints) if joint in wrong)
    as_well = f" (so have those of {', '.join(others)}; turn all of them)" if others else ""
    why = (
        f"has the opposite sign of what {name} needs{as_well}, or {name}.position is counted the "
        "other way round: as recorded, the joint drives the motor; both are positive along the "
        "joint's axis"
    )
    raise SessionError(why, file=first, column=f"{name}.effort")


def _drives_its_motor(recording: Recording, joint: int) -> bool:
    """Whether a joint gives energy to its motor, and its inertia or weight is turned round, too."""
    rows = in_motion(recording, joint)
    if int(rows.sum()) < LEAST_MOTION * recording.rate or _moved_once(recording, rows):
        return False
    if np.ptp(recording.position[rows, joint]) < TRAVEL:
        return False
    # Without declared friction and damping, which may be too high: their sign has its own unknown.
    effort, velocity = recording.effort[rows, joint], recording.velocity[rows, joint]
    known = recording.rigid[rows, joint] - recording.motor_damping(joint) * velocity
    unknown = unknown_columns(recording, joint)[rows]
    table = np.column_stack([known, unknown])
    found = np.linalg.lstsq(table, effort, rcond=None)[0]
    rest = effort - table @ found
    spread = float(((effort - effort.mean()) ** 2).sum())
    explained = 1.0 - float(rest @ rest) / max(spread, 1e-300)
    power = float((velocity * (table[:, 3:] @ found[3:])).mean())
    scale = float(np.sqrt((effort**2).mean() * (velocity**2).mean()))
    both_ways = abs(float(velocity.sum())) < 0.5 * float(np.abs(velocity).sum())
    if explained < 0.8 or power > -0.02 * scale or not both_ways:
        return False
    declared = _independent(known, unknown, effort)
    if declared and found[0] > 0.5:
        # Weight and inertia are there with the sign they should have.
        return False
    turned = declared and -1.5 < found[0] < -0.5
    return bool(turned or found[2] < 0)


def _moved_once(recording: Recording, rows: np.ndarray) -> bool:
    """Whether a joint leaves its rest but once, and shortly.

    Whoever pushes it to where its friction holds it drives its motor, too.

    Args:
        recording: all trials.
        rows: the samples in which it moves, (n,); at least one.
    """
    moving = np.flatnonzero(rows)
    first, last = int(moving[0]), int(moving[-1])
    whole = np.flatnonzero(recording.trial == recording.trial[first])
    rests = whole[0] < first and last < whole[-1]
    return bool(rests and recording.time[last] - recording.time[first] < AWAY)


def _independent(known: np.ndarray, unknown: np.ndarray, effort: np.ndarray) -> bool:
    """Whether the declared torque is large, and not a mixture of the unknowns' columns."""
    left = known - unknown @ np.linalg.lstsq(unknown, known, rcond=None)[0]
    return float(left @ left) > 1e-4 * float(effort @ effort)


def check_turned(recording: Recording) -> None:
    """Refuse a session in which one trial's position or effort has the other trials' sign turned.

    Declared torque, offset, stiffness, damping and friction of a joint are fitted to the other
    trials. Two trials can only say that they disagree: the later one is named.

    Raises:
        SessionError: names the trial's file and the joint's column.
    """
    for joint in recording.joints:
        table = effort_table(recording, joint)
        suspects = [one for one in predictions(recording, joint) if one.left(table) > 1.0]
        if not suspects:
            continue
        name = recording.name(joint)
        other = table * [*[1.0] * (table.shape[1] - 1), -1.0]
        for turned, column in (
            (effort_table(_mirrored(recording, joint), joint), "position"),
            (other, "effort"),
        ):
            # The others' say of what was recorded, of either column.
            found = [
                one
                for one in suspects
                if left_of(turned[one.rows], one.coefficients(table)) < TURNED_LEAVES
            ]
            if found:
                trial = recording.session.trials[found[-1].trial]
                also = " and velocity" if column == "position" else ""
                why = (
                    f"has in {trial.label} the other sign than in the other trials: turned round, "
                    f"it is what they predict of {name}, and as recorded it is not; turn the sign "
                    f"of {column}{also} there, or in the others"
                )
                raise fault(trial, why, f"{name}.{column}")


@dataclass(frozen=True)
class Prediction:
    """One joint's motion in one trial, and the other trials that predict its effort."""

    #: Its number in the session.
    trial: int
    #: Its samples, and those of the others of the fit, (n,).
    rows: np.ndarray
    others: np.ndarray

    def coefficients(self, table: np.ndarray) -> np.ndarray:
        """Return what the others say of a joint's `effort_table`, (5,)."""
        own = table[self.others]
        return np.asarray(np.linalg.lstsq(own[:, :-1], own[:, -1], rcond=1e-9)[0])

    def left(self, table: np.ndarray) -> float:
        """Return the share of the trial's effort that the others leave."""
        return left_of(table[self.rows], self.coefficients(table))


def effort_table(recording: Recording, joint: int) -> np.ndarray:
    """Return what a joint's effort is made of, and the effort itself, (n, 6)."""
    columns = np.column_stack([recording.inverse[:, joint], unknown_columns(recording, joint)])
    return np.column_stack([recording.filtered(columns), recording.effort[:, joint]])


def predictions(recording: Recording, joint: int) -> list[Prediction]:
    """Return every trial in which a joint moves, with the trials of the fit beside it."""
    known = recording.usable & np.isfinite(recording.effort[:, joint])
    least, found = LEAST_MOTION * recording.rate, []
    for number in range(len(recording.session.trials)):
        rows = known & (recording.trial == number)
        others = known & np.isin(recording.trial, [n for n in recording.fit_trials if n != number])
        if min(rows.sum(), others.sum()) < least:
            continue
        if np.ptp(recording.position[rows, joint]) > MOVING:
            found.append(Prediction(number, rows, others))
    return found


def left_of(table: np.ndarray, coefficients: np.ndarray) -> float:
    """Return the share of an effort's variance that a prediction leaves."""
    effort = table[:, -1]
    spread = float(((effort - effort.mean()) ** 2).sum())
    rest = effort - table[:, :-1] @ coefficients
    return float(rest @ rest) / max(spread, 1e-300)


def _mirrored(recording: Recording, joint: int) -> Recording:
    """Return the recording with one joint's motion counted the other way round."""
    sign = np.ones(recording.position.shape[1])
    sign[joint] = -1.0
    return scaled(recording, sign)
