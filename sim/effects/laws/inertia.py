"""Mass that nobody declared: a payload on a link, or inertia that feels no gravity.

The torque of a rigid chain is linear in the inertial parameters of its links (Atkeson, An and
Hollerbach 1986), so one more kilogram is one more column by MuJoCo's own inverse dynamics.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from sim.effects.effect import Columns, Effect, Law, Limits, Theta
from sim.effects.elements import across, add_point_mass, joint_of, line_and_across
from sim.effects.functions import Signal
from sim.effects.motion import Motion, RecordedJoint, Recording
from sim.effects.parameter import RELATIVE, Nonlinear, Parameter, Reading, Values, named
from sim.effects.rigid import BALL, point_mass, point_mass_slopes

if TYPE_CHECKING:
    import mujoco

#: Parameters of a place in a link's frame.
PLACE = ("position_x", "position_y", "position_z")
#: How far a load is beside the line to its link's centre of mass.
ASIDE = "aside"
#: Number of the column of its own inertia.
OWN_INERTIA = 4
#: Mass below which a place means nothing, kg, and the longest way to go at once, m.
LEAST_LOAD, LONGEST_WAY = 1e-3, 0.3
#: No robot carries so many times what all its links weigh.
MOST_LOAD = 10.0
#: The furthest distance that is looked for, over that of the link's centre of mass.
FAR = 4.0
#: How far beside the line is looked, either way, over that distance; and how near to there a search
#: has found no place.
BESIDE, AT_BOUND = 1.0, 0.01
#: How far beside its link's line a load may be where no trial tells, m: a hand's breadth.
OFF_LINE = 0.1
#: No more than this share of the declared inertia can turn out not to be there.
MAX_REMOVED = 0.7
#: What turns gravity round at a limb that is half as heavy again as declared, m/s2: no wrong
#: direction, balance or compensation does more.
TURNED_ROUND = 2.5 * 9.81
#: A joint's torque by gravity, over that about a level axis, where the axis stands upright to
#: within 10 degrees.
UPRIGHT = float(np.sin(np.radians(10.0)))


class Payload(Effect):
    """A point mass on the link that a joint moves, on the line to its centre of mass or beside it.

    At the link's centre of percussion it scales gravity and inertia alike, as a torque gain does.
    It is beside the line only where that leaves less, or where trials tell how far.
    """

    name = "payload"
    complexity = 2
    signature = (
        "the residual follows gravity over posture and acceleration over speed, in one ratio"
    )
    element = "body/@mass"
    separating_trial = "hold still in five postures, and repeat one movement with a known mass"
    twins = ("torque_gain",)
    owner = "robot"
    leaves_out = (
        f"a load {OFF_LINE:g} m beside the line from the joint to its link's centre of mass"
    )
    parameters = named(
        mass=Parameter("kg", "mass on the link", 0.0, 1.0, switches=True, floor=-0.45),
        distance=Parameter(
            "m",
            "from the joint, towards the link's centre of mass",
            0.05,
            0.3,
            neutral=0.1,
            floor=0.0,
            ceiling=2.0,
        ),
        aside=Parameter(
            "m",
            "beside that line, the way the joint turns",
            -0.05,
            0.05,
            floor=-2.0,
            ceiling=2.0,
            in_joint_frame=True,
        ),
    )
    coefficients: tuple[str, ...] = ("mass",)
    nonlinear: tuple[Nonlinear, ...] = (
        Nonlinear("distance", (0.4, 0.7, 1.0, 1.4, 2.0, 3.0), scaling=0.25, step=RELATIVE),
        Nonlinear(ASIDE, shift=0.2, step=RELATIVE),
    )
    adds_mass = filters = True

    def applies(self, recording: Recording, joint: int) -> bool:
        return recording.centre_of_mass(joint) is not None

    def limits(self, joint: RecordedJoint) -> Limits:
        # No load hangs further away than the robot reaches. A limb's own mass is a guess from
        # height and weight, and may be less.
        recording, number = joint.recording, joint.number
        limb = number in recording.limbs
        least = -MAX_REMOVED * recording.link_mass(number) if limb else 0.0
        reach = recording.reach(number)
        return {"mass": (least, np.inf), "distance": (0.0, reach), ASIDE: (-reach, reach)}

    def thetas(self, joint: RecordedJoint) -> list[Theta]:
        # Where gravity does not pull, all distances fit alike: the first to be taken has to be one.
        every = ({"distance": share} for share in self.nonlinear[0].grid)
        return [theta for theta in every if not self.beyond(joint, theta, {})]

    def searches(self, theta: Theta) -> list[tuple[Theta, Limits]]:
        on_line = {"distance": (0.0, FAR)}
        beside = {**on_line, ASIDE: (-BESIDE, BESIDE)}
        return [(theta, on_line), ({ASIDE: 0.0, **theta}, beside)]

    def beyond(
        self,
        joint: RecordedJoint,
        theta: Theta,
        coefficients: Mapping[int, float],
        *,
        difference: bool = False,
    ) -> str:
        # How friction turns led there: K was a fifth too low in four limbs of ten of our own.
        if abs(theta.get(ASIDE, 0.0)) > BESIDE - AT_BOUND:
            return ASIDE
        return super().beyond(joint, theta, coefficients, difference=difference)

    def columns(self, joint: RecordedJoint, theta: Theta) -> Columns:
        torque = joint.recording.mass_torque(joint.number, self._place(joint, theta))
        return {number: torque[:, [number]] for number in joint.recording.joints}

    def unsaid(self, joint: RecordedJoint, theta: Theta, coefficients: np.ndarray) -> Columns:
        """Return the torque of a mass that is `OFF_LINE` beside the line to the link's centre."""
        if ASIDE in theta:
            return {}
        recording = joint.recording
        slopes = recording.link_torque(recording.body(joint.number))
        further = slopes @ point_mass_slopes(self._place(joint, theta)) @ self._across(joint)
        size = OFF_LINE * abs(float(coefficients[0]))
        return {number: size * further[:, [number]] for number in recording.joints}

    def fixed(self, joint: RecordedJoint, theta: Theta) -> Values:
        lever = float(np.linalg.norm(self._centre(joint)))
        return {name: lever * theta[name] for name in ("distance", ASIDE) if name in theta}

    def _place(self, joint: RecordedJoint, theta: Theta) -> np.ndarray:
        """Return where the mass is in the frame of its link, m, (3,)."""
        centre = self._centre(joint)
        beside = theta.get(ASIDE, 0.0) * np.linalg.norm(centre)
        return np.asarray(theta["distance"] * centre + beside * self._across(joint))

    def _across(self, joint: RecordedJoint) -> np.ndarray:
        return across(joint.recording.axis(joint.number), self._centre(joint))

    def _centre(self, joint: RecordedJoint) -> np.ndarray:
        centre = joint.recording.centre_of_mass(joint.number)
        assert centre is not None
        return centre

    def add(self, spec: "mujoco.MjSpec", joint: str, parameters: Values) -> str:
        if "distance" in parameters:
            line, beside = line_and_across(spec, joint)
            place = parameters["distance"] * line + parameters.get(ASIDE, 0.0) * beside
        elif parameters.keys() & {*PLACE}:
            # A way that no joint feels may be any.
            place = np.array([parameters.get(name, 0.0) for name in PLACE])
        else:
            raise ValueError("nothing says where it hangs")
        add_point_mass(spec, joint, parameters["mass"], place, parameters.get("inertia", 0.0))
        return self.element


class PlacedPayload(Payload):
    """The same where several joints show it: its place in the link's frame, three numbers.

    Torque is linear in the mass, about a place in the mass times a small way from it, and in the
    load's inertia about its own centre of mass, the same about every axis: a ball's, since a link
    that turns about few axes tells no more.
    """

    complexity = 5
    parameters = named(
        mass=Parameter("kg", "mass on the link", floor=0.0),
        **{
            name: Parameter("m", "where its centre of mass is, in the link's frame")
            for name in PLACE
        },
        inertia=Parameter("kg m2", "its inertia about its own centre of mass", floor=0.0),
    )
    coefficients = ()
    lower = (0.0, -np.inf, -np.inf, -np.inf, 0.0)
    nonlinear = ()

    def limits(self, joint: RecordedJoint) -> Limits:
        reach = joint.recording.reach(joint.number)
        most = MOST_LOAD * joint.recording.mass
        place = dict.fromkeys(PLACE, (-reach, reach))
        return {"mass": (0.0, most), **place, "inertia": (0.0, most * reach**2)}

    def searches(self, theta: Theta) -> list[tuple[Theta, Limits]]:
        return []

    def columns(self, joint: RecordedJoint, theta: Theta) -> Columns:
        recording = joint.recording
        body = recording.body(joint.number)
        return load_columns(recording, body, np.array([theta[name] for name in PLACE]))

    def unsaid(self, joint: RecordedJoint, theta: Theta, coefficients: np.ndarray) -> Columns:
        return {}

    def way(self, coefficients: Mapping[int, float]) -> np.ndarray:
        """Return how far from its place the fit moves the load, m, (3,), one step at most."""
        mass = coefficients.get(0, 0.0)
        if mass < LEAST_LOAD:
            return np.zeros(3)
        way = np.array([coefficients.get(number, 0.0) for number in (1, 2, 3)]) / mass
        return np.asarray(way * min(1.0, LONGEST_WAY / max(float(np.linalg.norm(way)), 1e-300)))

    def readings(self, joint: RecordedJoint, theta: Theta) -> dict[str, Reading]:
        return (
            {"mass": Reading(column=0)}
            | {
                name: Reading(column=number, over=0, value=theta[name])
                for number, name in enumerate(PLACE, start=1)
            }
            | {"inertia": Reading(column=OWN_INERTIA)}
        )


def tells_inertia(variance: float, mass: float) -> bool:
    """Whether a load's own inertia is told to better than that of one a hand's breadth wide.

    Args:
        variance: of its estimate from the samples of one second, kg2 m4; 0 if nothing tells it.
        mass: the load's, kg.
    """
    return 0.0 < variance < (OFF_LINE**2 * max(mass, LEAST_LOAD)) ** 2


def load_columns(recording: Recording, body: int, place: np.ndarray) -> Columns:
    """Return what one kilogram at `place` of a body takes, one of it a metre further, and 1 kg m2.

    Returns:
        Of every analysed joint the columns of mass, of mass times way along x, y and z, and of
        inertia about the own centre, (n, 5).
    """
    turn = load_parameters(place)
    torque = recording.link_torque(body)
    return {joint: torque[:, joint] @ turn for joint in recording.joints}


def load_parameters(place: np.ndarray) -> np.ndarray:
    """Return the inertial parameters of a load at `place`, (10, 5).

    Of one kilogram in the first column, of one kg m along x, y and z, and of one kg m2 in the last.
    """
    return np.column_stack([point_mass(place), point_mass_slopes(place), BALL])


class LinkInertia(Effect):
    """Mass, centre of mass and inertia of every link together are others than declared."""

    name = "link_inertia"
    complexity = 10
    signature = "gravity and inertia of the whole chain are others than those of its model"
    element = "body/inertial"
    separating_trial = "weigh the links, or record a trajectory that excites all joints"
    adds_mass = True

    def applies(self, recording: Recording, joint: int) -> bool:
        return False


class AddedInertia(Law):
    """Inertia about the joint's own axis that feels no gravity: motor, gear, balanced limb."""

    name = "added_inertia"
    complexity = 1
    signature = "the residual is a straight line against acceleration"
    element = "joint/@armature"
    separating_trial = "shake the joint in two postures that differ in gravity"
    owner = "robot"
    parameters = named(
        inertia=Parameter("kg m2", "further inertia", 0.0, 0.1, switches=True, floor=-0.14)
    )
    coefficients = ("inertia",)
    adds_mass = filters = True

    def torque(self, parameters: Values, motion: Motion) -> Signal:
        return parameters["inertia"] * motion.acceleration

    def limits(self, joint: RecordedJoint) -> Limits:
        # A limb's own inertia is a guess from height and weight, and may be less; a motor's is not.
        if joint.number not in joint.recording.limbs:
            return {"inertia": (0.0, np.inf)}
        own = joint.recording.inertia(joint.number)[:, joint.number]
        return {"inertia": (-MAX_REMOVED * float(own.min()), np.inf)}

    def add(self, spec: "mujoco.MjSpec", joint: str, parameters: Values) -> str:
        target = joint_of(spec, joint)
        if target.armature + parameters["inertia"] < 0:
            raise ValueError("the joint's inertia would be negative")
        target.armature += parameters["inertia"]
        return self.element


class GravityTorque(Law):
    """Gravity acts on what a limb's joint moves in another way than declared.

    The effort was logged after gravity compensation, or gravity has another direction; a balancer
    or a counterweight pulls, or the limb has another mass. Inertia stays as declared.
    """

    limb = True
    name = "gravity_torque"
    complexity = 2
    signature = "the residual is a sine of the posture, both ways and at every speed"
    separating_trial = "repeat one movement with the axis upright, where gravity has no torque"
    parameters = named(
        **{
            f"gravity_{way}": Parameter(
                "m/s2",
                f"more along {way}",
                floor=-TURNED_ROUND,
                ceiling=TURNED_ROUND,
            )
            for way in "xyz"
        }
    )
    contradicts = True
    # A weight is large: a thousandth of it is more than a good sensor's noise.
    least_own = 1e-6
    # Beside stiffness and neutral angle trials tell no more than one direction of gravity, or its
    # opposite.
    nonlinear: tuple[Nonlinear, ...] = (
        Nonlinear("turned", tuple(np.arange(6) * np.pi / 6), shift=0.25, step=RELATIVE),
    )

    def readings(self, joint: RecordedJoint, theta: Theta) -> dict[str, Reading]:
        along = _turned(joint.weight, theta["turned"])
        return {
            name: Reading(column=0, scale=share)
            for name, share in zip(self.parameters, along, strict=True)
        }

    def unlikely(self, joint: RecordedJoint, theta: Theta) -> bool:
        # Who sets up an axis upright sees that it stands; a model without gravity says nothing.
        gravity = joint.recording.gravity
        level = np.linalg.norm(gravity) * np.linalg.norm(joint.weight)
        return bool(np.linalg.norm(joint.weight @ gravity) < UPRIGHT * level)

    def torque(self, parameters: Values, motion: Motion) -> Signal:
        held: Signal = motion.weight @ np.array([parameters[name] for name in self.parameters])
        return held


class TurnedGravity(GravityTorque):
    """The same at all joints of an arm at once: its base stands askew.

    All three numbers are told where several joints are weighed; a limb's stiffness hides none.
    """

    limb = False
    complexity = 3
    signature = "every joint's residual is that of gravity along one other direction"
    separating_trial = "put a level on the base"
    element = "option/@gravity"
    nonlinear = ()

    def readings(self, joint: RecordedJoint, theta: Theta) -> dict[str, Reading]:
        return {name: Reading(column=number) for number, name in enumerate(self.parameters)}

    def columns(self, joint: RecordedJoint, theta: Theta) -> Columns:
        recording = joint.recording
        return {number: recording.weight(number) for number in recording.joints}

    def add(self, spec: "mujoco.MjSpec", joint: str, parameters: Values) -> str:
        # A way that no joint feels may be any, as of joints with parallel axes.
        further = [parameters.get(name) or 0.0 for name in self.parameters]
        spec.option.gravity = spec.option.gravity + further
        return self.element


def _turned(weight: np.ndarray, angle: float) -> np.ndarray:
    """Return a direction of gravity that a joint feels, turned by an angle, a unit vector, (3,).

    Args:
        weight: what holds the joint in gravity along x, y and z, (n, 3).
        angle: rad, in the plane of the two directions that the joint feels most.
    """
    plane = np.linalg.svd(weight.T @ weight)[0][:, :2]
    # A singular vector is one of either sign.
    plane = plane * np.sign(plane[np.abs(plane).argmax(axis=0), [0, 1]])
    return np.asarray(plane @ [np.cos(angle), np.sin(angle)])
