"""Angles in degrees, which their size tells or the velocity beside them."""

import numpy as np
from scipy.signal import butter, sosfiltfilt

from analysis.closeloop.session.contents import Trial
from analysis.closeloop.session.device import MAX_HINGE, Device
from analysis.closeloop.session.faults import fault
from analysis.closeloop.session.runs import MOVING, TRAVEL
from analysis.closeloop.unit_names import UNITS, split_unit

#: A hinge that may turn for ever is recorded in degrees if it turns faster than that, rad/s: no
#: robot's joint does 600 turns a minute.
MAX_SPEED = 60.0
#: Least share of samples that do.
MAX_SPEED_SHARE = 0.01
DEGREES = 180.0 / np.pi
#: A velocity that is so many times the slope of its position, or that part of it, has another unit
#: or another clock: no filter of a robot does that to the whole of a motion.
OFF = 1.5
#: Two turns, in degrees: what goes further turns on and on, whichever of both units it is in.
EITHER_WAY = 720.0
#: Band in which a velocity and the slope of its position are compared, Hz.
SLOW = 5.0
#: Correlation of both below which their sizes say nothing.
MATCH = 0.8
#: How far the factor of a column map may be from that of the unit in the column's name: people
#: write 0.0175 for a degree. No log was looked at.
NEAR_FACTOR = 0.01


def check_degrees(
    trial: Trial, device: Device, joint: str, position: np.ndarray, limb: bool
) -> list[str]:
    """Refuse angles that are degrees by their size; return what to say of a motor that is so fast.

    Gearless motors turn faster than any robot's joint. Their file may say that it is in radians, or
    show it: one that turns on and on, with no joint behind it, may be in either, and of degrees
    beside rad/s the velocity is another than the slope. Degrees beside deg/s are left to what the
    model's inertia says of them (`check_units`).

    Raises:
        SessionError: names file, column and line.
    """
    low, high = device.range(joint)
    if limb or high > low:
        # A device may rightly turn further than a limb does, if its declared range says so.
        beyond = np.abs(position) > max(MAX_HINGE, 1.5 * max(abs(low), abs(high)))
        what = "no limb does" if limb else f"is far beyond its range, {low:g} to {high:g}"
        unit, otherwise = "rad", ""
        values = position
    else:
        values = np.gradient(position, trial.time)
        beyond = np.abs(values) > MAX_SPEED
        what, unit = "no robot's joint does", "rad/s"
        otherwise = (
            "; give a motor that is so fast a `range` in the model, the angles that it goes "
            "through, or its trials its velocity"
        )
        # One wrong sample is no unit.
        beyond &= np.mean(beyond) > MAX_SPEED_SHARE
        if beyond.any() and _says_its_unit(trial, f"{joint}.position"):
            return []
        if beyond.any() and np.ptp(position) > EITHER_WAY and device.is_last(joint):
            return [
                f"{joint} goes through {np.ptp(position):.4g}, and its model has no range: a motor "
                f"that turns on and on does that in radians ({np.ptp(position) / 2 / np.pi:.3g} "
                f"turns) and in degrees ({np.ptp(position) / 360:.3g}); taken for radians: if they "
                "are degrees, no inertia nor damping found is right"
            ]
        velocity = trial.columns.get(f"{joint}.velocity")
        if beyond.any() and velocity is not None and _agrees(trial, position, velocity):
            return [
                f"{joint} reaches {np.abs(values[beyond]).max():.3g} rad/s, which no robot's joint "
                "does, but a motor without a gear; its velocity agrees: if both are in degrees, "
                "no inertia found is right"
            ]
    if not beyond.any():
        return []
    row = int(np.argmax(beyond))
    why = (
        f"reaches {values[row]:g} {unit}, which {what}; "
        f"positions are in radians, and these look like degrees{otherwise}"
    )
    raise fault(trial, why, f"{joint}.position", row)


def _says_its_unit(trial: Trial, column: str) -> bool:
    """Whether the name of a column has a unit, and the map of the session that unit's factor."""
    source = trial.source.sources.get(column) if trial.source else None
    if source is None or not isinstance(source.signal, str):
        return False
    _, unit, sure = split_unit(source.signal)
    return (
        unit is not None
        and sure
        and UNITS[unit].quantity == "position"
        and abs(abs(source.scale) / UNITS[unit].scale - 1.0) < NEAR_FACTOR
    )


def _slow(trial: Trial, signal: np.ndarray) -> np.ndarray:
    """Return what is left of a signal of a trial below a few Hz."""
    rate = 1.0 / float(np.median(np.diff(trial.time)))
    sections = butter(2, min(SLOW / rate * 2.0, 0.9), output="sos")
    return np.asarray(sosfiltfilt(sections, signal))


def _slow_slope(trial: Trial, position: np.ndarray) -> np.ndarray:
    return _slow(trial, np.gradient(position, trial.time))


def _gain(trial: Trial, position: np.ndarray, velocity: np.ndarray) -> float | None:
    """Return how many times the slope of its position a velocity is; None where none can say."""
    if np.ptp(position) <= MOVING:
        return None
    slope, recorded = _slow_slope(trial, position), _slow(trial, velocity)
    power = float(slope @ slope)
    if power < len(slope) * 1e-8 or not np.any(recorded):
        return None
    gain = float(slope @ recorded) / power
    match = gain * power / np.sqrt(power * float(recorded @ recorded))
    return gain if abs(match) >= MATCH else None


def _agrees(trial: Trial, position: np.ndarray, velocity: np.ndarray) -> bool:
    gain = _gain(trial, position, velocity)
    return gain is not None and 1.0 / OFF < gain < OFF


def check_velocity(trial: Trial, joint: str, position: np.ndarray, velocity: np.ndarray) -> None:
    """Compare a recorded velocity with the slope of its position, both smoothed alike.

    Of a joint that is held, both are what an encoder's last digit and a robot's own filter make.
    """
    gain = _gain(trial, position, velocity)
    if gain is None:
        return
    step = float(np.median(np.diff(trial.time)))
    column = f"{joint}.velocity"
    row = int(np.argmax(np.abs(_slow_slope(trial, position))))
    if gain < -0.2:
        why = f"has the opposite sign of the slope of {joint}.position; flip one of them"
        raise fault(trial, why, column, row)
    # Of a joint that hardly moves, a robot's own filter may take half: what it does is quick.
    if 1.0 / OFF < gain < OFF or (
        OFF / DEGREES < gain < DEGREES / OFF and np.ptp(position) < TRAVEL
    ):
        return
    if 1.0 / OFF < max(gain, 1.0 / gain) / DEGREES < OFF:
        unit = "the velocity" if gain > 1 else "the position"
        column = column if gain > 1 else f"{joint}.position"
        why = (
            f"is {gain:.3g} times the slope of {joint}.position: {unit} looks like degrees; "
            "both are in radians"
        )
    else:
        why = (
            f"is {gain:.3g} times the slope of {joint}.position: if both are in one unit, samples "
            f"are {step / gain:.3g} s apart and not {step:.3g} s; the velocity's scale or the "
            "clock is wrong"
        )
    raise fault(trial, why, column, row)
