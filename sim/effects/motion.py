"""What a law is told of its joint: one instant of a simulation, or a whole recording."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from sim.effects.functions import Signal


class Motion(Protocol):
    """Motion of one joint, SI units; floats in a simulation, arrays (n,) of a recording."""

    @property
    def position(self) -> Signal: ...
    @property
    def velocity(self) -> Signal: ...
    @property
    def acceleration(self) -> Signal: ...
    @property
    def direction(self) -> Signal:
        """Sign of the velocity, smooth through zero, -1 to 1."""

    @property
    def load(self) -> Signal:
        """Size of the torque that the joint carries, at least 0."""

    @property
    def time(self) -> Signal: ...
    def other(self, dof: int) -> tuple[Signal, Signal]:
        """Return position and velocity of another joint."""


class Recording(Protocol):
    """Recorded motion of a device; arrays have shape (n, joints) unless said otherwise."""

    @property
    def time(self) -> np.ndarray:
        """Session clock, s, (n,)."""

    @property
    def rate(self) -> float:
        """Samples a second."""

    @property
    def slices(self) -> Sequence[slice]:
        """Pieces without a gap."""

    @property
    def joints(self) -> tuple[int, ...]:
        """Joints whose balance is analysed."""

    @property
    def position(self) -> np.ndarray: ...
    @property
    def velocity(self) -> np.ndarray: ...
    @property
    def acceleration(self) -> np.ndarray: ...
    @property
    def effort(self) -> np.ndarray:
        """NaN where a joint has none."""

    @property
    def inverse(self) -> np.ndarray:
        """Torque that the declared chain needs."""

    @property
    def static(self) -> np.ndarray:
        """Torque that holding still in the same place would take."""

    @property
    def own_inertia(self) -> np.ndarray:
        """Diagonal of the mass matrix, kg m2 or kg."""

    @property
    def top_speed(self) -> np.ndarray:
        """(joints,)."""

    @property
    def rest_speed(self) -> np.ndarray:
        """Speed below which a joint rests, (joints,)."""

    def is_hinge(self, joint: int) -> bool:
        """Whether the joint turns; else it slides."""

    def centre_of_mass(self, joint: int) -> np.ndarray | None:
        """Return that of the joint's body in its frame, (3,); None if it lies on the axis."""

    def mass_torque(self, joint: int, position: np.ndarray) -> np.ndarray:
        """Return the torque of one more kilogram at `position` of the joint's body."""

    def secant(self, joint: int, step: float) -> np.ndarray:
        """Return the change of every static torque over `step` of one joint's position."""

    # Signals (n, ...), piece by piece.
    def filtered(self, signal: np.ndarray) -> np.ndarray:
        """Return what the fit's low-pass leaves."""

    def smoothed(self, signal: np.ndarray) -> np.ndarray:
        """Return what the low-pass of the positions leaves."""

    def shifted(self, signal: np.ndarray, seconds: float) -> np.ndarray:
        """Return signal(t + seconds)."""

    def lagged(self, signal: np.ndarray, time_constant: float) -> np.ndarray:
        """Return the signal behind a first-order low-pass."""

    def derivative(self, signal: np.ndarray) -> np.ndarray:
        """Return the signal's rate of change."""


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """What is known of the joints before an effect is tried: some effects scale with it."""

    #: Fitted declared stiffness and damping per joint; zero where none is declared.
    stiffness: np.ndarray
    damping: np.ndarray
    #: Torque of the declared model with its fitted unknowns, low-passed, (n, joints).
    prediction: np.ndarray
    #: Effort minus prediction, low-passed, NaN where there is no effort, (n, joints).
    residual: np.ndarray


@dataclass(frozen=True, kw_only=True)
class RecordedMotion:
    """The recorded motion of one joint, as `Motion`; arrays (n,)."""

    recording: Recording
    joint: int
    #: Share of the top speed below which the direction is smooth.
    smooth: float = 0.0
    load: Signal = 0.0

    @property
    def position(self) -> np.ndarray:
        return self.recording.position[:, self.joint]

    @property
    def velocity(self) -> np.ndarray:
        return self.recording.velocity[:, self.joint]

    @property
    def acceleration(self) -> np.ndarray:
        return self.recording.acceleration[:, self.joint]

    @cached_property
    def direction(self) -> np.ndarray:
        scale = self.smooth * self.recording.top_speed[self.joint]
        return np.asarray(np.tanh(self.velocity / scale))

    @property
    def time(self) -> np.ndarray:
        return np.asarray(self.recording.time - self.recording.time.min())

    def other(self, dof: int) -> tuple[Signal, Signal]:
        return self.recording.position[:, dof], self.recording.velocity[:, dof]


def travel(recording: Recording, joint: int) -> tuple[float, float]:
    """Return the middle and half width of the joint's range of motion."""
    position = recording.position[:, joint]
    low, high = float(position.min()), float(position.max())
    return (low + high) / 2, max((high - low) / 2, 1e-9)
