"""What an effect of the catalogue is: torque as a function of the recorded signals.

The balance of a joint is effort = inverse dynamics + declared unknowns + effect, so a column here
is what the motor has to add for one unit of the coefficient: along the motion if it resists.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from analysis.closeloop.session.recording import Recording

#: Non-linear parameters of one variant of an effect.
Theta = Mapping[str, float]
#: For each joint (column number) that an effect acts on, its columns, shape (n, coefficients).
Columns = Mapping[int, np.ndarray]


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
class Parameter:
    """One physical parameter of an effect: its value is `scale` times coefficient `column`."""

    unit: str
    column: int | None = None
    scale: float = 1.0
    #: Another column that enters the value too, and its share.
    also: tuple[int, float] | None = None
    #: Fixed value of a non-linear parameter; None if it comes from a coefficient.
    value: float | None = None


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
    #: Effects whose torque is a special case of this one.
    includes: tuple[str, ...] = ()
    #: Effects that this one imitates nearly whole: only a paired test tells the two apart.
    twins: tuple[str, ...] = ()
    #: Lower bound of every coefficient (the last repeats); -inf if either sign is physical.
    lower: tuple[float, ...] = (-np.inf,)
    #: Whether the columns depend on the estimate so far.
    uses_estimate: bool = False
    #: Whether the effect acts on the whole effort channel instead of adding torque.
    channel: bool = False

    def applies(self, recording: Recording, joint: int) -> bool:
        """Whether the effect can be asked of this joint of this device."""
        return True

    def thetas(self, recording: Recording, joint: int, estimate: Estimate) -> list[Theta]:
        """Return the grid of non-linear parameters; one empty entry if there is none."""
        return [{}]

    def columns(
        self, recording: Recording, joint: int, theta: Theta, estimate: Estimate
    ) -> Columns:
        """Return what the motor has to add; nothing for an effect of the channel."""
        return {}

    def neighbours(self, theta: Theta, scale: float) -> list[Theta]:
        """Return parameters around `theta` to refine it; `scale` shrinks towards zero."""
        return []

    @abstractmethod
    def parameters(self, recording: Recording, joint: int, theta: Theta) -> dict[str, Parameter]:
        """Return the physical parameters by name."""


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """An effect at a joint."""

    effect: Effect
    joint: int
    label: str = field(default="")

    @property
    def key(self) -> tuple[str, int]:
        return self.effect.name, self.joint


def direction(recording: Recording, joint: int, share: float) -> np.ndarray:
    """Return the sign of the velocity, smooth below `share` of the top speed, (n,)."""
    speed = recording.velocity[:, joint]
    return np.asarray(np.tanh(speed / (share * recording.top_speed[joint])))


def travel(recording: Recording, joint: int) -> tuple[float, float]:
    """Return the middle and half width of the joint's range of motion."""
    position = recording.position[:, joint]
    low, high = float(position.min()), float(position.max())
    return (low + high) / 2, max((high - low) / 2, 1e-9)


def scaled(theta: Theta, name: str, scale: float, step: float = 0.4) -> list[Theta]:
    """Return `theta` with one positive parameter a little smaller and larger."""
    return [{**theta, name: theta[name] * (1 + sign * step * scale)} for sign in (-1, 1)]
