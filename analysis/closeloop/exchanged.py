"""A joint's position and effort columns that stand for each other: told before all else is."""

from collections.abc import Collection, Sequence

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.optimize import nnls

from analysis.closeloop.session.contents import Trial
from analysis.closeloop.session.device import Device
from analysis.closeloop.session.faults import fault
from analysis.closeloop.session.signals import rms

#: Over so long signals are averaged, twice, s: what is left of either is motion.
SMOOTH = 0.1
#: A trial of fewer such lengths says nothing.
SHORTEST = 8
#: Samples of a trial at which the declared model is asked.
ASKED = 400
#: Share of an effort's variance that the model leaves at least as recorded, and of that the share
#: it leaves at most the other way round. Set on 36 simulated arms, which left 0.0 to 0.9 and, with
#: their columns exchanged, 0.8 to 1.0. Of 758 trials, 20 of them of real robots, none is refused
#: as it is, though some positions were the rougher; exchanged, 693 of 749 without a limb are.
LEAVES, LESS = 0.5, 0.5
#: Where friction turns around, over a joint's usual speed.
TURNS = 0.1


def check_exchanged(trial: Trial, device: Device, limb_joints: Collection[str]) -> None:
    """Refuse a trial of a robot in which positions and efforts are exchanged.

    A joint's inertia makes its position the smoothest of its signals, and a motor's effort has the
    noise of currents and steps where friction turns. Of joints whose position is rougher than their
    effort, the declared model is asked both ways round: no sensor's noise makes an effort what the
    model moves by. Degrees, ranges and limits would be told of these columns otherwise.

    Args:
        trial: with its signals.
        device: what is declared.
        limb_joints: of these nothing is asked: position and effort of a spring look alike.

    Raises:
        SessionError: names the first such joint's position.
    """
    suspects = [
        joint
        for joint in device.recorded_joints
        if joint not in limb_joints
        and f"{joint}.effort" in trial.columns
        and roughness(trial.columns[f"{joint}.position"])
        > roughness(trial.columns[f"{joint}.effort"])
        > 0.0
    ]
    if not suspects or len(trial.time) < SHORTEST * _width(trial):
        return
    recorded = float(np.mean(left(trial, device, suspects, ())))
    exchanged = float(np.mean(left(trial, device, suspects, suspects)))
    if recorded > LEAVES and exchanged < LESS * recorded:
        also = f", as do those of {', '.join(suspects[1:])}" if suspects[1:] else ""
        why = (
            f"looks exchanged with {suspects[0]}.effort{also}: it is the rougher of the two, and "
            f"the declared model leaves {exchanged:.0%} of the efforts' variance the other way "
            f"round, as recorded {recorded:.0%}; exchange the columns"
        )
        raise fault(trial, why, f"{suspects[0]}.position")


def roughness(signal: np.ndarray) -> float:
    """Return how a signal's steps change from one to the next, over their size: 1.7 of noise."""
    steps = np.diff(signal)
    size = rms(steps)
    return rms(np.diff(steps)) / size if size > 0.0 else 0.0


def left(
    trial: Trial, device: Device, joints: Sequence[str], exchanged: Collection[str]
) -> list[float]:
    """Return the share of each joint's effort, averaged, that the declared model leaves.

    Its torque has a factor of its own; friction, inertia and an offset may stand beside it.

    Args:
        trial: with its signals.
        device: what is declared.
        joints: whose effort is looked at.
        exchanged: joints whose position and effort are taken for each other.
    """
    width = _width(trial)
    inside = np.arange(2 * width, len(trial.time) - 2 * width)
    rows = inside[:: max(1, len(inside) // ASKED)]
    position = np.tile(device.reference, (len(trial.time), 1))
    for joint in device.recorded_joints:
        name = "effort" if joint in exchanged else "position"
        position[:, device.dof(joint)] = _smooth(trial.columns[f"{joint}.{name}"], width)
    velocity = np.gradient(position, trial.time, axis=0)
    acceleration = np.gradient(velocity, trial.time, axis=0)
    needed = device.inverse_dynamics(position[rows], velocity[rows], acceleration[rows])
    shares = []
    for joint in joints:
        number = device.dof(joint)
        name = "position" if joint in exchanged else "effort"
        effort = _smooth(trial.columns[f"{joint}.{name}"], width)[rows]
        effort = effort - effort.mean()
        own, one = velocity[rows, number], np.ones(len(rows))
        friction = np.tanh(own / max(TURNS * rms(own), 1e-12))
        inertia = acceleration[rows, number]
        table = np.column_stack([needed[:, number], own, friction, inertia, one, -one])
        table /= np.maximum(np.sqrt((table**2).mean(axis=0)), 1e-12)
        # Nothing but the constant may be negative: links, friction and inertia resist.
        shares.append(nnls(table, effort)[1] ** 2 / max(float(effort @ effort), 1e-300))
    return shares


def _width(trial: Trial) -> int:
    """Return the number of samples that are averaged."""
    return max(1, round(SMOOTH / float(np.median(np.diff(trial.time)))))


def _smooth(signal: np.ndarray, width: int) -> np.ndarray:
    return np.asarray(uniform_filter1d(uniform_filter1d(signal, width), width))
