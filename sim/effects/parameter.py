"""Physical parameters of an effect, and how each is read from a fit."""

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from math import inf
from types import MappingProxyType

import numpy as np

from sim.effects.functions import Signal

#: Values of an effect's parameters by name, SI units.
Values = Mapping[str, float]


@dataclass(frozen=True)
class Parameter:
    """One physical parameter of an effect."""

    #: Unit at a hinge.
    unit: str
    description: str
    #: Range of a study that names none; infinite if no simulated assessment has the effect.
    low: float = -inf
    high: float = inf
    _: KW_ONLY
    #: Value without the effect, or a harmless one if the effect is off by another parameter.
    neutral: float = 0.0
    #: Whether the effect is off while this parameter (and its like) is neutral.
    switches: bool = False
    #: Closed interval outside which the value means nothing.
    floor: float = -inf
    ceiling: float = inf
    #: Whether it is a choice, not a quantity: a study keeps what was found.
    choice: bool = False
    #: Whether it depends on where the joint's angle is zero and which way it counts.
    in_joint_frame: bool = False

    def within_limits(self, value: float) -> float:
        """Return the value, or the nearest one that means something."""
        return min(max(value, self.floor), self.ceiling)


#: Unit of what waves with a hinge's angle.
PERIODS = "periods/turn"


def unit_at(unit: str, *, hinge: bool) -> str:
    """Return a hinge's unit as it is, or that of a slide: N for Nm and m for rad.

    A wave of k periods a turn is one of k rad a radian, and at a slide of k rad a metre.
    """
    if unit == PERIODS:
        return unit if hinge else "rad/m"
    return unit if hinge else unit.replace("kg m2", "kg").replace("Nm", "N").replace("rad", "m")


def named(**parameters: Parameter) -> Mapping[str, Parameter]:
    """Return parameters by name."""
    return MappingProxyType(parameters)


def size(unit: str, high: float, description: str, *, low: float = 0.0) -> Parameter:
    """Return a parameter that switches its effect and cannot change sign if `low` is 0."""
    floor = 0.0 if low >= 0.0 else -inf
    return Parameter(unit, description, low, high, switches=True, floor=floor)


#: Steps that show the slope over a non-linear parameter: absolute, and over its value.
RELATIVE, SECONDS = (1e-3, 0.02), (5e-4, 0.0)


def both_signs(*sizes: float) -> tuple[float, ...]:
    """Return every size with either sign."""
    return tuple(sign * size for size in sizes for sign in (-1.0, 1.0))


@dataclass(frozen=True)
class Nonlinear:
    """A parameter that the columns are not linear in: where its search begins and goes on."""

    name: str
    #: Values to begin with.
    grid: tuple[float, ...] = ()
    _: KW_ONLY
    #: Largest moves that refine it: over its value, and absolute.
    scaling: float = 0.0
    shift: float = 0.0
    #: Whether it is over half the travel, as ways are.
    over_travel: bool = False
    #: Step that shows the slope over it; None for a choice, or what shifts with the estimate: they
    #: have no interval.
    step: tuple[float, float] | None = None
    #: Value that is given, and no estimate, where the trials tell no other.
    usual: float | None = None

    def near(self, value: float, scale: float) -> list[float]:
        """Return values around `value`; `scale` shrinks from 1 towards zero."""
        if self.scaling:
            return [value * (1 + sign * self.scaling * scale) for sign in (-1, 1)]
        return [value + sign * self.shift * scale for sign in (-1, 1)] if self.shift else []


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Where a physical parameter comes from: `scale` times coefficient `column`, or `value`."""

    column: int | None = None
    scale: float = 1.0
    #: Another column that enters the value too, and its share.
    also: tuple[int, float] | None = None
    #: A column that the value is the ratio to, added to `value`: where a mass hangs.
    over: int | None = None
    #: Value of a non-linear parameter.
    value: float | None = None
    #: Whether it is the gain of an effort channel: effort = (1 + coefficient) declared torque.
    gain: bool = False

    @property
    def columns(self) -> set[int]:
        """Columns that enter the value."""
        found = (self.column, self.over, None if self.also is None else self.also[0])
        return {column for column in found if column is not None}

    def of(self, coefficients: Mapping[int, Signal], scaled: float = 1.0) -> Signal:
        """Return the parameter.

        Args:
            coefficients: by column; one that `also` names may be missing.
            scaled: torque at the joint over the effort reported, which divides the whole balance.

        Returns:
            Its value; not finite where what it is divided by is zero, as the place of no mass.
        """
        if self.column is None:
            assert self.value is not None
            return self.value
        found = coefficients[self.column]
        if self.over is not None:
            with np.errstate(divide="ignore", invalid="ignore"):
                return (self.value or 0.0) + np.divide(found, coefficients[self.over])
        if self.gain:
            return 1.0 / np.maximum(1.0 + found, 0.05)
        if self.also is not None and self.also[0] in coefficients:
            found = found + self.also[1] * coefficients[self.also[0]]
        return found * self.scale * scaled

    def lowest(self, bound: float, scaled: float = 1.0) -> float:
        """Return the least value while the coefficient is at least `bound`."""
        if self.gain or self.also is not None or self.over is not None or self.scale <= 0:
            return -inf
        return bound * self.scale * scaled
