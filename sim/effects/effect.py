"""What every effect answers: its regressors, its torque in simulation, its element, its words.

The balance of a joint is effort = inverse dynamics + declared unknowns + effect, so a torque here
is what the motor has to add: along the motion if the effect resists. The joint feels its opposite.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING, Literal

import numpy as np

from sim.effects.functions import Signal
from sim.effects.motion import Motion, RecordedJoint, Recording
from sim.effects.parameter import Nonlinear, Parameter, Reading, Values, unit_at

if TYPE_CHECKING:
    import mujoco

#: Non-linear parameters of one variant of an effect.
Theta = Mapping[str, float]
#: Closed interval of every parameter, SI units.
Limits = Mapping[str, tuple[float, float]]
#: Turns of a joint without a declared range, and of one with any, beyond which nothing winds up.
TURNS, MOST_TURNS = 2.0, 10.0
#: What a bound that a fit ends at may be missed by.
ROUNDING = 1e-9
#: For each joint (column number) that an effect acts on, its columns, shape (n, coefficients).
Columns = Mapping[int, np.ndarray]


class Effect(ABC):
    """One effect; a subclass gives the torque and says what a person would look for."""

    name: str
    #: Number of parameters: the simpler of two equals wins.
    complexity: int
    signature: str
    #: The MuJoCo element that carries it.
    element: str
    #: The trial that tells it from what it is confused with.
    separating_trial: str
    #: Physical parameters by name.
    parameters: Mapping[str, Parameter]

    # Where it can be.
    #: Whether only a living limb has it: then the joint is one of the session's `limb_joints`.
    limb: bool = False
    #: Whether it goes with the position, but with no period: what turns for ever has no such thing.
    bounded: bool = False

    # In a simulated assessment.
    #: Whose joint has it; None if no assessment can have it.
    owner: Literal["robot", "human"] | None = None

    # In a fit.
    #: Parameters that are coefficients, in the order of the columns.
    coefficients: tuple[str, ...] = ()
    #: Lower bound of every coefficient (the last repeats); -inf if either sign is physical.
    lower: tuple[float, ...] = (-np.inf,)
    #: Whether there is none of it where its first coefficient, a size, is none.
    needs_first: bool = False
    #: Columns that are left out where a fit with them is beyond what is physical.
    undetermined: tuple[int, ...] = ()
    #: Whether a coefficient has to agree with the non-linear parameters that it is fitted for.
    has_to_agree: bool = False
    #: Whether its law says too when its torque comes, with nothing that is fitted to single times.
    timed: bool = False
    #: Parameters that the columns are not linear in (`Theta`).
    nonlinear: tuple[Nonlinear, ...] = ()
    #: Whether the columns depend on the estimate so far.
    uses_estimate: bool = False
    #: Whether the effect acts on the whole effort channel (`through`) instead of adding torque.
    channel: bool = False

    # Beside other effects.
    #: Effects whose torque is a special case of this one.
    includes: tuple[str, ...] = ()
    #: Simpler effects: one of them has to be there before this one, which replaces them, is tried.
    grows_from: tuple[str, ...] = ()
    #: Effects that this one imitates nearly whole: only a paired test tells the two apart.
    twins: tuple[str, ...] = ()
    #: Effects that are not asked for beside this one: it is the one or the other.
    not_beside: tuple[str, ...] = ()
    #: Whether the motion does not determine its torque at rest, as that of friction.
    rubs: bool = False
    #: Whether it is a limb's own and goes with the place alone: behind a spring, that of the limb.
    elastic: bool = False
    #: Whether its torque goes with the direction of the motion, as no soft tissue's does.
    directed: bool = False
    #: Share of a column's power that other columns have to leave: of less, nothing can be named.
    least_own: float = 5e-4
    #: Whether it contradicts what the model's file declares, which holds until trials speak against
    #: it: it is credited with nothing while it is not seen.
    contradicts: bool = False
    #: Whether it is another in each direction, of which a joint has to move in both to show it.
    sided: bool = False
    #: Whether it acts at reversals, where friction turns.
    at_reversals: bool = False
    #: Whether it winds up over a way after each reversal, as friction itself does over a short one.
    winds: bool = False
    #: Whether it remembers for a while what the joint did.
    remembers: bool = False
    #: What its form leaves out (`unsaid`), in words; empty if nothing that matters.
    leaves_out: str = ""
    #: Whether it is further mass or inertia of what the joint moves.
    adds_mass: bool = False
    #: Whether it multiplies the whole effort, and with it every coefficient.
    scales_effort: bool = False
    #: Whether it passes the motion on like a linear filter: with no frequency that motion lacks.
    filters: bool = False

    def applies(self, recording: Recording, joint: int) -> bool:
        """Whether the effect can be asked of this joint of this device."""
        if self.bounded and turns_freely(recording, joint):
            return False
        return not self.limb or joint in recording.limbs

    def thetas(self, joint: RecordedJoint) -> list[Theta]:
        """Return the grid of non-linear parameters; one empty entry if there is none."""
        names = [parameter.name for parameter in self.nonlinear]
        grids = [parameter.grid for parameter in self.nonlinear]
        return [dict(zip(names, values, strict=True)) for values in product(*grids)]

    def neighbours(self, theta: Theta, scale: float) -> list[Theta]:
        """Return parameters around `theta` to refine it; `scale` shrinks towards zero."""
        return [
            {**theta, parameter.name: value}
            for parameter in self.nonlinear
            if parameter.name in theta
            for value in parameter.near(theta[parameter.name], scale)
        ]

    def searches(self, theta: Theta) -> list[tuple[Theta, Limits]]:
        """Return where searches of several parameters at once begin, the simplest first.

        Each with what may change, and between which values.
        """
        return []

    def forms(self, theta: Theta, coefficients: Mapping[int, float]) -> list[Theta]:
        """Return what else an effect may be that does the same, but for its joint's impedance."""
        return []

    def columns(self, joint: RecordedJoint, theta: Theta) -> Columns:
        """Return what the motor has to add for one unit of each coefficient."""
        return {}

    def unsaid(self, joint: RecordedJoint, theta: Theta, coefficients: np.ndarray) -> Columns:
        """Return the largest torque that the effect's fitted form leaves out, Nm or N, (n, 1)."""
        return {}

    def through(self, recording: Recording, column: np.ndarray, theta: Theta) -> np.ndarray:
        """Return what the effort must be for `column`, (n, k), to arrive at the joint."""
        return column

    def fixed(self, joint: RecordedJoint, theta: Theta) -> Values:
        """Return the physical parameters that are no coefficients."""
        own = (self.parameters.keys() & theta.keys()) - set(self.coefficients)
        half = joint.travel[1] if any(p.over_travel for p in self.nonlinear) else 1.0
        return {
            p.name: theta[p.name] * (half if p.over_travel else 1.0)
            for p in self.nonlinear
            if p.name in own
        }

    def readings(self, joint: RecordedJoint, theta: Theta) -> dict[str, Reading]:
        """Return where each physical parameter comes from."""
        found = {name: Reading(column=i) for i, name in enumerate(self.coefficients)}
        values = self.fixed(joint, theta)
        return found | {name: Reading(value=value) for name, value in values.items()}

    def unit(self, parameter: str, theta: Theta) -> str:
        """Return a parameter's unit at a hinge."""
        return self.parameters[parameter].unit

    def unit_of(self, parameter: str, theta: Theta, joint: RecordedJoint) -> str:
        """Return a parameter's unit at a joint."""
        hinge = joint.recording.is_hinge(joint.number)
        return unit_at(self.unit(parameter, theta), hinge=hinge)

    def bound(self, column: int) -> float:
        """Return the lower bound of a coefficient."""
        return self.lower[min(column, len(self.lower) - 1)]

    def unlikely(self, joint: RecordedJoint, theta: Theta) -> bool:
        """Return whether another name that is as good is to be given first."""
        return False

    def limits(self, joint: RecordedJoint) -> Limits:
        """Return the closed interval in which each parameter is physical at a joint."""
        return {name: (p.floor, p.ceiling) for name, p in self.parameters.items()}

    def beyond(
        self,
        joint: RecordedJoint,
        theta: Theta,
        coefficients: Mapping[int, float],
        *,
        difference: bool = False,
    ) -> str:
        """Return the first parameter that is not what the effect can be; empty if all are.

        Args:
            joint: that was fitted.
            theta: non-linear parameters.
            coefficients: of the columns that were kept, by column.
            difference: whether it only corrects a declared one, and may take away from it.
        """
        limits = self.limits(joint)
        if self.needs_first and not difference and coefficients.get(0, np.inf) <= ROUNDING:
            return self.coefficients[0]
        for name, reading in self.readings(joint, theta).items():
            if reading.columns <= coefficients.keys():
                low, high = limits[name]
                value = float(reading.of(coefficients))
                above = difference or value >= low - ROUNDING
                if not above or value > high + ROUNDING:
                    return name
        return ""

    def gain(self, coefficients: np.ndarray) -> float:
        """Return the torque at the joint over its effort, from the fitted coefficients."""
        return 1.0

    def motor_gain(self, parameters: Values) -> float:
        """Return the torque at the joint over what its motor reports."""
        return 1.0

    def add(self, spec: "mujoco.MjSpec", joint: str, parameters: Values) -> str | None:
        """Add the effect to a joint of `spec`.

        Args:
            spec: the model under construction; changed in place.
            joint: the joint's name.
            parameters: SI units.

        Returns:
            The element that now carries it, or None if no MuJoCo model can (it is left unchanged).

        Raises:
            ValueError: a parameter is missing or the result is not physical.
        """
        return None


def turns_freely(recording: Recording, joint: int) -> bool:
    """Whether a joint turns more often than its cables and springs could: as a motor does.

    Two full turns are as far as any robot's joint goes whose file declares no range; over ten no
    cable winds up, whatever range is declared.
    """
    if not recording.is_hinge(joint):
        return False
    low, high = recording.declared_range(joint)
    most = MOST_TURNS if high > low else TURNS
    return bool(np.ptp(recording.position[:, joint]) > 2.0 * np.pi * most)


class AppliedEffect(Effect):
    """An effect that MuJoCo has no element for: its torque is computed at every step."""

    element = "applied torque"

    @abstractmethod
    def simulated(self, parameters: Values, step: float) -> Callable[[Motion], float]:
        """Return what the motor has to add at each step of a simulation, with its own memory.

        Args:
            parameters: SI units.
            step: of the simulation, s.
        """

    def add(self, spec: "mujoco.MjSpec", joint: str, parameters: Values) -> str | None:
        from sim.effects.elements import add_applied

        return add_applied(spec, self.name, joint, parameters)


class Law(AppliedEffect):
    """An effect whose torque is a function of the joint's motion: one law for all uses."""

    @abstractmethod
    def torque(self, parameters: Values, motion: Motion) -> Signal:
        """Return what the motor has to add; linear in the parameters that are coefficients."""

    def motion(self, joint: RecordedJoint, theta: Theta) -> RecordedJoint:
        """Return the recorded motion as the law is told it."""
        return replace(joint, smooth=theta.get("smooth", 0.0))

    def columns(self, joint: RecordedJoint, theta: Theta) -> Columns:
        motion = self.motion(joint, theta)
        readings = self.readings(joint, theta)
        used = sorted(set().union(*(reading.columns for reading in readings.values())))
        columns = []
        for number in used:
            unit = {other: float(other == number) for other in used}
            parameters = {name: float(reading.of(unit)) for name, reading in readings.items()}
            torque = self.torque(parameters, motion)
            columns.append(np.broadcast_to(torque, joint.recording.time.shape))
        return {joint.number: np.column_stack(columns)}

    def simulated(self, parameters: Values, step: float) -> Callable[[Motion], float]:
        return lambda motion: float(self.torque(parameters, motion))
