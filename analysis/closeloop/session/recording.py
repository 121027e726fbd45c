"""All trials as arrays at the working rate: the source of residuals, effects and splines."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np

from analysis.closeloop.session.chain.elsewhere import coefficients, rates
from analysis.closeloop.session.chain.link_torque import WAYS, ChainMotion, Tangents, chain_motion
from analysis.closeloop.session.chain.thinned import Thinned
from analysis.closeloop.session.contents import NOMINAL, Session
from analysis.closeloop.session.device import Device
from analysis.closeloop.session.runs import holds, rests, runs, since_reversal, turning
from analysis.closeloop.session.signals import (
    FLICKERS,
    LEAST_MEASURED,
    REST_SHARE,
    PiecesLowpass,
    Sampling,
    before_lag,
    digit_speed,
    lagged,
    least_digit,
    lowpass,
    shifted,
    slope,
)
from sim.effects.rigid import point_mass

#: Links that are as declared.
NONE: Mapping[int, np.ndarray] = {}
#: What does not depend on which joints are analysed.
SHARED = (
    *("rigid", "inverse", "static", "top_speed", "rest_speed", "sensed"),
    *("_lowpass", "_thinned", "_tangents"),
)

Made = TypeVar("Made")


@dataclass(frozen=True, kw_only=True)
class Recording:
    """Signals of all trials, one after the other: arrays (n, joints) unless said otherwise."""

    device: Device
    session: Session
    sampling: Sampling
    #: Where each stretch between gaps lies in the arrays.
    slices: list[slice]
    #: Trial number of each sample, (n,).
    trial: np.ndarray
    #: Session clock, s, (n,).
    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    #: Low-passed for the fit; NaN where a joint has none.
    effort: np.ndarray
    #: Share of the samples around that were recorded, 0 to 1, (n,): others enter no regression.
    measured: np.ndarray
    #: (n, extra columns), NaN where a trial lacks it.
    extra: np.ndarray
    extra_names: tuple[str, ...]
    #: Joints (column numbers) whose balance is analysed.
    joints: tuple[int, ...]
    #: Trials that may be fitted.
    fit_trials: tuple[int, ...]
    #: Whether no joint with an effort moves: nothing can be fitted, and only events looked for.
    still: bool = False
    #: The effort before that low-pass; None if nobody kept it.
    unfiltered: np.ndarray | None = None
    #: Samples that something from outside disturbed, (n, joints); None if nobody has looked.
    disturbed: np.ndarray | None = None
    #: Inverse dynamics are asked for again and again with the same arguments.
    cache: dict[tuple[object, ...], Any] = field(default_factory=dict, repr=False)

    @property
    def rate(self) -> float:
        return self.sampling.working

    @property
    def period(self) -> float:
        """Time between two recorded samples, s."""
        return 1.0 / self.sampling.recorded

    @property
    def edge(self) -> int:
        """Samples at both ends of a piece that the filters touch."""
        return int(self.rate / self.sampling.fit_cutoff)

    def name(self, joint: int) -> str:
        """Return the name of a joint by its column."""
        return self.device.joints[joint]

    def trial_of(self, piece: slice) -> int:
        """Return the number of the trial that a stretch belongs to."""
        return int(self.trial[piece.start])

    def pieces_of(self, trial: int) -> list[slice]:
        """Return the stretches of a trial."""
        return [piece for piece in self.slices if self.trial_of(piece) == trial]

    def raw_effort(self, trial: int, joint: int) -> np.ndarray | None:
        """Return a joint's effort in a trial as it was recorded, on the trial's own clock."""
        return self.session.trials[trial].columns.get(f"{self.name(joint)}.effort")

    def raw_position(self, trial: int, joint: int) -> np.ndarray | None:
        """Return a joint's position in a trial, rad or m, as `raw_effort`."""
        return self.session.trials[trial].columns.get(f"{self.name(joint)}.position")

    @cached_property
    def sensed(self) -> np.ndarray:
        """The effort before the fit's low-pass and its trial's; NaN where a joint has none."""
        found = np.array(self.effort if self.unfiltered is None else self.unfiltered)
        for piece in self.slices:
            hertz = self.session.trials[self.trial_of(piece)].effort_filter_hz
            if hertz is not None:
                found[piece] = before_lag(found[piece], 1.0 / (2 * np.pi * hertz), self.rate)
        return found

    @cached_property
    def inverse(self) -> np.ndarray:
        """Torque that the declared chain needs, declared Coulomb friction included."""
        return np.asarray(self.rigid + self.device.friction * self.built_in_direction)

    @cached_property
    def built_in_direction(self) -> np.ndarray:
        """Which way declared Coulomb friction acts, -1 to 1."""
        return np.asarray(np.tanh(self.velocity / (0.5 * self.rest_speed)))

    @cached_property
    def rigid(self) -> np.ndarray:
        """Torque that the declared chain needs without Coulomb friction."""
        return self._inverse(self.position, self.velocity, self.acceleration)

    @cached_property
    def static(self) -> np.ndarray:
        """Torque that holding still in the same place would take: gravity and declared springs."""
        return self._at_rest()

    def secant(self, joint: int, step: float) -> np.ndarray:
        """Change of every torque over `step` of one joint's position, as it moves, (n, joints)."""
        here, hinge, one = self.rigid, self.is_hinge(joint), np.eye(self.position.shape[1])[joint]

        def torque(way: float) -> np.ndarray:
            return self._inverse(self.position + way * one, self.velocity, self.acceleration)

        known = self._once(("elsewhere", joint), lambda: coefficients(torque, here, hinge))
        if len(known):
            return np.asarray(np.tensordot(rates(step, hinge), known, axes=1))
        return self._once(("secant", joint, step), lambda: (torque(step) - here) / step)

    def slope(self, joint: int, changes: Mapping[int, np.ndarray] = NONE) -> np.ndarray:
        """Change of every torque with a joint's place, with bodies that differ, (n, joints)."""
        found = self._once(("slope", joint), partial(self.secant, joint, WAYS["place"]))
        return self._tangents.whole("place", joint, changes, lambda: found)

    def drag(self, joint: int, changes: Mapping[int, np.ndarray] = NONE) -> np.ndarray:
        """Change of every torque with a joint's speed, as `slope`."""
        one = np.eye(self.velocity.shape[1])[joint]

        def at(speed: float) -> np.ndarray:
            return self._inverse(self.position, self.velocity + speed * one, self.acceleration)

        # Exact of what grows with the square of a speed.
        found: np.ndarray = self._once(("drag", joint), lambda: 0.5 * (at(1.0) - at(-1.0)))
        return self._tangents.whole("speed", joint, changes, lambda: found)

    def inertia(self, joint: int, changes: Mapping[int, np.ndarray] = NONE) -> np.ndarray:
        """Torque of every joint for a unit of a joint's acceleration, as `slope`."""
        found = self._once(("inertia", joint), lambda: self._at_rest(joint) - self.static)
        return self._tangents.whole("acceleration", joint, changes, lambda: found)

    @cached_property
    def _tangents(self) -> Tangents:
        motion, thinned = (self.position, self.velocity, self.acceleration), self._thinned
        return Tangents(self.device.model, motion, thinned.samples, thinned.between)

    def is_hinge(self, joint: int) -> bool:
        """Whether the joint turns; else it slides."""
        return self.device.is_hinge(self.name(joint))

    def declared_range(self, joint: int) -> tuple[float, float]:
        """Return a joint's declared range, rad or m; (0, 0) if it has none."""
        return self.device.range(self.name(joint))

    @cached_property
    def limbs(self) -> tuple[int, ...]:
        """Joints at which a limb acts: those of the nominal arm, or what the session says."""
        whole, own = self.session.model == NOMINAL, self.session.limb_joints
        return tuple(j for j, name in enumerate(self.device.joints) if whole or name in own)

    @cached_property
    def calibrated(self) -> tuple[int, ...]:
        """Joints whose effort is known to be the torque, and no share of it."""
        return tuple(j for j in self.joints if f"{self.name(j)}.effort" in self.session.calibrated)

    def motor_inertia(self, joint: int) -> float:
        """Return the declared inertia of the joint's motor (armature), kg m2 or kg."""
        return float(self.device.model.dof_armature[self.device.dof(self.name(joint))])

    def motor_damping(self, joint: int) -> float:
        """Return the declared damping of the joint's motor and gear, Nm s/rad or N s/m."""
        return float(self.device.model.dof_damping[self.device.dof(self.name(joint))])

    @property
    def mass(self) -> float:
        """Declared mass of all links, kg."""
        return float(self.device.model.body_mass.sum())

    def link_mass(self, joint: int) -> float:
        """Return the declared mass of the link that a joint moves, kg."""
        return float(self.device.model.body_mass[self.device.body(joint)])

    def reach(self, joint: int) -> float:
        """Return how far from a joint its device, with what hangs on it, can be, m."""
        return self.device.reach(joint)

    def centre_of_mass(self, joint: int) -> np.ndarray | None:
        """Return that of the joint's body in its frame, (3,); None if it lies on the axis."""
        return self.device.centre_of_mass(joint)

    def axis(self, joint: int) -> np.ndarray:
        """Return a joint's axis in the frame of its body, a unit vector, (3,)."""
        return self.device.axis(joint)

    def body(self, joint: int) -> int:
        """Return the number of the body that a joint moves."""
        return self.device.body(joint)

    def mass_torque(self, joint: int, position: np.ndarray) -> np.ndarray:
        """Return the torque of one more kilogram at `position` of the joint's body."""
        return np.asarray(self.link_torque(self.body(joint)) @ point_mass(position))

    @cached_property
    def chain(self) -> ChainMotion:
        """How the links of the device moved."""
        motion = self.position, self.velocity, self.acceleration
        return chain_motion(self.device.model, *motion)

    def link_torque(self, body: int) -> np.ndarray:
        """Return the torques for one unit of each inertial parameter of a body, (n, joints, 10)."""
        return self._once(("link", body), lambda: self.chain.link_torque(body))

    @property
    def gravity(self) -> np.ndarray:
        """Declared gravity, m/s2, (3,)."""
        return np.asarray(self.device.model.opt.gravity)

    def weight(self, joint: int) -> np.ndarray:
        """Return what holds a joint in one m/s2 of gravity along x, y and z, (n, 3)."""
        return self._once(("weight", joint), lambda: self.chain.weight(joint))

    def of_joint(self, joint: int) -> "Recording":
        """Return the same recording with the balance of one joint only."""
        found = replace(self, joints=(joint,))
        # Motion and declared torques are the same: nothing is computed again.
        vars(found).update({name: getattr(self, name) for name in SHARED})
        return found

    @cached_property
    def top_speed(self) -> np.ndarray:
        """Speed that 1 % of the samples exceed, (joints,); tiny but positive for a held joint."""
        return np.asarray(np.maximum(np.quantile(np.abs(self.velocity), 0.99, axis=0), 1e-9))

    @cached_property
    def rest_speed(self) -> np.ndarray:
        """Speed below which a joint counts as resting, (joints,): its encoder's steps are none."""
        flicker = [
            digit_speed(self._last_digit(joint), self.sampling)
            for joint in range(self.position.shape[1])
        ]
        return np.asarray(np.maximum(REST_SHARE * self.top_speed, FLICKERS * np.array(flicker)))

    def _last_digit(self, joint: int) -> float:
        """Return what rounding leaves of a joint's position, rad or m; 0 if it shows no steps."""
        raw = [self.raw_position(trial, joint) for trial in range(len(self.session.trials))]
        known = [signal for signal in raw if signal is not None]
        return least_digit(np.concatenate(known)) if known else 0.0

    def resting(self, joint: int, piece: slice) -> np.ndarray:
        """Return where the joint stays below its rest speed for longer than a reversal takes."""
        return rests(self.velocity[piece, joint], float(self.rest_speed[joint]), self.rate)

    def held(self, joint: int, piece: slice) -> list[slice]:
        """Return where in a stretch a joint rests, or comes back at once to where it rested."""
        return holds(self.position[piece, joint], self.resting(joint, piece), self.rate)

    def since_reversal(self, joint: int) -> np.ndarray:
        """Return the time since a joint last changed direction, with that direction's sign, (n,).

        A rest keeps the direction before it: it is no reversal yet.
        """
        speed, least = self.velocity[:, joint], float(self.rest_speed[joint])
        return self._by_piece(speed, lambda piece: since_reversal(piece, least, self.rate))

    def movement_seconds(self, joint: int) -> float:
        """Return how long a joint goes on in one direction, s: the median of the time it takes.

        Infinite for one that never moves.
        """
        lengths = np.sort(
            [
                own.stop - own.start
                for direction in (np.sign(self.since_reversal(joint)[p]) for p in self.slices)
                for sign in (1.0, -1.0)
                for own in runs(direction == sign)
            ]
        )
        if not len(lengths):
            return np.inf
        half = int(np.searchsorted(np.cumsum(lengths), 0.5 * lengths.sum()))
        return float(lengths[half] / self.rate)

    def turning(self, joint: int) -> np.ndarray:
        """Return where a joint rests or changes direction, (n,): its friction may be any there."""
        return self.turns(self.velocity[:, joint], float(self.rest_speed[joint]))

    def turns(self, velocity: np.ndarray, rest_speed: float) -> np.ndarray:
        """Return where what goes at a velocity, (n,), rests or changes direction, (n,)."""
        return self._by_piece(velocity, lambda piece: turning(piece, rest_speed))

    def filtered(self, columns: np.ndarray) -> np.ndarray:
        """Pass columns (n, ...) through the fit's low-pass, piece by piece, as the effort."""
        return self._lowpass(columns)

    @cached_property
    def _lowpass(self) -> PiecesLowpass:
        return PiecesLowpass(self.measured, self.slices, self.sampling.fit_cutoff, self.rate)

    @cached_property
    def usable(self) -> np.ndarray:
        """Where the fit's low-pass sees enough recorded samples, (n,)."""
        cutoff = self.sampling.fit_cutoff
        seen = self._by_piece(self.measured, lambda piece: lowpass(piece, cutoff, self.rate))
        return np.asarray(seen >= LEAST_MEASURED)

    def smoothed(self, columns: np.ndarray) -> np.ndarray:
        """Pass columns (n, ...) through the low-pass of the positions, piece by piece."""
        return self._by_piece(
            columns, lambda piece: lowpass(piece, self.sampling.cutoff, self.rate)
        )

    def shifted(self, columns: np.ndarray, seconds: float) -> np.ndarray:
        """Return columns(t + seconds), (n, ...), piece by piece."""
        return self._by_piece(columns, lambda piece: shifted(piece, seconds, self.rate))

    def lagged(self, columns: np.ndarray, time_constant: float) -> np.ndarray:
        """Return columns (n, ...) behind a first-order low-pass, piece by piece."""
        return self._by_piece(columns, lambda piece: lagged(piece, time_constant, self.rate))

    def derivative(self, columns: np.ndarray) -> np.ndarray:
        """Return the rate of change of columns (n, ...), piece by piece."""
        return self._by_piece(columns, lambda piece: slope(piece, self.rate))

    def _once(self, key: tuple[object, ...], make: Callable[[], Made]) -> Made:
        """Return what has been made once by this name."""
        if key not in self.cache:
            self.cache[key] = make()
        made: Made = self.cache[key]
        return made

    def _by_piece(
        self, columns: np.ndarray, change: Callable[[np.ndarray], np.ndarray]
    ) -> np.ndarray:
        return np.concatenate([change(columns[piece]) for piece in self.slices])

    @cached_property
    def _thinned(self) -> Thinned:
        return Thinned(self.slices)

    def _at_rest(self, accelerated: int | None = None) -> np.ndarray:
        """Return the torque at rest, or with one joint accelerated by 1."""
        every = self._thinned.samples
        still = np.zeros((len(every), self.position.shape[1]))
        pushed = still.copy()
        if accelerated is not None:
            pushed[:, accelerated] = 1.0
        return self._thinned.between(self._inverse(self.position[every], still, pushed, rows=every))

    def _inverse(
        self,
        position: np.ndarray,
        velocity: np.ndarray,
        acceleration: np.ndarray,
        rows: np.ndarray | slice = slice(None),
    ) -> np.ndarray:
        """Inverse dynamics of the samples `rows`, each trial with the masses it carried."""
        torque = np.empty_like(position)
        trials = self.trial[rows]
        for number, trial in enumerate(self.session.trials):
            own = trials == number
            if own.any():
                masses = (trial.added_mass,) if trial.added_mass else ()
                torque[own] = self.device.inverse_dynamics(
                    position[own], velocity[own], acceleration[own], masses=masses
                )
        return torque
