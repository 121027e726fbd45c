"""The whole system as one MuJoCo model: arm, muscles, tissue, exoskeleton and what joins them."""

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from sim.assessment.sensors import add_interface_sensors, add_torque_sensors
from sim.assessment.solver import let_the_solver_reorder, set_solver
from sim.assessment.target import ELBOW_TARGET, Target
from sim.body.elbow_muscles import PAPER_MUSCLES, REFITTED_MUSCLES
from sim.body.muscle_tables import FOREARM_ROTATORS, SHOULDER_MUSCLES
from sim.body.muscles import add_muscles
from sim.body.skeleton import HUMAN_JOINTS, add_arm, add_extension_stop, add_torso, empty_spec
from sim.body.soft_tissue import Sleeve, add_soft_tissue, set_contacts, sleeves
from sim.effects.carried import CarriedEffects, add_undeclared
from sim.interface.cuffs import (
    Cuff,
    add_contacts,
    add_cuff,
    add_slide,
    add_strap,
    cuffs,
    segment_names,
)
from sim.parameters.conditions import DEFAULT_CONDITIONS, Conditions
from sim.parameters.fidelity import CAMPAIGN, Fidelity
from sim.parameters.wearer import Wearer
from sim.robot.control import Gains
from sim.robot.device import ELBOW_JOINT, JOINTS, NESM, Device, add_exoskeleton

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

    wearer: Wearer
    conditions: Conditions
    target: Target
    device: Device
    fidelity: Fidelity
    gains: Gains
    #: Tissue of upper arm and forearm, and the cuff and strap of each.
    sleeves: tuple[Sleeve, Sleeve]
    cuffs: tuple[Cuff, Cuff]
    model: mujoco.MjModel

    @cached_property
    def exo_qpos(self) -> np.ndarray:
        return self._joints(self.device.joints, "qposadr")

    @cached_property
    def exo_dof(self) -> np.ndarray:
        return self._joints(self.device.joints, "dofadr")

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
        return np.array([self.model.actuator(muscle.name).id for muscle in self.target.muscles])

    @cached_property
    def contraction_inputs(self) -> np.ndarray:
        """Where their controls stand in `ctrl`; other actuators may have several inputs."""
        return np.array(self.model.actuator_ctrladr[self.contracted])

    @cached_property
    def motor_gain(self) -> np.ndarray:
        """Torque at each joint over what its motor reports, 1 as declared, shape (its joints,)."""
        gain = np.ones(len(self.device.joints))
        if "torque_gain" in self.conditions.effects:
            gain[self.moved] = self.conditions.effects["torque_gain"]["gain"]
        return gain

    def carried(self) -> CarriedEffects:
        """Return what the undeclared effects do at each step, without a history."""
        return CarriedEffects(self.model, self.conditions, JOINTS[self.target.joint])

    @property
    def activation(self) -> float:
        """Activation that those muscles hold, 0 to 1."""
        return self.target.contraction * self.conditions.activation

    @cached_property
    def locks(self) -> np.ndarray:
        """Equality index of the lock on each exoskeleton joint; none without contact."""
        kind, names = (
            mujoco.mjtObj.mjOBJ_EQUALITY,
            (f"lock_{joint}" for joint in self.device.joints),
        )
        locks = np.array([mujoco.mj_name2id(self.model, kind, name) for name in names])
        return locks[locks >= 0]

    @cached_property
    def straps(self) -> np.ndarray:
        """Tendon index of every segment that carries strap tension."""
        return np.array(
            [self.model.tendon(name).id for cuff in self.cuffs for name in segment_names(cuff)]
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
        return np.array([getattr(self.model.joint(name), attribute)[0] for name in names])


def base_spec(
    wearer: Wearer,
    gains: Gains,
    conditions: Conditions,
    target: Target,
    device: Device,
    *,
    step: float,
    whole: bool = True,
) -> mujoco.MjSpec:
    """Return arm, muscles and locked exoskeleton, with nothing yet to hold one in the other.

    Without `whole` there is no pronation and no lock, and of the muscles that do not cross the
    elbow only those that co-contract.
    """
    spec = empty_spec()
    set_solver(spec, step)
    add_torso(spec)
    add_arm(spec, wearer, pronates=whole)
    if conditions.extension_stop > 0.0:
        add_extension_stop(spec, conditions.extension_stop)
    elbow = REFITTED_MUSCLES if conditions.refitted_muscles >= 0.5 else PAPER_MUSCLES
    others = SHOULDER_MUSCLES + FOREARM_ROTATORS if whole else target.muscles
    add_muscles(spec, wearer, elbow=elbow, others=others)
    add_exoskeleton(
        spec,
        gains,
        friction=conditions.robot_friction,
        joint=JOINTS[target.joint],
        device=device,
    )
    add_torque_sensors(spec, device.joints, HUMAN_JOINTS[target.joint])
    add_undeclared(spec, conditions, gains, JOINTS[target.joint], HUMAN_JOINTS[target.joint])
    if conditions.cuff_compliance > 0.0:
        add_slide(spec, device.cuffs[1], conditions.cuff_compliance)
    start = device.start(target.name)
    for joint, zero, angle in zip(device.joints, device.zero, start.angles, strict=True):
        if whole:
            _add_lock(spec, joint, angle - zero)
    _set_the_scene(spec)
    return spec


def build_system(
    wearer: Wearer,
    gains: Gains,
    conditions: Conditions = DEFAULT_CONDITIONS,
    fidelity: Fidelity = CAMPAIGN,
    target: Target = ELBOW_TARGET,
    device: Device = NESM,
) -> System:
    """Build and compile the whole system for one wearer; the start pose is not yet set.

    Raises:
        ValueError: the device cannot assess the target.
    """
    parts = sleeves(
        wearer,
        tissue_scale=conditions.tissue_scale,
        coupling=conditions.tissue_coupling,
        fidelity=fidelity,
    )
    holders = cuffs(
        device.cuffs,
        fidelity,
        position=conditions.cuff_position,
        upper_position=conditions.upper_cuff_position,
        slides=conditions.cuff_compliance > 0.0,
    )
    spec = base_spec(wearer, gains, conditions, target, device, step=fidelity.step)
    spec.option.impratio = fidelity.impratio
    if fidelity.pyramids:
        spec.option.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    let_the_solver_reorder(spec)
    set_contacts(spec, conditions.cuff_friction, fidelity)
    for cuff, sleeve in zip(holders, parts, strict=True):
        add_soft_tissue(spec, sleeve)
        add_cuff(spec, cuff)
        add_strap(spec, cuff)
        add_contacts(spec, cuff, sleeve)
    add_interface_sensors(spec, holders, parts)
    return System(
        wearer=wearer,
        conditions=conditions,
        target=target,
        device=device,
        fidelity=fidelity,
        gains=gains,
        sleeves=parts,
        cuffs=holders,
        model=spec.compile(),
    )


def _set_the_scene(spec: mujoco.MjSpec) -> None:
    """Give pictures light and a pale background."""
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1600, 1200
    spec.visual.headlight.ambient = [0.45, 0.45, 0.45]
    spec.visual.headlight.diffuse = [0.5, 0.5, 0.5]
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[1.0, 1.0, 1.0],
        rgb2=[0.86, 0.89, 0.93],
        width=16,
        height=16,
    )
    spec.worldbody.add_light(
        pos=[0.5, -1.0, 1.5],
        dir=[-0.3, 0.6, -1.0],
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        castshadow=False,
    )


def _add_lock(spec: mujoco.MjSpec, joint: str, displacement: float) -> None:
    """Add a lock on a joint at `displacement` (rad) from its zero pose."""
    lock = spec.add_equality(
        name=f"lock_{joint}",
        type=mujoco.mjtEq.mjEQ_JOINT,
        name1=joint,
        active=False,
        solref=[0.02, 1.0],
    )
    lock.data[0] = displacement
    lock.solimp[:3] = [0.95, 0.99, 0.001]
