"""The fidelity without contact: each cuff holds its limb by a six-dimensional viscoelastic bushing.

After Kühn et al. 2018. A bushing is seven rods of springs, so long that their directions stay
those of the cuff: four radial ones at two places along the limb, which also resist tilting, one
axial, and two that resist torsion. The assessment starts from rest, which Newton's method finds;
what hardly acts is left out (pronation, the muscles of a shoulder that is not assessed: at most
0.004 Nm/rad on 32 Sobol points). Nothing slips, rolls or loses contact, so the response is smooth
and an assessment takes milliseconds; `docs/measurements/fidelities.md` says how far it agrees with
contact.
"""

from dataclasses import replace

import mujoco
import numpy as np

from sim.assessment.protocol import HOLD
from sim.assessment.record import Record, record_of
from sim.assessment.steps import Motion, follow, movement
from sim.assessment.system import System, base_spec
from sim.assessment.target import ELBOW_TARGET, Target
from sim.assessment.validity import FailedError, Failure, Postures
from sim.body.skeleton import ELBOW, upper_arm_point
from sim.body.soft_tissue import BONE_CLEARANCE, HARDENING, Sleeve, sleeves
from sim.effects.carried import CarriedEffects
from sim.interface.cuffs import Cuff, cuffs
from sim.models import CONTACT_ONLY
from sim.parameters.conditions import DEFAULT_CONDITIONS, Conditions
from sim.parameters.fidelity import CAMPAIGN
from sim.parameters.wearer import Wearer
from sim.robot.control import Gains
from sim.robot.device import NESM, Device
from sim.robot.seat import direction, elbow_angle, forearm_cuff_centre, seated_elbow_angle

#: Length of a rod, m: over 5 cm of displacement its direction turns by one degree.
ROD = 3.0
#: Stiffness of cuff and strap in series with the tissue, N/m (compression of contacts and strap).
CUFF_STIFFNESS = 1e5
#: Damping of the rods as a share of the tissue's. The integrator takes damping between two trees
#: for inertia on each, step x damping: all of it is 0.6 kg m2 at the elbow, five times the forearm,
#: and 0.3 Nm/rad of stiffness. With half of it errors are closest to those of contact.
DAMPING_SHARE = 0.5
#: Axial stiffness, N/m: friction holds a limb, whatever the tissue. But only so far: what it holds
#: with is largest, 85 N, where a limb has slid by LETS_GO / sqrt(3), 3 cm (m).
AXIAL_STIFFNESS, LETS_GO = 4000.0, 0.055
#: Stiffness of both rods that resist torsion, N/m: friction's too, which holds a limb whatever the
#: tissue (as a share of the radial one the softest tissue let go of it).
TORSIONAL_STIFFNESS = 4000.0
#: What a rod's stiffness gains per square of its stretch, as a share of itself, 1/m2: pressed
#: tissue hardens, friction along the limb gives way.
CURVATURES = {"radial": 1.0 / HARDENING**2, "axial": -1.0 / LETS_GO**2, "torsion": 0.0}
#: The limbs' divisions (which only validity looks at) and the step.
FIDELITY = replace(CAMPAIGN, name="bushing", step=0.01)
#: The start: net torque of an arm at rest, Nm; most iterations and longest step of Newton's method,
#: rad, and its step for derivatives, rad.
AT_REST, ITERATIONS, REACH, PROBE = 1e-9, 50, 0.2, 1e-6
FORWARD = (
    mujoco.mj_fwdPosition,
    mujoco.mj_fwdVelocity,
    mujoco.mj_fwdActuation,
    mujoco.mj_fwdAcceleration,
    mujoco.mj_fwdConstraint,
)
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
    spec = base_spec(wearer, gains, conditions, target, device, step=FIDELITY.step, whole=False)
    # Nothing meets, and nine dense columns are cheaper than their pattern.
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    closed_at = elbow_angle(device, device.start(target.name)) + conditions.seat_angle
    seats = _seats(wearer, parts, holders, closed_at)
    for cuff, sleeve, seat in zip(holders, parts, seats, strict=True):
        _add_bushing(spec, cuff, sleeve, *seat)
    _add_rod_sensors(spec, holders)
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
    """Let the arm rest in the robot, then extend it; return what was recorded.

    `data` holds the last state afterwards. Another `motion` than
    the assessment's sigmoid may be given.

    Raises:
        FailedError: a detector fired.
    """
    model, carried = system.model, system.carried()
    data.act[model.actuator_actadr[system.contracted]] = system.activation
    data.time = HOLD
    lock_torque = _settle(system, data, carried)
    model.opt.disableactuator = 0
    for motor, torque in zip(system.motors, lock_torque / system.motor_gain, strict=True):
        if model.actuator_actadr[motor] >= 0:
            data.act[model.actuator_actadr[motor]] = torque / system.gains.ki
    motion = movement(system) if motion is None else motion
    pieces: list[np.ndarray] = []

    def look(states: np.ndarray, sensed: np.ndarray) -> Postures:
        pieces.append(_cuff_forces(system, sensed))
        return _postures(system, states, sensed, pieces[-1])

    states, sensed = follow(system, data, carried, motion, look)
    forces = pieces[0] if len(pieces) == 1 else np.concatenate(pieces)
    return record_of(
        system,
        *motion[:2],
        states,
        sensed,
        np.linalg.norm(forces, axis=2),
        _normal_force(forces),
    )


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
    # Half of the elements under the cuff, because each shares in a load across the limb by the
    # square of the cosine to its direction.
    engaged = len(sleeve.places) * cuff.length / (sleeve.end - sleeve.start) / 2
    tissue = engaged * sleeve.elasticity
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
        ("torsion_1", (0.0, cuff.radius, 0.0), 2, TORSIONAL_STIFFNESS),
        ("torsion_2", (0.0, -cuff.radius, 0.0), 2, TORSIONAL_STIFFNESS),
    ):
        place = np.array(at)
        curvature = CURVATURES[name.split("_")[0]]
        name = f"{cuff.name}_{name}"
        bone.add_site(name=f"{name}_limb", pos=centre + axes @ place)
        link.add_site(
            name=f"{name}_cuff",
            pos=np.array(cuff.centre) + in_link @ place + ROD * in_link[:, towards],
        )
        rod = spec.add_tendon(
            name=name,
            stiffness=[stiffness, 0.0, curvature * stiffness],
            damping=[relaxation * stiffness, 0.0, 0.0],
            springlength=[ROD, ROD],
            # So long that they would fill every picture.
            rgba=[0.0, 0.0, 0.0, 0.0],
        )
        rod.wrap_site(f"{name}_limb")
        rod.wrap_site(f"{name}_cuff")


def _add_rod_sensors(spec: mujoco.MjSpec, holders: tuple[Cuff, Cuff]) -> None:
    """Measure, after the torques, the length and then the speed of every rod."""
    for kind in (mujoco.mjtSensor.mjSENS_TENDONPOS, mujoco.mjtSensor.mjSENS_TENDONVEL):
        for cuff in holders:
            for rod in RODS:
                # Without a name: to keep one costs more than to measure.
                spec.add_sensor(
                    type=kind, objtype=mujoco.mjtObj.mjOBJ_TENDON, objname=f"{cuff.name}_{rod}"
                )


def _settle(system: System, data: mujoco.MjData, carried: CarriedEffects) -> np.ndarray:
    """Let the arm hang at rest in the robot, which stands at the start.

    There is no history in springs, so that Newton's method on the human angles replaces the hold.

    Returns:
        The torque that holds each joint of the robot, Nm, shape (number of joints,).

    Raises:
        FailedError: there is no rest within reach of the seat.
    """
    angles, dofs = system.human_qpos, system.human_dof
    data.qpos[system.exo_qpos] = system.start

    def net_torque() -> np.ndarray:
        if carried:
            carried.before_step(data)
        # Piece by piece, because `mj_forward` would show a film what never happens.
        for stage in FORWARD:
            stage(system.model, data)
        torque: np.ndarray = data.qfrc_smooth[dofs] + data.qfrc_constraint[dofs]
        return torque

    torque = net_torque()
    for _ in range(ITERATIONS):
        if not np.isfinite(torque).all() or np.abs(torque).max() < AT_REST:
            break
        slope, here = np.empty((len(dofs), len(dofs))), data.qpos[angles]
        for i, angle in enumerate(angles):
            data.qpos[angles] = here
            data.qpos[angle] += PROBE
            slope[:, i] = (net_torque() - torque) / PROBE
        change = -np.linalg.solve(slope, torque)
        data.qpos[angles] = here + change * min(1.0, REACH / np.abs(change).max())
        torque = net_torque()
    if not np.abs(torque).max() < AT_REST:
        left = np.abs(torque).max()
        reason = f"the arm does not come to rest in the springs: {left:.2g} Nm are left"
        raise FailedError(Failure(name="start_not_reached", reason=reason), "hold")
    held: np.ndarray = -data.qfrc_smooth[system.exo_dof]
    return held


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


def _postures(
    system: System, states: np.ndarray, sensed: np.ndarray, forces: np.ndarray
) -> Postures:
    """Return what the detectors look at: states before each step, sensors, forces in the cuffs."""
    displacement = (_rods(system, sensed)[0] - ROD).reshape(-1, 2, len(RODS))
    across = np.hypot(displacement[:, :, :2].mean(axis=2), displacement[:, :, 2:4].mean(axis=2))
    room = np.array([cuff.radius - BONE_CLEARANCE for cuff in system.cuffs])
    return Postures(
        exo_angle=states[:, 1 + system.exo_qpos[system.moved]],
        human_angle=states[:, 1 + system.human_qpos[system.target.joint]],
        exo_range=system.exo_range,
        human_range=system.human_range,
        penetration=across - room,
        overhang=np.full_like(across, -np.inf),
        normal_force=_normal_force(forces),
    )


def _normal_force(forces: np.ndarray) -> np.ndarray:
    """Return the sum of what both cuffs press across their limbs, N, shape (n,)."""
    total: np.ndarray = np.linalg.norm(forces[:, :, 1:], axis=2).sum(axis=1)
    return total
