"""What a law is told of its joint: one instant of a simulation, or a whole recording."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import tanh
from typing import TYPE_CHECKING, Protocol

import numpy as np

from sim.effects.functions import Signal

if TYPE_CHECKING:
    import mujoco

#: Width over which the direction of a simulated motion changes, rad/s or m/s.
SMOOTH = 0.01
#: MuJoCo's number of a joint that slides (`mjtJoint`), which is not imported to fit.
SLIDE = 2
#: What slides after a smaller share of half the travel is friction, whose contacts give way by some
#: milliradians first (Armstrong-Helouvry, Dupont and Canudas de Wit 1994, section 2).
PRESLIDING_SHARE = 0.02


class Recording(Protocol):
    """Recorded motion of a device, SI units; arrays have shape (n, joints) unless said otherwise.

    `time` is the session's clock, (n,), `period` the time between recorded samples, s; `trial` is
    the number of each sample's trial, (n,), of which `fit_trials` are fitted, `slices` are pieces
    without a gap, of which filters touch `edge` samples at both ends and miss those that are not
    `usable`, (n,); what somebody pushed is `disturbed`; `joints` are those whose balance is
    analysed, `limbs` those with a limb, `calibrated` those whose effort is no share of the torque.
    `effort` is low-passed for the fit, `sensed` as it was recorded; both are NaN where a joint has
    none. `inverse` is the torque that the declared chain needs, `static` what holding still in the
    same place would take. Below `rest_speed`, (joints,), a joint rests.
    """

    @property
    def time(self) -> np.ndarray: ...
    @property
    def rate(self) -> float: ...
    @property
    def period(self) -> float: ...
    @property
    def edge(self) -> int: ...
    @property
    def usable(self) -> np.ndarray: ...
    @property
    def disturbed(self) -> np.ndarray | None: ...
    @property
    def trial(self) -> np.ndarray: ...
    @property
    def fit_trials(self) -> tuple[int, ...]: ...
    @property
    def slices(self) -> Sequence[slice]: ...
    @property
    def joints(self) -> tuple[int, ...]: ...
    @property
    def position(self) -> np.ndarray: ...
    @property
    def velocity(self) -> np.ndarray: ...
    @property
    def acceleration(self) -> np.ndarray: ...
    @property
    def effort(self) -> np.ndarray: ...
    @property
    def sensed(self) -> np.ndarray: ...
    @property
    def inverse(self) -> np.ndarray: ...
    @property
    def rigid(self) -> np.ndarray: ...
    @property
    def static(self) -> np.ndarray: ...
    @property
    def top_speed(self) -> np.ndarray: ...
    @property
    def rest_speed(self) -> np.ndarray: ...
    @property
    def limbs(self) -> tuple[int, ...]: ...
    @property
    def calibrated(self) -> tuple[int, ...]: ...
    @property
    def gravity(self) -> np.ndarray: ...

    def is_hinge(self, joint: int) -> bool:
        """Return whether the joint turns; else it slides."""

    def declared_range(self, joint: int) -> tuple[float, float]:
        """Return the range that the joint's device declares, rad or m; (0, 0) if none."""

    def motor_inertia(self, joint: int) -> float:
        """Return the declared inertia of the joint's motor (armature), kg m2 or kg."""

    def motor_damping(self, joint: int) -> float:
        """Return the declared damping of the joint's motor and gear, Nm s/rad or N s/m."""

    @property
    def mass(self) -> float: ...

    def link_mass(self, joint: int) -> float:
        """Return the declared mass of the link that a joint moves, kg."""

    def reach(self, joint: int) -> float:
        """Return how far from a joint its device, with what hangs on it, can be, m."""

    # The body that a joint moves: its number and, in its frame, its centre of mass, (3,), None if
    # that lies on the joint's axis, and the axis, a unit vector, (3,).
    def body(self, joint: int) -> int: ...
    def centre_of_mass(self, joint: int) -> np.ndarray | None: ...
    def axis(self, joint: int) -> np.ndarray: ...

    def link_torque(self, body: int) -> np.ndarray:
        """Return the torques for one unit of each inertial parameter of a body, (n, joints, 10)."""

    def mass_torque(self, joint: int, position: np.ndarray) -> np.ndarray:
        """Return the torque of one more kilogram at `position` of the joint's body."""

    def weight(self, joint: int) -> np.ndarray:
        """Return what holds the joint in one m/s2 of gravity along x, y and z, (n, 3)."""

    # Of a chain whose bodies' inertial parameters differ by `changes`, (10,) or (n, 10) each.
    def slope(self, joint: int, changes: Mapping[int, np.ndarray] = ...) -> np.ndarray:
        """Return the change of every torque with a joint's place, as it moves, (n, joints)."""

    def drag(self, joint: int, changes: Mapping[int, np.ndarray] = ...) -> np.ndarray:
        """Return the change of every torque with a joint's speed, as it moves, (n, joints)."""

    def inertia(self, joint: int, changes: Mapping[int, np.ndarray] = ...) -> np.ndarray:
        """Return the torque of every joint for a unit of a joint's acceleration, (n, joints)."""

    def secant(self, joint: int, step: float) -> np.ndarray:
        """Return the change of every torque over `step` of a joint's position, as it moves."""

    # Of signals (n, ...), piece by piece: the fit's low-pass and that of the positions,
    # signal(t + seconds), a first-order low-pass, the rate of change.
    def filtered(self, columns: np.ndarray) -> np.ndarray: ...
    def smoothed(self, columns: np.ndarray) -> np.ndarray: ...
    def shifted(self, columns: np.ndarray, seconds: float) -> np.ndarray: ...
    def lagged(self, columns: np.ndarray, time_constant: float) -> np.ndarray: ...
    def derivative(self, columns: np.ndarray) -> np.ndarray: ...


@dataclass(frozen=True)
class Spring:
    """A spring between motor and link that a model has."""

    #: Those of `series_elasticity`; and what it adds to every torque, Nm or N, (n, joints).
    theta: Mapping[str, float]
    torque: np.ndarray


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """What is known of the joints before an effect is tried: some effects scale with it."""

    #: Fitted declared stiffness and damping per joint; zero where none is declared.
    stiffness: np.ndarray
    damping: np.ndarray
    #: Torque of the fitted declared model, low-passed, (n, joints); the same, not low-passed,
    #: without what motors themselves take and without friction.
    prediction: np.ndarray
    carried: np.ndarray
    #: Effort minus prediction, low-passed, NaN where there is no effort, (n, joints).
    residual: np.ndarray
    #: Torque of links and loads that were found, and of other joints, Nm or N, (n, joints).
    shared: np.ndarray
    #: By how much links and loads found differ from the declared, by body, (10,) or (n, 10).
    changes: Mapping[int, np.ndarray] = field(default_factory=dict)
    #: Torque of what else is elastic of limbs, by joint, from how far they are behind, (n,) both.
    elastic: Mapping[int, Callable[[np.ndarray], np.ndarray]] = field(default_factory=dict)
    #: Springs that were found, by their joint.
    springs: Mapping[int, Spring] = field(default_factory=dict)


@dataclass(frozen=True)
class RecordedJoint:
    """One joint of a recording: its motion, arrays (n,), and what is known before a fit."""

    recording: Recording
    number: int
    estimate: Estimate
    #: Share of the top speed below which the direction is smooth; torque that the joint carries.
    smooth: float = 0.0
    load: Signal = 0.0
    #: Direction of friction that winds up first, -1 to 1, (n,); None if it turns with the velocity.
    winding: np.ndarray | None = None
    #: How far what moves is behind the recorded position.
    behind: Signal = 0.0

    @property
    def position(self) -> np.ndarray:
        return np.asarray(self.recording.position[:, self.number] - self.behind)

    @property
    def velocity(self) -> np.ndarray:
        return self.recording.velocity[:, self.number]

    @property
    def acceleration(self) -> np.ndarray:
        return self.recording.acceleration[:, self.number]

    def inertia(self, joint: int) -> np.ndarray:
        """Torque of every joint for an acceleration of one, with links as found, (n, joints)."""
        return self.recording.inertia(joint, self.estimate.changes)

    def drag(self, joint: int) -> np.ndarray:
        """What every torque gains with the speed of one, as it moves, (n, joints)."""
        return self.recording.drag(joint, self.estimate.changes)

    def slope(self, joint: int) -> np.ndarray:
        """What every torque gains with the place of one, as it moves, (n, joints)."""
        return self.recording.slope(joint, self.estimate.changes)

    @property
    def effort(self) -> np.ndarray:
        """What the joint's motor reports, Nm or N; 0 where nothing is recorded."""
        return np.asarray(np.nan_to_num(self.recording.sensed[:, self.number]))

    @property
    def turning_speed(self) -> float:
        """Speed below which the direction is smooth, rad/s or m/s."""
        return self.smooth * self.top_speed

    @cached_property
    def direction(self) -> np.ndarray:
        if self.winding is not None:
            return self.winding
        return np.asarray(np.tanh(self.velocity / self.turning_speed))

    @property
    def time(self) -> np.ndarray:
        return np.asarray(self.recording.time - self.recording.time.min())

    @property
    def top_speed(self) -> float:
        return float(self.recording.top_speed[self.number])

    @property
    def rest_speed(self) -> float:
        return float(self.recording.rest_speed[self.number])

    @property
    def travel(self) -> tuple[float, float]:
        """Middle and half width of the range of motion."""
        return travel(self.recording.position[:, self.number])

    def wound(self, distance: float, exponent: float = 1.0) -> np.ndarray:
        """Return how far what gives way before the joint slides is wound, (n,); see `wound`."""
        return wound(self.position, self.recording.slices, distance, exponent)

    def bent(self, distance: float, levels: np.ndarray) -> np.ndarray:
        """Return how far bristles of constant stiffness are bent, (n,); see `bristles`."""
        return bristles(self.position, self.recording.slices, distance, levels)

    @property
    def weight(self) -> np.ndarray:
        return self.recording.weight(self.number)

    def other(self, dof: int) -> "RecordedJoint":
        return replace(self, number=dof)


@dataclass(frozen=True)
class SimulatedMotion:
    """Motion of one joint at one instant of a simulation."""

    data: "mujoco.MjData"
    qpos: int
    dof: int
    #: The session's clock where the simulation's stands at 0, s.
    begun: float = 0.0
    #: Actuators of each degree of freedom that has motors.
    motors: Mapping[int, np.ndarray] = field(default_factory=dict)

    @property
    def position(self) -> float:
        return float(self.data.qpos[self.qpos])

    @property
    def velocity(self) -> float:
        return float(self.data.qvel[self.dof])

    @property
    def acceleration(self) -> float:
        return float(self.data.qacc[self.dof])

    @property
    def turning_speed(self) -> float:
        return SMOOTH

    @property
    def direction(self) -> float:
        return tanh(self.velocity / SMOOTH)

    @property
    def load(self) -> float:
        return float(self.data.qfrc_bias[self.dof] - self.data.qfrc_passive[self.dof])

    @property
    def time(self) -> float:
        return self.begun + float(self.data.time)

    @property
    def weight(self) -> np.ndarray:
        """What holds the joint in one m/s2 of gravity along x, y and z, (3,)."""
        model, data = self.data.model, self.data
        joint = int(model.dof_jntid[self.dof])
        body, axis = int(model.jnt_bodyid[joint]), data.xaxis[joint]
        lever = data.subtree_com[body] - data.xanchor[joint]
        lifted = axis if model.jnt_type[joint] == SLIDE else np.cross(axis, lever)
        return np.asarray(-float(model.body_subtreemass[body]) * lifted)

    @property
    def effort(self) -> float:
        """What the joint's motors gave last; of one without a motor, what is applied to it."""
        own = self.motors.get(self.dof)
        if own is None:
            return float(self.data.qfrc_applied[self.dof])
        return float(self.data.actuator_force[own] @ self.data.model.actuator_gear[own, 0])

    def other(self, dof: int) -> "SimulatedMotion":
        qpos = int(self.data.model.jnt_qposadr[self.data.model.dof_jntid[dof]])
        return replace(self, qpos=qpos, dof=dof)


Motion = RecordedJoint | SimulatedMotion


def wound(
    position: np.ndarray, slices: Sequence[slice], distance: float, exponent: float = 1.0
) -> np.ndarray:
    """Return how far what gives way before it slides is wound, -1 to 1, (n,).

    From 0 at the start of each piece; over `distance` most of the way after each reversal (Dahl
    1968) if `exponent` is 1, all of it as a spring that then yields if it is 0.

    Args:
        position: of what slides, rad or m, (n,).
        slices: pieces without a gap.
        distance: rad or m.
        exponent: 1 or 0.
    """
    out = np.zeros(len(position))
    for piece in slices:
        own = position[piece]
        sign = np.sign(np.diff(own, prepend=own[0]))
        starts = np.concatenate([[0], np.flatnonzero(np.diff(sign)) + 1])
        lengths = np.diff(np.concatenate([starts, [len(own)]]))
        begin = np.repeat(np.maximum(starts - 1, 0), lengths)
        ways = (own - own[begin]) / distance
        last, states, state = starts + lengths - 1, [], 0.0
        if exponent == 0.0:
            for way in ways[last].tolist():
                states.append(state)
                state = min(max(state + way, -1.0), 1.0)
            out[piece] = np.clip(np.repeat(states, lengths) + ways, -1.0, 1.0)
            continue
        left = np.exp(-np.abs(ways))
        left[sign == 0.0] = 1.0
        for way, share in zip(sign[starts].tolist(), left[last].tolist(), strict=True):
            states.append(state)
            state = way + (state - way) * share
        out[piece] = sign + (np.repeat(states, lengths) - sign) * left
    return out


def bristles(
    position: np.ndarray, slices: Sequence[slice], distance: float, levels: np.ndarray
) -> np.ndarray:
    """Return how far bristles of constant stiffness are bent, over what they slide with, (n,).

    The higher the level, the longer the way (LuGre; Canudas de Wit, Olsson, Astrom and Lischinsky
    1995).

    Args:
        position: of what slides, rad or m, (n,).
        slices: pieces without a gap.
        distance: over which most of a level of one is built up, rad or m.
        levels: that they slide with at each sample, above 0, (n,).
    """
    out = np.zeros(len(position))
    for piece in slices:
        ways = np.diff(position[piece], prepend=position[piece][0])
        ends = np.sign(ways) * levels[piece]
        shares = np.exp(-np.abs(ways) / (distance * levels[piece]))
        bent, states = 0.0, []
        for end, share in zip(ends.tolist(), shares.tolist(), strict=True):
            bent = end + (bent - end) * share
            states.append(bent)
        out[piece] = states
    return np.asarray(out / levels)


def travel(position: np.ndarray) -> tuple[float, float]:
    """Return the middle and half width of a range of positions."""
    low, high = float(position.min()), float(position.max())
    return (low + high) / 2, max((high - low) / 2, 1e-9)
