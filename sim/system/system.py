"""The whole system: one compiled MuJoCo model, and where its parts are."""

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from sim.body.muscles.authors import CO_CONTRACTING
from sim.body.skeleton import HUMAN_JOINTS
from sim.interface.interface import Interface
from sim.interface.straps import segment_names
from sim.parameters.conditions import Conditions
from sim.parameters.fidelity import Fidelity
from sim.parameters.target import Target
from sim.robot.control import Gains
from sim.robot.device import ELBOW_JOINT, JOINTS, Device
from sim.system.effects import EffectForces, motor_gain

if mujoco.__version__ == "4.0.0":
    raise ImportError(
        "MuJoCo 4.0.0 factorises many sparse models wrongly (its issue 3767) and gives wrong "
        "stiffness without a word: install mujoco-core 4.0.1 or later"
    )

# MuJoCo would append each warning to a file in the working directory; ours are named outcomes.
mujoco.set_mju_user_warning(lambda message: None)


@dataclass(frozen=True, kw_only=True)
class System:
    """A compiled model and where its parts are; index arrays follow the names they come from."""

    conditions: Conditions
    target: Target
    device: Device
    fidelity: Fidelity
    #: How the exoskeleton holds the arm.
    interface: Interface
    model: mujoco.MjModel

    @cached_property
    def gains(self) -> Gains:
        """Gains of every motor."""
        return self.device.gains.under(self.conditions)

    @cached_property
    def exo_qpos(self) -> np.ndarray:
        return self._joints(self.device.joints, "qposadr")

    @cached_property
    def exo_dof(self) -> np.ndarray:
        return self._joints(self.device.joints, "dofadr")

    @cached_property
    def passive_qpos(self) -> np.ndarray:
        return self._joints(self.device.passive, "qposadr")

    @cached_property
    def passive_dof(self) -> np.ndarray:
        return self._joints(self.device.passive, "dofadr")

    @cached_property
    def human_qpos(self) -> np.ndarray:
        return self._joints(HUMAN_JOINTS, "qposadr")

    @cached_property
    def human_dof(self) -> np.ndarray:
        return self._joints(HUMAN_JOINTS, "dofadr")

    @cached_property
    def motors(self) -> np.ndarray:
        """Actuator index of each exoskeleton joint's motor."""
        return np.array([self.model.actuator(f"{joint}_motor").id for joint in self.device.joints])

    @cached_property
    def motor_limits(self) -> np.ndarray:
        """Largest torque of each motor, Nm, infinite if it has no limit, shape (its joints,)."""
        limited = self.model.actuator_forcelimited[self.motors].astype(bool)
        return np.where(limited, self.model.actuator_forcerange[self.motors, 1], np.inf)

    @cached_property
    def moved(self) -> int:
        """Which of the exoskeleton's joints is moved; of the human's it is `target.joint`."""
        return self.device.joints.index(JOINTS[self.target.joint])

    @property
    def elbow(self) -> int:
        """Which of the exoskeleton's joints is the elbow."""
        return self.device.joints.index(ELBOW_JOINT)

    @cached_property
    def start(self) -> np.ndarray:
        """Exoskeleton angles at the start, rad, shape (number of its joints,)."""
        return np.array(self.device.start(self.target.name).angles)

    @cached_property
    def contracted(self) -> np.ndarray:
        """Actuator index of the muscles that co-contract."""
        muscles = CO_CONTRACTING[self.target.muscles]
        return np.array([self.model.actuator(muscle.name).id for muscle in muscles])

    @cached_property
    def contraction_inputs(self) -> np.ndarray:
        """Where their controls stand in `ctrl`; other actuators may have several inputs."""
        return np.array(self.model.actuator_ctrladr[self.contracted])

    @cached_property
    def motor_gain(self) -> np.ndarray:
        """Torque at each joint over what its motor reports, 1 as declared, shape (its joints,)."""
        gain = np.ones(len(self.device.joints))
        gain[self.moved] = motor_gain(self.conditions)
        return gain

    def effect_forces(self) -> EffectForces:
        """Return what the effects do at each step, without a history."""
        return EffectForces(self.model, self.conditions, JOINTS[self.target.joint])

    @property
    def activation(self) -> float:
        """Activation that those muscles hold, 0 to 1."""
        return self.target.contraction * self.conditions.activation

    @cached_property
    def locks(self) -> np.ndarray:
        """Equality index of the lock on each exoskeleton joint; none without contact."""
        joints = self.device.joints if self.fidelity.contact else ()
        return np.array([self.model.equality(f"lock_{joint}").id for joint in joints], dtype=int)

    @cached_property
    def straps(self) -> np.ndarray:
        """Tendon index of every segment that carries strap tension."""
        return np.array(
            [
                self.model.tendon(name).id
                for cuff in self.interface.cuffs
                for name in segment_names(cuff, self.fidelity)
            ]
        )

    @cached_property
    def exo_range(self) -> tuple[float, float]:
        """Range of the exoskeleton joint that is moved, rad."""
        return self._range(JOINTS[self.target.joint])

    @cached_property
    def human_range(self) -> tuple[float, float]:
        """Range of the human joint that is assessed, rad."""
        return self._range(HUMAN_JOINTS[self.target.joint])

    def _range(self, joint: str) -> tuple[float, float]:
        low, high = self.model.joint(joint).range
        return float(low), float(high)

    def _joints(self, names: tuple[str, ...], attribute: str) -> np.ndarray:
        return np.array(
            [getattr(self.model.joint(name), attribute)[0] for name in names], dtype=int
        )
