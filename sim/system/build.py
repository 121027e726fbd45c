"""How the system is built: arm, muscles, tissue, exoskeleton and what joins them, in that order."""

import mujoco

from sim.body.muscles.attach import add_muscles
from sim.body.muscles.authors import CO_CONTRACTING, FOREARM_ROTATORS, SHOULDER_MUSCLES
from sim.body.muscles.elbow import ELBOW_MUSCLES
from sim.body.skeleton import (
    HUMAN_JOINTS,
    add_arm,
    add_extension_stop,
    add_passive_impedance,
    add_torso,
    empty_spec,
)
from sim.body.soft_tissue import ABOVE_CUFF, UPPER_ARM_START, soft_tissues
from sim.interface.bushing import Bushings
from sim.interface.contact import Contact
from sim.interface.cuffs import add_slide, place_cuffs
from sim.interface.interface import Interface
from sim.parameters.conditions import CONTACT_ONLY, DEFAULT_CONDITIONS, MUSCLES, Conditions
from sim.parameters.fidelity import CAMPAIGN, Fidelity
from sim.parameters.target import ELBOW_TARGET, Target
from sim.parameters.wearer import Wearer
from sim.robot.device import ELBOW_JOINT, JOINTS, NESM, Device, add_exoskeleton
from sim.system.effects import add_effects
from sim.system.solver import set_interface_solver, set_solver
from sim.system.system import System


def build_system(
    wearer: Wearer,
    conditions: Conditions = DEFAULT_CONDITIONS,
    fidelity: Fidelity = CAMPAIGN,
    target: Target = ELBOW_TARGET,
    device: Device = NESM,
) -> System:
    """Build and compile the whole system for one wearer; the start pose is not yet set.

    Raises:
        ValueError: the device cannot assess the target, or a condition asks for something only
            contact has at a fidelity without.
    """
    for name in () if fidelity.contact else CONTACT_ONLY:
        if getattr(conditions, name) != getattr(DEFAULT_CONDITIONS, name):
            raise ValueError(
                f"the bushing has no contact, so {name} means nothing there: "
                "leave it out or choose another fidelity"
            )
    interface = _interface(wearer, conditions, fidelity, target, device)
    spec = _base_spec(wearer, conditions, fidelity, target, device)
    set_interface_solver(spec, fidelity)
    interface.add(spec)
    return System(
        conditions=conditions,
        target=target,
        device=device,
        fidelity=fidelity,
        interface=interface,
        model=spec.compile(),
    )


def _interface(
    wearer: Wearer, conditions: Conditions, fidelity: Fidelity, target: Target, device: Device
) -> Interface:
    """Return what holds the arm, and where."""
    upper = device.cuffs[0]
    above = upper.limb_place[0] - upper.length / 2 - ABOVE_CUFF
    tissues = soft_tissues(
        wearer,
        tissue_scale=conditions.tissue_scale,
        coupling=conditions.tissue_coupling,
        fidelity=fidelity,
        upper_start=min(UPPER_ARM_START, above),
    )
    cuffs = place_cuffs(device.cuffs, conditions)
    elbow = device.start(target.name).angles[device.joints.index(ELBOW_JOINT)]
    closed_at = elbow + conditions.seat_angle
    if not fidelity.contact:
        return Bushings(wearer=wearer, tissues=tissues, cuffs=cuffs, closed_at=closed_at)
    return Contact(
        wearer=wearer,
        tissues=tissues,
        cuffs=cuffs,
        closed_at=closed_at,
        fidelity=fidelity,
        friction=conditions.cuff_friction,
    )


def _base_spec(
    wearer: Wearer, conditions: Conditions, fidelity: Fidelity, target: Target, device: Device
) -> mujoco.MjSpec:
    """Return arm, muscles and locked exoskeleton, with nothing yet to hold one in the other.

    Without contact what hardly acts is left out: pronation, the locks, and of the muscles that do
    not cross the elbow those that do not co-contract (at most 0.004 Nm/rad on 32 Sobol points).
    """
    whole = fidelity.contact
    spec = empty_spec()
    set_solver(spec, fidelity.step)
    add_torso(spec)
    add_arm(spec, wearer, pronates=whole)
    if conditions.extension_stop > 0.0:
        add_extension_stop(spec, conditions.extension_stop)
    if conditions.passive_stiffness > 0.0 or conditions.passive_damping > 0.0:
        add_passive_impedance(
            spec,
            stiffness=conditions.passive_stiffness,
            damping=conditions.passive_damping,
            neutral_angle=conditions.neutral_angle,
        )
    others = SHOULDER_MUSCLES + FOREARM_ROTATORS if whole else CO_CONTRACTING[target.muscles]
    elbow = ELBOW_MUSCLES[MUSCLES[int(conditions.muscles)]]
    add_muscles(spec, wearer, elbow=elbow, others=others, strength=conditions.muscle_strength)
    gains, robot = device.gains.under(conditions), JOINTS[target.joint]
    human = HUMAN_JOINTS[target.joint]
    add_exoskeleton(spec, gains, friction=conditions.robot_friction, joint=robot, device=device)
    _add_torque_sensors(spec, device.joints, human)
    add_effects(spec, conditions, gains, robot, human)
    if conditions.cuff_compliance > 0.0:
        add_slide(spec, device.cuffs[1], conditions.cuff_compliance)
    start = device.start(target.name)
    for joint, zero, angle in zip(device.joints, device.zero, start.angles, strict=True):
        if whole:
            _add_lock(spec, joint, angle - zero)
    _set_the_scene(spec)
    return spec


def _add_torque_sensors(spec: mujoco.MjSpec, joints: tuple[str, ...], human_joint: str) -> None:
    """Measure the motor of each of the device's `joints` and the muscles about `human_joint`.

    To be called before any other sensor is added.
    """
    for joint in joints:
        spec.add_sensor(
            name=f"{joint}_motor_torque",
            type=mujoco.mjtSensor.mjSENS_ACTUATORFRC,
            objtype=mujoco.mjtObj.mjOBJ_ACTUATOR,
            objname=f"{joint}_motor",
        )
    spec.add_sensor(
        name="muscle_torque",
        type=mujoco.mjtSensor.mjSENS_JOINTACTFRC,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        objname=human_joint,
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
