"""Whether the moved joint rubs more than the bank's: what it takes to break it away.

A joint with dry friction stays where it is until the motor's torque has grown by that friction
(Armstrong-Helouvry, Dupont and Canudas de Wit 1994, A survey of models for the control of machines
with friction). Muscles and cuffs push with as much only over an angle: no summary of the movement
tells such a joint from an offset and other muscles, and its first hundredth of a radian does.
"""

import numpy as np
from scipy.ndimage import uniform_filter1d

from analysis.interpretation.bank.population import Population
from sim.assessment.nominal import nominal_model
from sim.assessment.summary import Motion, half_way
from sim.effects.catalogue import ASSESSED
from sim.parameters.effects import PREFIX
from sim.robot.device import Device

#: How far a joint may have moved before it counts as broken away, rad, and over how many seconds
#: before that its torque is looked at.
STUCK, BEFORE_THAT = 0.01, 1.0
#: Torques are means over so many seconds.
SMOOTH = 0.1
#: By how much muscles and cuffs change the torque meanwhile, Nm: in 12 wearers with contact (seed
#: 7106) by 0.11 to 0.88, friction up to 0.5 Nm among it. Ours, set while looking at these.
OTHERWISE = 1.0


def break_away(motion: Motion, device: Device) -> float:
    """Return by how much the torque on the moved joint changes before that moves, Nm.

    Args:
        motion: one movement.
        device: what is declared of the robot.

    Raises:
        RecordingError: it holds no movement.
    """
    time, joint = motion.time, motion.joint
    angle = motion.theta[:, joint]
    acceleration = np.gradient(motion.velocity, time, axis=0)
    torque = (
        nominal_model(device).inverse_dynamics(motion.theta, motion.velocity, acceleration, joint)
        - motion.torque[:, joint]
    )
    samples = max(1, round(SMOOTH / float(np.median(np.diff(time)))))
    torque = uniform_filter1d(torque, samples, mode="nearest")
    began = angle[: max(1, len(angle) // 50)].mean()
    still = (time < half_way(time, angle)) & (np.abs(angle - began) < STUCK)
    if not still.any():
        return 0.0
    left = time[still][-1]
    return float(np.ptp(torque[still & (time >= left - BEFORE_THAT)]))


def most_friction(population: Population) -> float | None:
    """Return the largest friction of the moved joint in a population, Nm.

    None if an effect rubs there, too, for the friction of which is no one number.
    """
    names = (*population.names, *population.fixed)
    if any(name.startswith(PREFIX) and ASSESSED[name.split(".")[1]].rubs for name in names):
        return None
    if "robot_friction" in population.names:
        return population.ends("robot_friction")[1]
    return population.fixed.get("robot_friction", 0.0)


def rubs(motion: Motion, device: Device, population: Population) -> str | None:
    """Return that the moved joint has more friction than anybody's in a population, or None."""
    most = most_friction(population)
    if most is None:
        return None
    found = break_away(motion, device)
    if found <= most + OTHERWISE:
        return None
    return (
        f"it takes {found:.2g} Nm to break the moved joint away, and with the friction of the "
        f"bank's robots (up to {most:.2g} Nm) {most + OTHERWISE:.2g} at most: the joint has more"
    )
