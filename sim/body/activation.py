"""How the muscles' activation changes while the arm is moved.

The paper holds it constant. Two things may be added, both off by default: activation that rises or
falls with the movement's phase, and a stretch reflex after Lance 1980: a muscle that is stretched
faster than a threshold is activated more, in proportion to what exceeds it, after a delay.
"""

import mujoco
import numpy as np

from sim.parameters.conditions import Conditions


def voluntary(conditions: Conditions, reference: np.ndarray, level: float) -> np.ndarray:
    """Return the activation without a reflex along `reference` (rad, shape (n,)), shape (n,).

    `level` is that before the movement, 0 to 1.
    """
    travelled = reference - reference[0]
    progress = travelled / travelled[np.abs(travelled).argmax()]
    return np.asarray(level * (1.0 + conditions.activation_rise * progress))


class ActivationPattern:
    """The activation of every co-contracting muscle during one movement.

    The reflex knows the joint's velocity alone: a muscle is stretched when the joint turns the way
    that lengthens it at the start.
    """

    def __init__(
        self,
        conditions: Conditions,
        reference: np.ndarray,
        *,
        level: float,
        step: float,
        lengthening: np.ndarray,
    ) -> None:
        """Prepare the pattern of a movement.

        Args:
            conditions: with the rise of activation and the reflex.
            reference: the joint's desired angle, rad, shape (n,).
            level: activation before the movement, 0 to 1.
            step: seconds between two angles.
            lengthening: how much each muscle lengthens as the joint turns, of which only the sign
                matters, shape (muscles,).
        """
        #: Activation without the reflex, shape (n,).
        self.level = voluntary(conditions, reference, level)
        self._gain, self._threshold = conditions.reflex_gain, conditions.reflex_threshold
        #: Steps from a stretch to the muscles' input.
        self.delay = max(1, round(conditions.reflex_delay / step))
        #: Steps whose activation is known in advance.
        self.horizon = self.delay if self._gain > 0.0 else len(reference)
        #: The human joint's velocity before each step, rad/s; the caller fills it, shape (n,).
        self.velocity = np.zeros(len(reference))
        shape = (len(reference), len(lengthening))
        self._unstretched = np.broadcast_to(np.clip(self.level, 0.0, 1.0)[:, None], shape)
        #: Which muscles a positive velocity stretches, and which a negative one.
        self._stretched = lengthening > 0.0, lengthening < 0.0

    def activations(self, first: int, count: int) -> np.ndarray:
        """Return the activations of `count` steps from `first`, shape (count, muscles).

        Needs `velocity` up to `delay` steps before the last of them.
        """
        steps = slice(first, first + count)
        begin, end = first - self.delay, first - self.delay + count
        felt = self.velocity[max(0, begin) : max(0, end)]
        excess = np.abs(felt) - self._threshold
        if self._gain <= 0.0 or not (excess > 0.0).any():
            return self._unstretched[steps]
        added = np.zeros((count, len(self._stretched[0])))
        stretched = np.where(felt[:, None] > 0.0, *self._stretched)
        added[count - len(felt) :] = self._gain * np.maximum(excess, 0.0)[:, None] * stretched
        return np.asarray(np.minimum(np.maximum(self.level[steps, None] + added, 0.0), 1.0))


def muscle_lengthening(
    model: mujoco.MjModel, data: mujoco.MjData, dof: int, muscles: np.ndarray
) -> np.ndarray:
    """Return by how much muscles (their actuators) lengthen as a joint (its dof) turns, m/rad."""
    probe = mujoco.MjData(model)
    probe.qpos[:] = data.qpos
    probe.qvel[dof] = 1.0
    mujoco.mj_fwdPosition(model, probe)
    mujoco.mj_fwdVelocity(model, probe)
    lengthening: np.ndarray = probe.actuator_velocity[muscles]
    return lengthening
