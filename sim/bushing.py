"""The fidelity without contact: each cuff holds its limb by a six-dimensional viscoelastic bushing.

After Kühn et al. 2018. A bushing is seven rods of springs, so long that their directions stay
those of the cuff: four radial ones at two places along the limb, which also resist tilting, one
axial, and two that resist torsion. Nothing slips, rolls or loses contact, so the response is smooth
and an assessment takes milliseconds; `docs/simulation.md` says how far it agrees with contact.
"""

from dataclasses import replace

import mujoco
import numpy as np
from mujoco import rollout

from sim.activation import ActivationPattern
from sim.carried import CarriedEffects
from sim.catalogue import CONTACT_ONLY
from sim.conditions import DEFAULT_CONDITIONS, Conditions
from sim.control import Gains
from sim.exoskeleton import MOTOR_GROUP, NESM, Device
from sim.fidelity import CAMPAIGN
from sim.interface import Cuff, cuffs
from sim.model import (
    System,
    base_spec,
    direction,
    elbow_angle,
    forearm_cuff_centre,
    seated_elbow_angle,
)
from sim.protocol import HOLD, Motion, movement
from sim.record import Record, acting_torque
from sim.skeleton import ELBOW, HUMAN_JOINTS, upper_arm_point
from sim.soft_tissue import BONE_CLEARANCE, HARDENING, Sleeve, sleeves
from sim.target import ELBOW_TARGET, Target
from sim.validity import FailedError, Failure, Posture, check_posture, check_start
from sim.wearer import Wearer

#: Length of a rod, m: over 5 cm of displacement its direction turns by one degree.
ROD = 3.0
#: Elements that carry a load across the limb: half of the 59 under a cuff 8 cm long, because each
#: shares in the load by the square of the cosine to its direction.
ENGAGED = 30
#: Stiffness of cuff and strap in series with the tissue, N/m (compression of contacts and strap).
CUFF_STIFFNESS = 1e5
#: Damping of the rods as a share of the tissue's. The integrator takes damping between two trees
#: for inertia on each, step x damping: all of it is 0.6 kg m2 at the elbow, five times the forearm,
#: and 0.4 Nm/rad of stiffness. Below half of it the lightest arms swing into their stops.
DAMPING_SHARE = 0.5
#: Axial stiffness, N/m: a misaligned limb slides some centimetres against some tens of newtons of
#: friction, whatever the tissue; the secant of that.
AXIAL_STIFFNESS = 1500.0
#: Torsional stiffness as a share of the radial one.
TORSIONAL = 0.3
#: The limbs' divisions (which only validity looks at) and the step.
FIDELITY = replace(CAMPAIGN, name="bushing", step=0.01)
RODS = ("radial_1", "radial_2", "radial_3", "radial_4", "axial", "torsion_1", "torsion_2")


def build_bushings(
    wearer: Wearer,
    gains: Gains,
    conditions: Conditions,
    target: Target = ELBOW_TARGET,
    device: Device = NESM,
) -> System:
    """Build and compile arm and exoskeleton joined by bushings, unloaded in the seat.

    Raises:
        ValueError: a condition asks for something only contact has, or the device cannot assess the
            target.
    """
    for name in CONTACT_ONLY:
        if getattr(conditions, name) != getattr(DEFAULT_CONDITIONS, name):
            raise ValueError(
                f"the bushing has no contact, so {name} means nothing there: "
                "leave it out or choose another fidelity"
            )
    parts = sleeves(wearer, tissue_scale=conditions.tissue_scale)
    holders = cuffs(
        device.cuffs,
        FIDELITY,
        position=conditions.cuff_position,
        upper_position=conditions.upper_cuff_position,
        slides=conditions.cuff_compliance > 0.0,
    )
    spec = base_spec(wearer, gains, conditions, target, device, step=FIDELITY.step)
    closed_at = elbow_angle(device, device.start(target.name)) + conditions.seat_angle
    seats = _seats(wearer, parts, holders, closed_at)
    for cuff, sleeve, seat in zip(holders, parts, seats, strict=True):
        _add_bushing(spec, cuff, sleeve, *seat)
    _add_sensors(spec, holders, target, device)
    return System(
        wearer=wearer,
        conditions=conditions,
        target=target,
        device=device,
        fidelity=FIDELITY,
        gains=gains,
        sleeves=parts,
        cuffs=holders,
        model=spec.compile(),
    )


def run_bushings(system: System, data: mujoco.MjData, motion: Motion | None = None) -> Record:
    """Hold, release and extend as the protocol with contact does; return what was recorded.

    Both parts run inside the engine. `data` holds the last state afterwards. Another `motion` than
    the assessment's sigmoid may be given.

    Raises:
        FailedError: a detector fired.
    """
    model, step, moved = system.model, system.fidelity.step, system.moved
    control = np.zeros((round(HOLD / step), model.nu))
    control[:, system.contraction_inputs] = system.activation
    data.act[model.actuator_actadr[system.contracted]] = system.activation
    _release(system, locked=True)
    carried = system.carried()
    _roll_out(system, data, carried, control, "hold")
    failure = check_start(
        human_speed=data.qvel[system.human_dof],
        exo_error=data.qpos[system.exo_qpos] - system.start,
    )
    if failure:
        raise FailedError(failure, "hold")
    data.eq_active[system.locks] = 1
    mujoco.mj_forward(model, data)
    lock_torque = data.qfrc_constraint[system.exo_dof] / system.motor_gain
    _release(system, locked=False)
    for motor, torque in zip(system.motors, lock_torque, strict=True):
        if model.actuator_actadr[motor] >= 0:
            data.act[model.actuator_actadr[motor]] = torque / system.gains.ki
    time, reference, velocity = movement(system) if motion is None else motion
    control = np.tile(control[-1], (len(time), 1))
    position_input = model.actuator_ctrladr[system.motors]
    control[:, position_input] = system.start
    control[:, position_input[moved]] = reference
    control[:, position_input[moved] + 1] = velocity
    pattern = ActivationPattern(system, data, reference)
    states, sensed = _move(system, data, carried, control, pattern)
    record = _record(system, time, reference, states, sensed)
    _check(system, record, sensed)
    return record


def _seats(
    wearer: Wearer,
    parts: tuple[Sleeve, Sleeve],
    holders: tuple[Cuff, Cuff],
    exo_angle: float,
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return where each cuff's centre and axes lie in its bone at the start: (3,) and (3, 3).

    The axes are columns: along the limb, out of the opening, towards the upper wall.
    """
    upper, fore = holders
    at_shoulder = np.array(upper.limb_place)
    angle = seated_elbow_angle(wearer, parts[1], fore, exo_angle)
    elbow = upper_arm_point(wearer, ELBOW)
    offset = forearm_cuff_centre(fore, exo_angle) - elbow[[0, 2]]
    local = np.array([offset @ direction(angle), offset @ direction(angle + np.pi / 2)])
    centre = np.array([local[0], fore.limb_place[1] - elbow[1], local[1]])
    turn = exo_angle - angle
    tilted = np.array(
        [[np.cos(turn), 0.0, -np.sin(turn)], [0.0, 1.0, 0.0], [np.sin(turn), 0.0, np.cos(turn)]]
    )
    return [(at_shoulder, np.eye(3)), (centre, tilted)]


def _add_bushing(
    spec: mujoco.MjSpec, cuff: Cuff, sleeve: Sleeve, centre: np.ndarray, axes: np.ndarray
) -> None:
    """Join one limb to its cuff; `centre` and `axes` are the cuff's, in the limb's bone."""
    tissue = ENGAGED * sleeve.elasticity
    radial = tissue * CUFF_STIFFNESS / (tissue + CUFF_STIFFNESS)
    relaxation = DAMPING_SHARE * sleeve.viscosity / sleeve.elasticity * radial / tissue
    in_link = np.column_stack([cuff.along, cuff.opening, cuff.wall])
    lever = cuff.length / 2 / np.sqrt(3.0)
    link, bone = spec.body(cuff.link), spec.body(sleeve.bone)
    for name, at, towards, stiffness in (
        ("radial_1", (lever, 0.0, 0.0), 1, radial / 2),
        ("radial_2", (-lever, 0.0, 0.0), 1, radial / 2),
        ("radial_3", (lever, 0.0, 0.0), 2, radial / 2),
        ("radial_4", (-lever, 0.0, 0.0), 2, radial / 2),
        ("axial", (0.0, 0.0, 0.0), 0, AXIAL_STIFFNESS),
        ("torsion_1", (0.0, cuff.radius, 0.0), 2, TORSIONAL * radial / 2),
        ("torsion_2", (0.0, -cuff.radius, 0.0), 2, TORSIONAL * radial / 2),
    ):
        place = np.array(at)
        # Only pressed tissue hardens; friction does not.
        hardening = 1.0 if name.startswith("radial") else 0.0
        name = f"{cuff.name}_{name}"
        bone.add_site(name=f"{name}_limb", pos=centre + axes @ place)
        link.add_site(
            name=f"{name}_cuff",
            pos=np.array(cuff.centre) + in_link @ place + ROD * in_link[:, towards],
        )
        rod = spec.add_tendon(
            name=name,
            stiffness=[
                stiffness,
                0.0,
                hardening * stiffness / HARDENING**2,
            ],
            damping=[relaxation * stiffness, 0.0, 0.0],
            springlength=[ROD, ROD],
            # So long that they would fill every picture.
            rgba=[0.0, 0.0, 0.0, 0.0],
        )
        rod.wrap_site(f"{name}_limb")
        rod.wrap_site(f"{name}_cuff")


def _add_sensors(
    spec: mujoco.MjSpec, holders: tuple[Cuff, Cuff], target: Target, device: Device
) -> None:
    """Measure, in the order `_record` reads: every motor, the muscles, every rod twice."""
    kinds = mujoco.mjtSensor
    wanted = [
        (kinds.mjSENS_ACTUATORFRC, mujoco.mjtObj.mjOBJ_ACTUATOR, f"{joint}_motor")
        for joint in device.joints
    ]
    wanted.append((kinds.mjSENS_JOINTACTFRC, mujoco.mjtObj.mjOBJ_JOINT, HUMAN_JOINTS[target.joint]))
    for kind in (kinds.mjSENS_TENDONPOS, kinds.mjSENS_TENDONVEL):
        for cuff in holders:
            for rod in RODS:
                wanted.append((kind, mujoco.mjtObj.mjOBJ_TENDON, f"{cuff.name}_{rod}"))
    for number, (kind, objtype, name) in enumerate(wanted):
        spec.add_sensor(name=f"sensor_{number}", type=kind, objtype=objtype, objname=name)


def _release(system: System, *, locked: bool) -> None:
    """Switch the robot between its locks and its motors."""
    system.model.eq_active0[system.locks] = locked
    system.model.opt.disableactuator = 1 << MOTOR_GROUP if locked else 0


def _roll_out(
    system: System,
    data: mujoco.MjData,
    carried: CarriedEffects,
    control: np.ndarray,
    phase: str,
) -> tuple[np.ndarray, np.ndarray]:
    """Run `control`, shape (n, nu), from the state of `data`; leave the last state there.

    Returns:
        States before each step, after the last, shape (n + 1, nstate), and sensors, shape (n, ns).

    Raises:
        FailedError: a state is not finite.
    """
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    first = np.empty(mujoco.mj_stateSize(system.model, kind))
    mujoco.mj_getState(system.model, data, first, kind)
    if carried:
        states, sensed = _stepped(system, data, carried, control)
    else:
        states, sensed = (
            rows[0] for rows in rollout.rollout(system.model, data, first[None], control[None])
        )
    states = np.vstack([first, states])
    mujoco.mj_setState(system.model, data, states[-1], kind)
    if not np.isfinite(states).all() or data.warning.number.any():
        raise FailedError(
            Failure(name="diverged", reason=f"the state is not finite at {data.time:.2f} s"), phase
        )
    return states, sensed


def _stepped(
    system: System, data: mujoco.MjData, carried: CarriedEffects, control: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Run `control` as the engine's rollout does, with what effects add at each step."""
    model, kind = system.model, mujoco.mjtState.mjSTATE_FULLPHYSICS
    states = np.empty((len(control), mujoco.mj_stateSize(model, kind)))
    sensed = np.empty((len(control), model.nsensordata))
    # The engine's rollout takes which locks hold from the model.
    data.eq_active[:] = model.eq_active0
    for step, inputs in enumerate(control):
        data.ctrl[:] = inputs
        carried.before_step(data)
        mujoco.mj_step(model, data)
        mujoco.mj_getState(model, data, states[step], kind)
        sensed[step] = data.sensordata
    return states, sensed


def _move(
    system: System,
    data: mujoco.MjData,
    carried: CarriedEffects,
    control: np.ndarray,
    pattern: ActivationPattern,
) -> tuple[np.ndarray, np.ndarray]:
    """Roll out the movement, in pieces no longer than a reflex needs to act."""
    dof = 1 + system.model.nq + system.human_dof[system.target.joint]
    pieces, steps = [], len(control)
    for first in range(0, steps, pattern.horizon):
        piece = slice(first, min(first + pattern.horizon, steps))
        control[piece, system.contraction_inputs] = pattern.activations(first, piece.stop - first)
        pieces.append(_roll_out(system, data, carried, control[piece], "movement"))
        pattern.velocity[piece] = pieces[-1][0][:-1, dof]
    states = [piece[0][1:] for piece in pieces]
    return np.vstack([pieces[0][0][:1], *states]), np.vstack([piece[1] for piece in pieces])


def _record(
    system: System,
    time: np.ndarray,
    reference: np.ndarray,
    states: np.ndarray,
    sensed: np.ndarray,
) -> Record:
    """Return states and sensors of the movement as a record."""
    model = system.model
    position, velocity = states[:, 1 : 1 + model.nq], states[:, 1 + model.nq :][:, : model.nv]
    exo_velocity = velocity[:, system.exo_dof]
    acceleration = np.diff(exo_velocity, axis=0) / system.fidelity.step
    forces, motors = _cuff_forces(system, sensed), len(system.motors)
    return Record(
        device=system.device.name,
        joint=system.target.joint,
        exo_joint=system.moved,
        time=time,
        reference=reference,
        theta=position[:-1, system.exo_qpos],
        theta_velocity=exo_velocity[:-1],
        theta_acceleration=acceleration,
        motor_torque=acting_torque(system, sensed[:, :motors] / system.motor_gain, acceleration),
        q=position[:-1, system.human_qpos],
        q_velocity=velocity[:-1, system.human_dof],
        muscle_torque=sensed[:, motors],
        contact_force=np.linalg.norm(forces, axis=2),
        normal_force=np.linalg.norm(forces[:, :, 1:], axis=2).sum(axis=1),
    )


def _rods(system: System, sensed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return length and speed of every rod, m and m/s, shapes (n, 2 x number of rods)."""
    lengths, speeds = np.split(sensed[:, len(system.motors) + 1 :], 2, axis=1)
    return lengths, speeds


def _cuff_forces(system: System, sensed: np.ndarray) -> np.ndarray:
    """Return the force in each bushing along limb, opening and wall, N, shape (n, 2, 3)."""
    model = system.model
    length, speed = _rods(system, sensed)
    rods = [model.tendon(f"{cuff.name}_{rod}").id for cuff in system.cuffs for rod in RODS]
    stretch = length - ROD
    stiffness = model.tendon_stiffness[rods] + model.tendon_stiffnesspoly[rods, 1] * stretch**2
    tension = stiffness * stretch + model.tendon_damping[rods] * speed
    tension = tension.reshape(len(sensed), len(system.cuffs), len(RODS))
    opening, wall = tension[:, :, :2].sum(axis=2), tension[:, :, [2, 3, 5, 6]].sum(axis=2)
    return np.stack([tension[:, :, 4], opening, wall], axis=2)


def _check(system: System, record: Record, sensed: np.ndarray) -> None:
    """Judge every step of a movement with the detectors of the protocol with contact."""
    displacement = (_rods(system, sensed)[0] - ROD).reshape(-1, 2, len(RODS))
    across = np.hypot(displacement[:, :, :2].mean(axis=2), displacement[:, :, 2:4].mean(axis=2))
    room = np.array([cuff.radius - BONE_CLEARANCE for cuff in system.cuffs])
    theta, q = record.theta[:, record.exo_joint], record.q[:, record.joint]
    # The detectors look at extremes only, so the steps that hold them are all that need judging.
    difference = np.abs(q - theta)
    extremes = {int(np.argmax(values)) for values in (difference, record.normal_force)}
    extremes |= {int(i) for i in np.argmax(across - room, axis=0)}
    for angle in (theta, q):
        extremes |= {int(np.argmin(angle)), int(np.argmax(angle))}
    for i in sorted(extremes):
        failure = check_posture(
            Posture(
                exo_angle=float(theta[i]),
                human_angle=float(q[i]),
                exo_range=system.exo_range,
                human_range=system.human_range,
                penetration=across[i] - room,
                overhang=np.full(2, -np.inf),
                normal_force=float(record.normal_force[i]),
            )
        )
        if failure:
            raise FailedError(failure, "movement")
