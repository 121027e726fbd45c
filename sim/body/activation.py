"""How the muscles' activation changes while the arm is moved.

The paper holds it constant. Two things may be added, both off by default: activation that rises or
falls with the movement's phase, and a stretch reflex after Lance 1980: a muscle that is stretched
faster than a threshold is activated more, in proportion to what exceeds it, after a delay.
"""

import mujoco
import numpy as np

from sim.assessment.system import System


class ActivationPattern:
    """The activation of every co-contracting muscle of one system during its movement.

    The reflex knows the joint's velocity alone: a muscle is stretched when the joint turns the way
    that lengthens it at the start.
    """

    def __init__(self, system: System, data: mujoco.MjData, reference: np.ndarray) -> None:
        """Prepare the pattern of the movement along `reference` (rad, shape (n,)) from `data`."""
        conditions = system.conditions
        travelled = reference - reference[0]
        progress = travelled / travelled[np.abs(travelled).argmax()]
        #: Activation without the reflex, shape (n,).
        self.level = system.activation * (1.0 + conditions.activation_rise * progress)
        self._gain, self._threshold = conditions.reflex_gain, conditions.reflex_threshold
        #: Steps from a stretch to the muscles' input.
        self.delay = max(1, round(conditions.reflex_delay / system.fidelity.step))
        #: Whether activation is anything but constant.
        self.varies = conditions.activation_rise != 0.0 or self._gain > 0.0
        #: Steps whose activation is known in advance.
        self.horizon = self.delay if self._gain > 0.0 else len(reference)
        #: The human joint's velocity before each step, rad/s; the caller fills it, shape (n,).
        self.velocity = np.zeros(len(reference))
        self._lengthens = np.zeros(len(system.contracted))
        if self._gain > 0.0:
            self._lengthens = np.sign(_lengthening(system, data))

    def activations(self, first: int, count: int) -> np.ndarray:
        """Return the activations of `count` steps from `first`, shape (count, muscles).

        Needs `velocity` up to `delay` steps before the last of them.
        """
        when = np.arange(first, first + count) - self.delay
        felt = np.where(when >= 0, self.velocity[when], 0.0)
        excess = np.maximum(np.abs(felt) - self._threshold, 0.0)
        stretched = np.sign(felt)[:, None] * self._lengthens > 0.0
        level = self.level[first : first + count, None]
        activations: np.ndarray = np.clip(
            level + self._gain * excess[:, None] * stretched, 0.0, 1.0
        )
        return activations


def _lengthening(system: System, data: mujoco.MjData) -> np.ndarray:
    """Return by how much each muscle lengthens as the human joint turns, m/rad."""
    probe = mujoco.MjData(system.model)
    probe.qpos[:] = data.qpos
    probe.qvel[system.human_dof[system.target.joint]] = 1.0
    mujoco.mj_fwdPosition(system.model, probe)
    mujoco.mj_fwdVelocity(system.model, probe)
    lengthening: np.ndarray = probe.actuator_velocity[system.contracted]
    return lengthening
