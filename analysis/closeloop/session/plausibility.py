"""Signals that cannot be what their column says: degrees, flipped signs, saturation, constants."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.signal import detrend
from scipy.stats import median_abs_deviation, siegelslopes

from analysis.closeloop.session.angles import (
    MAX_SPEED,
    MAX_SPEED_SHARE,
    check_degrees,
    check_velocity,
)
from analysis.closeloop.session.contents import Trial
from analysis.closeloop.session.device import Device
from analysis.closeloop.session.faults import fault
from analysis.closeloop.session.missing import GAP_STEPS
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.runs import MOVING, TRAVEL, saturated_line

#: Steps around one of which a few damaged cells are the lesser part, however they lie.
LASTING = 9
#: Share of samples that are another value in a signal that is constant otherwise: a file may lack
#: as many (`trial_csv.MOST_LEFT_OUT`).
ODD_SHARE = 0.01
#: An encoder is stuck that shows one value over this share of a trial while the velocity adds up to
#: so much, rad or m, and to this share of all that the joint moves. Shorter runs are stale samples.
STUCK_RUN = 0.1
STUCK = 0.02
STUCK_SHARE = 0.05
#: Share of the other samples of an effort that differ from the one before, if it is measured.
LIVELY = 0.95
#: Range of a random walk without its trend, over the root mean square of its end, at most.
WALK = 3.0
STILL = "no position changes; if the joints were not held, look at the encoders"
#: Length over which the effort of a held joint is averaged, s, and by how many spreads of single
#: samples, or last digits, it changes if the joint is not held. Both were chosen before the still
#: recordings that they were tried on were looked at.
SLOW, WORKS = 0.1, 3.0
#: No joint of a limb bears more, Nm: the strongest, knee and hip, give .163 of weight times height
#: (Anderson, Madigan and Nussbaum 2007), here of the largest subject that a session may name.
MOST_TORQUE = 1200.0
#: Share of samples that lie beyond: spikes are no unit.
MOST_SHARE = 0.01
#: Share of a declared range that a joint may go beyond it: stops give way, zeros are set by eye.
BEYOND_RANGE = 0.1
#: A step between two samples is an encoder's that wraps if it is so near to 2 pi, rad, and all
#: others are shorter than this: degrees of a fast joint have steps of every length.
NEAR_TURN = 0.5
#: Least time that a motor moves its joint before the sign of its effort is judged, s.
LEAST_MOTION = 1.0


def check_copies(trials: Sequence[Trial]) -> None:
    """Refuse a recording that is listed twice: what predicts its copy predicts nothing.

    Raises:
        SessionError: two trials hold the same samples.
    """
    for number, trial in enumerate(trials):
        for earlier in trials[:number]:
            both = [name for name in earlier.columns if name in trial.columns]
            same = all(np.array_equal(trial.columns[n], earlier.columns[n]) for n in both)
            # Joints that are held may show the same in every trial.
            if same and any(np.ptp(trial.columns[n]) > 0.0 for n in both):
                other = f"{earlier.file}{earlier.part}"
                why = f"holds the same samples as {other}; list each recording once"
                raise fault(trial, why)


def check_frozen(trial: Trial, device: Device) -> None:
    """Refuse a position that is one value but for a jump: no joint goes there between two samples.

    One that is constant throughout may be a held joint's. Asked before columns are compared: of
    what does not change every comparison says what it likes.

    Raises:
        SessionError: names file, column and the line of the jump.
    """
    for joint in device.recorded_joints:
        position = trial.columns[f"{joint}.position"]
        value, at = _most_common(position)
        steps = np.abs(np.diff(position))
        # An encoder's last digits are no jump.
        jumps = 2.0 * steps.max(initial=0.0) > np.ptp(position) >= TRAVEL
        if jumps and np.mean(at) >= 1.0 - ODD_SHARE:
            why = (
                f"is constant at {value:g} in {int(at.sum())} of {len(at)} samples, and jumps to "
                "the others within one: look at the encoder; a joint that is held has no jump"
            )
            raise fault(trial, why, f"{joint}.position", int(np.argmax(steps)) + 1)


def _most_common(signal: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the value that most samples of a signal have, and which do, (n,)."""
    values, counts = np.unique(signal, return_counts=True)
    value = float(values[np.argmax(counts)])
    return value, signal == value


def checked_trial(trial: Trial, device: Device, limb_joints: Collection[str]) -> Trial:
    """Refuse a trial whose signals cannot be what their columns say.

    Joints that are held may all be constant. That could be an encoder, too, and the trial says so.
    A limb acts at `limb_joints`, which never turn round.

    Raises:
        SessionError: names file, column and line.
    """
    moving = []
    for joint in device.recorded_joints:
        position = trial.columns[f"{joint}.position"]
        if device.is_hinge(joint):
            _check_wraps(trial, joint, position)
            _check_jumps(trial, joint, position)
            note = check_degrees(trial, device, joint, position, joint in limb_joints)
            trial = replace(trial, repairs=(*trial.repairs, *note))
        if beyond := _beyond_range(trial, device, joint, position):
            trial = replace(trial, repairs=(*trial.repairs, beyond))
        velocity = trial.columns.get(f"{joint}.velocity")
        if velocity is not None:
            _check_stuck(trial, joint, position, velocity)
            check_velocity(trial, joint, position, velocity)
        if np.ptp(position) > 1e-9 * (1.0 + np.abs(position).max()):
            moving.append(joint)
    if not moving:
        # Whose motor works hardest should have moved.
        efforts = {name: trial.columns.get(f"{name}.effort") for name in device.recorded_joints}
        measured = {name: effort for name, effort in efforts.items() if effort is not None}
        joint = max(measured, key=lambda name: float(np.ptp(measured[name])), default="")
        if joint and works(measured[joint], trial.time):
            why = (
                "is constant, as is every other position, while the motor's effort changes "
                "throughout; look at the encoder"
            )
            raise fault(trial, why, f"{joint}.position")
    for joint in moving:
        effort = trial.columns.get(f"{joint}.effort")
        if effort is None:
            continue
        column = f"{joint}.effort"
        position = trial.columns[f"{joint}.position"]
        value, at = _most_common(effort)
        mostly = np.mean(at) >= 1.0 - ODD_SHARE and np.ptp(position[at]) > MOVING
        if mostly or np.ptp(effort) <= 1e-12 * (1.0 + np.abs(effort).max()):
            why = f"is constant at {value:g} while {joint} moves; record the motor's torque"
            if not effort.any():
                why += (
                    ", or leave the column out if it has no motor: its motion is read all the same"
                )
            raise fault(trial, why, column, int(np.argmax(at)))
        if stuck := _stuck_effort(effort, position, joint):
            trial = replace(trial, repairs=(*trial.repairs, stuck))
    return trial if moving else replace(trial, repairs=(*trial.repairs, STILL))


def check_saturated(trials: Sequence[Trial], device: Device) -> None:
    """Refuse an effort that stays at its limit while its joint moves.

    What goes further in another trial is no limit: a joint that is accelerated evenly about an
    upright axis stays on one step of a coarse effort (an opponent's).

    Raises:
        SessionError: names file, column and line.
    """
    for joint in device.recorded_joints:
        column, place = f"{joint}.effort", f"{joint}.position"
        there = [trial for trial in trials if column in trial.columns]
        every = [trial.columns[column] for trial in there]
        for trial, effort in zip(there, every, strict=True):
            line = saturated_line(effort, trial.columns[place])
            if line is None:
                continue
            value = effort[line - 2]
            ends = [(own.min(), own.max()) for own in every]
            if effort.min() < value and any(value < high for _, high in ends):
                continue
            if value < effort.max() and any(low < value for low, _ in ends):
                continue
            why = (
                f"is saturated: it stays at {value:g} while {joint} moves; "
                "repeat the trial below the motor's limit"
            )
            raise fault(trial, why, column, line - 2)


def check_torque(trial: Trial, device: Device, limb_joints: Collection[str]) -> None:
    """Refuse a torque that no limb bears, for a session in which nothing says the unit.

    Raises:
        SessionError: names file, column and line.
    """
    for joint in limb_joints:
        effort = trial.columns.get(f"{joint}.effort")
        if effort is None or not device.is_hinge(joint):
            continue
        beyond = np.abs(effort) > MOST_TORQUE
        if np.mean(beyond) > MOST_SHARE:
            row = int(np.argmax(beyond))
            why = (
                f"reaches {effort[row]:g} Nm, and no joint of a limb bears more than "
                f"{MOST_TORQUE:g}; efforts are in Nm: is its unit mNm?"
            )
            raise fault(trial, why, f"{joint}.effort", row)


def works(effort: np.ndarray, time: np.ndarray) -> bool:
    """Whether an effort changes through most of a trial by more than noise, as it does in motion.

    That of a held joint may drift, and somebody may push for less than half of the time: the line
    that is taken off, and what is left, are medians (Siegel 1982, Robust regression using repeated
    medians).
    """
    noise = median_abs_deviation(np.diff(effort), scale="normal") / np.sqrt(2.0)
    digit = float(np.diff(np.unique(effort)).min(initial=np.ptp(effort)))
    width = max(1, int(SLOW / float(np.median(np.diff(time)))))
    slow = uniform_filter1d(effort, width)[::width]
    drift = siegelslopes(slow).slope * np.arange(len(slow))
    return bool(median_abs_deviation(slow - drift, scale="normal") > WORKS * max(noise, digit))


def _check_wraps(trial: Trial, joint: str, position: np.ndarray) -> None:
    """Refuse positions that jump by a turn from one sample to the next."""
    clock = np.diff(trial.time)
    # In a gap a joint may turn as far as it likes.
    steps = np.where(clock > GAP_STEPS * float(np.median(clock)), 0.0, np.abs(np.diff(position)))
    jumps = np.abs(steps - 2.0 * np.pi) < NEAR_TURN
    if jumps.any() and steps[~jumps].max(initial=0.0) < NEAR_TURN:
        row = int(np.argmax(jumps)) + 1
        why = (
            f"jumps from {position[row - 1]:.4g} to {position[row]:.4g} rad, by about 2 pi, from "
            "one sample to the next: the encoder wraps; let the angle go on beyond it without the "
            "jump, as numpy.unwrap does"
        )
        raise fault(trial, why, f"{joint}.position", row)


def _check_jumps(trial: Trial, joint: str, position: np.ndarray) -> None:
    """Refuse a few samples to which no joint gets from the one before: damaged cells.

    More of them are a unit (`check_degrees`), and so is a speed that goes up and down by degrees.
    A motor whose range is declared may be fast: what lasts for several samples is its speed.
    """
    clock = np.diff(trial.time)
    # Stamps jitter, and samples that follow each other at once say nothing of a speed.
    speed = np.diff(position) / np.maximum(clock, float(np.median(clock)))
    change = np.abs(np.diff(speed, prepend=0.0, append=0.0))
    fastest = max(MAX_SPEED, float(median_filter(np.abs(speed), LASTING, mode="nearest").max()))
    jumps = (np.abs(speed) > fastest) & (np.minimum(change[:-1], change[1:]) > fastest)
    if jumps.any() and np.mean(jumps) <= MAX_SPEED_SHARE:
        row = int(np.argmax(jumps)) + 1
        count = int(jumps.sum())
        which = "the only one" if count == 1 else f"the first of {count}"
        why = (
            f"jumps from {position[row - 1]:.4g} to {position[row]:.4g} rad from one sample to the "
            f"next, at {abs(speed[row - 1]):.3g} rad/s: {which} among {len(jumps)} steps that "
            "is so fast between slower ones; remove the damaged rows (a gap is allowed)"
        )
        raise fault(trial, why, f"{joint}.position", row)


def _beyond_range(trial: Trial, device: Device, joint: str, position: np.ndarray) -> str:
    """Return what to say of positions outside of the declared range; empty if they are inside.

    Raises:
        SessionError: most of a movement is outside: its zero, its sign or the range is wrong.
    """
    low, high = device.range(joint)
    slack = BEYOND_RANGE * (high - low)
    beyond = (position < low - slack) | (position > high + slack)
    share = float(np.mean(beyond)) if high > low else 0.0
    unit = device.angle_unit(joint)
    where = f"the range that the model declares, {low:.3g} to {high:.3g} {unit}"
    if share > 0.5 and np.ptp(position) > MOVING:
        row = int(np.argmax(beyond))
        why = (
            f"is {position.min():.3g} to {position.max():.3g} {unit}, most of it outside of "
            f"{where}; mend the range (angles of MJCF are in degrees unless its compiler has "
            'angle="radian"), or the zero or sign of the column'
        )
        raise fault(trial, why, f"{joint}.position", row)
    return f"{share:.1%} of {joint}.position is outside of {where}" if share > 0.0 else ""


def _check_stuck(trial: Trial, joint: str, position: np.ndarray, velocity: np.ndarray) -> None:
    """Refuse an encoder that stays at one value while the recorded velocity says it moves."""
    step = np.diff(trial.time)
    travelled = np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * step)])
    least = max(STUCK, STUCK_SHARE * float(np.ptp(position)))
    edges = np.flatnonzero(np.diff(position)) + 1
    for start, end in zip([0, *edges], [*edges, len(position)], strict=True):
        if end - start < max(3.0, STUCK_RUN * len(position)):
            continue
        # A sensor's zero is no motion, nor is the walk that its noise adds up to.
        way = detrend(travelled[start:end])
        noise = float(np.diff(velocity[start:end]).std()) / np.sqrt(2.0)
        walk = noise * float(np.median(step)) * np.sqrt(end - start)
        if float(np.ptp(way)) > max(least, WALK * walk):
            why = (
                f"stays at {position[start]:g} for {end - start} samples while {joint}.velocity "
                "says that the joint moves; look at the encoder"
            )
            raise fault(trial, why, f"{joint}.position", start)


def _stuck_effort(effort: np.ndarray, position: np.ndarray, joint: str) -> str:
    """Say of an effort that it stays at one value in motion, and nowhere else; empty if not.

    A command may do so, so it is no error. At zero the motor may be off.
    """
    edges = np.flatnonzero(np.diff(effort)) + 1
    ends = [0, *edges, len(effort)]
    longest = int(np.argmax(np.diff(ends)))
    start, end = ends[longest], ends[longest + 1]
    count, others = end - start, len(effort) - (end - start)
    lively = len(edges) >= LIVELY * others and others > 0
    if not lively or not effort[start] or count < max(3.0, STUCK_RUN * len(effort)):
        return ""
    if np.ptp(position[start:end]) <= max(MOVING, STUCK_SHARE * float(np.ptp(position))):
        return ""
    return (
        f"{joint}.effort stays at {effort[start]:g} for {count} samples while the joint moves, and "
        "elsewhere changes with each: if its sensor was stuck, leave them out by from and to"
    )


def in_motion(recording: Recording, joint: int) -> np.ndarray:
    """Return the samples in which a joint's own motor moves it, (n,)."""
    rows = np.isin(recording.trial, recording.fit_trials)
    rows &= np.isfinite(recording.effort[:, joint])
    for piece in recording.slices:
        # Whoever pushes a joint that is held drives its motor.
        for hold in recording.held(joint, piece):
            rows[piece.start + hold.start : piece.start + hold.stop] = False
    return rows


def unknown_columns(recording: Recording, joint: int) -> np.ndarray:
    """Return the columns of an offset, stiffness, damping and Coulomb friction, (n, 4)."""
    position, velocity = recording.position[:, joint], recording.velocity[:, joint]
    moving = np.tanh(velocity / recording.rest_speed[joint])
    return np.column_stack([np.ones_like(velocity), position, velocity, moving])
