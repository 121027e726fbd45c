"""Torque that one joint passes to another: tendons, belts, differentials, motors of two joints.

Coupling by two-joint muscles after Hogan 1985; of transmissions, whose joint torques are the
transpose of what their motors' speeds are times the motors' torques, and of rotors that sit on
another link, after Khalil and Dombre 2002 (Modeling, identification and control of robots) and
Siciliano et al. 2009 (Robotics: modelling, planning and control, section 7.1).
"""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from sim.effects.effect import Law, Theta, turns_freely
from sim.effects.elements import joint_of
from sim.effects.functions import Signal, tanh
from sim.effects.motion import Motion, RecordedJoint, Recording
from sim.effects.parameter import Nonlinear, Parameter, Reading, Values, named

if TYPE_CHECKING:
    import mujoco

#: Least way of a joint that moves, rad or m.
MOVING = 5e-3
#: What a coupling goes by: the other's position and velocity, its acceleration, its effort.
MOTION, ACCELERATION, EFFORT = 0.0, 1.0, 2.0
#: Joints between which a motor is looked for that turns with both: those of a wrist.
WRIST = 2
#: How fast the other joint goes at least while one moves, over that one, in root mean square.
TOGETHER = 0.1
#: Whether it turns by the sum or the difference of their ways, and over which width its direction
#: changes, over the top speed.
SENSES, WIDTHS = (1.0, -1.0), (0.004, 0.02)
#: Parameters of each, in the order of the columns.
FORMS: dict[float, tuple[str, ...]] = {
    MOTION: ("stiffness", "damping", "torque_at_zero"),
    ACCELERATION: ("inertia", "torque_at_zero"),
    EFFORT: ("effort_share", "torque_at_zero"),
}
#: Units at a joint (hinge or not) beside another: torque over way, speed, acceleration and torque.
UNITS: dict[str, dict[tuple[bool, bool], str]] = {
    name: dict(
        zip([(True, True), (True, False), (False, True), (False, False)], units, strict=True)
    )
    for name, units in {
        "stiffness": ("Nm/rad", "Nm/m", "N/rad", "N/m"),
        "damping": ("Nm s/rad", "Nm s/m", "N s/rad", "N s/m"),
        "inertia": ("kg m2", "kg m", "kg m", "kg"),
        "effort_share": ("1", "m", "1/m", "1"),
    }.items()
}


class CrossJointCoupling(Law):
    """Torque at one joint from what another does: its motion, its acceleration or its effort.

    As of a spring, nobody knows beforehand where it is without torque. A tendon or a belt may pass
    over joints between, so every other joint that moves is asked. A belt between two joints is
    stretched by the difference of their positions: of a coupling and a spring of the joint's own
    neither explains anything alone where both joints move alike. A rotor that another joint's
    motion turns needs torque for its acceleration. In a differential, or where a tendon runs over
    one joint to the next, a motor's torque acts on both: the effort is the recorded one, which is
    right whatever the other joint lacks, and whose noise is small beside it.
    """

    name = "cross_joint_coupling"
    complexity = 3
    signature = "the residual follows another joint's position, speed or effort"
    separating_trial = "move the neighbouring joint alone while this one is held"
    includes = ("torque_offset",)
    parameters = named(
        stiffness=Parameter("Nm/rad", "over the other's position"),
        damping=Parameter("Nm s/rad", "over the other's velocity"),
        inertia=Parameter("kg m2", "over the other's acceleration"),
        effort_share=Parameter("1", "over the other's effort"),
        torque_at_zero=Parameter("Nm", "what the motor adds where the other's is 0"),
        other_dof=Parameter("1", "number of the other joint", choice=True),
        between=Parameter(
            "1",
            "1: less the joint's own (belt); -1: plus it",
            choice=True,
        ),
    )
    coefficients = ("stiffness", "damping", "inertia", "effort_share", "torque_at_zero")
    nonlinear = (
        Nonlinear("other_dof"),
        Nonlinear("between", (0.0, 1.0)),
        Nonlinear("by", (MOTION, ACCELERATION, EFFORT)),
    )

    def torque(self, parameters: Values, motion: Motion) -> Signal:
        other = motion.other(int(parameters["other_dof"]))
        position, velocity = other.position, other.velocity
        if between := parameters.get("between", 0.0):
            position = position - between * motion.position
            velocity = velocity - between * motion.velocity

        def over(name: str, signal: Signal) -> Signal:
            # Those of the other forms are nothing.
            return parameters.get(name, 0.0) * signal

        elastic = over("stiffness", position) + over("damping", velocity)
        passed = over("inertia", other.acceleration) + over("effort_share", other.effort)
        return elastic + passed + parameters["torque_at_zero"]

    def readings(self, joint: RecordedJoint, theta: Theta) -> dict[str, Reading]:
        found = {name: Reading(column=i) for i, name in enumerate(FORMS[theta["by"]])}
        values = self.fixed(joint, theta)
        return found | {name: Reading(value=value) for name, value in values.items()}

    def unit_of(self, parameter: str, theta: Theta, joint: RecordedJoint) -> str:
        if parameter not in UNITS:
            return super().unit_of(parameter, theta, joint)
        is_hinge = joint.recording.is_hinge
        return UNITS[parameter][is_hinge(joint.number), is_hinge(int(theta["other_dof"]))]

    def applies(self, recording: Recording, joint: int) -> bool:
        return bool(_others(recording, joint))

    def thetas(self, joint: RecordedJoint) -> list[Theta]:
        recording, number = joint.recording, joint.number
        ways = _ways_beside(recording, number)
        grid: list[Theta] = []
        for other in _others(recording, number):
            plain = {"other_dof": float(other), "between": 0.0, "by": MOTION}
            # A limb has a stiffness of its own, which nothing tells from a belt's, and no drive.
            driven = number not in recording.limbs
            winds_up = not any(turns_freely(recording, one) for one in (number, other))
            if ways[other] > MOVING and winds_up:
                grid.append(plain)
                if driven and recording.is_hinge(number) == recording.is_hinge(other):
                    grid.append({**plain, "between": 1.0})
            if ways[other] > MOVING and driven:
                grid.append({**plain, "by": ACCELERATION})
            # A torque sensor may feel another's, whatever its joint moves.
            if _recorded(recording, other, beside=number):
                grid.append({**plain, "by": EFFORT})
        return grid

    def forms(self, theta: Theta, coefficients: Mapping[int, float]) -> list[Theta]:
        # What a belt, or a muscle of two joints, does by the joint's own motion is a limb's
        # stiffness as well; no spring has a negative one.
        stiffness = coefficients.get(0, 0.0)
        if theta["by"] != MOTION or theta["between"] or not stiffness:
            return []
        return [{**theta, "between": 1.0 if stiffness < 0.0 else -1.0}]


class CoupledMotor(Law):
    """Friction and rotor of a motor that turns with two joints, as in the wrists of many robots.

    The motor of a wrist's last joint sits behind the joints before it, and turns with them: what it
    rubs goes by the sum, or the difference, of two speeds, and each of the two joints feels it
    (Khalil and Dombre 2002, on coupled joints; the Staubli TX40 of Janot, Vandanjon and Gautier
    2014, A generic instrumental variable approach for industrial robot identification). In a
    simulation its rotor is inertia of the joint, and a torque by the other's acceleration.
    """

    name = "coupled_motor"
    complexity = 4
    signature = "the residual steps where the speeds of two joints, added or subtracted, vanish"
    separating_trial = "move the other joint alone, both ways at two speeds"
    parameters = named(
        torque=Parameter("Nm", "its Coulomb friction", floor=0.0),
        damping=Parameter("Nm s/rad", "its viscous friction", floor=0.0),
        inertia=Parameter("kg m2", "of its rotor", floor=0.0),
        other_dof=Parameter("1", "number of the other joint", choice=True),
        sense=Parameter("1", "1: sum of both speeds, -1: difference", choice=True),
    )
    coefficients = ("torque", "damping", "inertia")
    lower = (0.0,)
    nonlinear = (
        Nonlinear("other_dof"),
        Nonlinear("sense", SENSES),
        Nonlinear("smooth", WIDTHS, scaling=0.4),
    )
    directed = True

    def torque(self, parameters: Values, motion: Motion) -> Signal:
        own = parameters["inertia"] * motion.acceleration
        return own + self._beside_own_inertia(parameters, motion)

    def _beside_own_inertia(self, parameters: Values, motion: Motion) -> Signal:
        other, sense = motion.other(int(parameters["other_dof"])), parameters["sense"]
        velocity = motion.velocity + sense * other.velocity
        rubbing = parameters["torque"] * tanh(velocity / motion.turning_speed)
        rubbing += parameters["damping"] * velocity
        return rubbing + sense * parameters["inertia"] * other.acceleration

    def simulated(self, parameters: Values, step: float) -> Callable[[Motion], float]:
        return lambda motion: float(self._beside_own_inertia(parameters, motion))

    def add(self, spec: "mujoco.MjSpec", joint: str, parameters: Values) -> str | None:
        joint_of(spec, joint).armature += parameters["inertia"]
        return super().add(spec, joint, parameters)

    def applies(self, recording: Recording, joint: int) -> bool:
        return joint not in recording.limbs and bool(_beside_in_wrist(recording, joint))

    def thetas(self, joint: RecordedJoint) -> list[Theta]:
        return [
            {"other_dof": float(other), "sense": sense, "smooth": smooth}
            for other in _beside_in_wrist(joint.recording, joint.number)
            for sense in SENSES
            for smooth in WIDTHS
        ]

    def fixed(self, joint: RecordedJoint, theta: Theta) -> Values:
        return {name: theta[name] for name in ("other_dof", "sense")}


def _beside_in_wrist(recording: Recording, joint: int) -> list[int]:
    """Return the joints near in the chain that move while this one does, in the same way.

    In trials that are fitted, and not by a little: a motor of two joints of which one is held rubs
    as one of the joint's own.
    """
    moves = _fitted(recording) & (
        np.abs(recording.velocity[:, joint]) > recording.rest_speed[joint]
    )
    power = (recording.velocity[moves] ** 2).sum(axis=0)
    return [
        other
        for other in _others(recording, joint)
        if abs(other - joint) <= WRIST
        and power[other] > TOGETHER**2 * power[joint]
        and recording.is_hinge(other) == recording.is_hinge(joint)
    ]


def _others(recording: Recording, joint: int) -> list[int]:
    """Return the other joints that are recorded moving, the nearest in the chain first."""
    moving = np.flatnonzero(np.ptp(recording.position, axis=0) > MOVING)
    return sorted((int(j) for j in moving if j != joint), key=lambda j: abs(j - joint))


def _fitted(recording: Recording) -> np.ndarray:
    """Return which samples are of trials that are fitted, (n,)."""
    return np.isin(recording.trial, recording.fit_trials)


def _ways_beside(recording: Recording, joint: int) -> np.ndarray:
    """Return how far every joint goes in one piece while `joint` moves, rad or m, (joints,).

    A joint that a controller holds gives way a little with every torque that others need: over so
    short a way anything follows anything. Where one joint moves at a time in what is fitted, a belt
    between two is a spring of one.
    """
    moves = _fitted(recording) & (
        np.abs(recording.velocity[:, joint]) > recording.rest_speed[joint]
    )
    ways = np.zeros(recording.position.shape[1])
    for piece in recording.slices:
        if moves[piece].any():
            ways = np.maximum(ways, np.ptp(recording.position[piece][moves[piece]], axis=0))
    return ways


def _recorded(recording: Recording, other: int, *, beside: int) -> bool:
    """Whether another joint's effort is recorded wherever one's own is."""
    missing = np.isnan(recording.effort)
    return not bool((missing[:, other] & ~missing[:, beside]).any())
