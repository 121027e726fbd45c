"""Distributions a factor may be drawn from, by their quantile functions.

These are in Johnson, Kotz and Balakrishnan 1994, Continuous univariate distributions.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from itertools import pairwise
from math import fsum, isfinite, log
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri
from scipy.stats import truncnorm

#: Probability left out at either end of what gives a distribution its scale.
_TAIL = 0.05


@dataclass(frozen=True, kw_only=True)
class Scale:
    """How wide a distribution is, in the factor's unit."""

    width: float
    #: "range": from its lowest to its highest value; "quantiles": from the 5 % to the 95 %
    #: quantile, over 0.9.
    by: str


@dataclass(frozen=True, kw_only=True)
class Distribution(ABC):
    """A distribution of one factor, in the factor's unit.

    Raises:
        ValueError: a parameter is not a finite number, or the parameters contradict each other.
    """

    #: The name in JSON.
    kind: ClassVar[str]

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
                raise ValueError(
                    f"{field.name} of a {self.kind} distribution must be a finite number"
                )
            object.__setattr__(self, field.name, float(value))
        self._check()

    @abstractmethod
    def _check(self) -> None:
        """Raise ValueError if the parameters contradict each other."""

    @abstractmethod
    def quantiles(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the quantiles of probabilities that are known to lie strictly between 0 and 1."""

    @property
    def scale(self) -> "Scale":
        """What turns an effect per whole range of probability into one per unit of the factor.

        An elementary effect is per step in probability (paper, equation 22 in the unit cube). In
        the factor's unit such a step is longer in the tails; in the mean over the central 90 % it
        is the distance of their quantiles over 0.9, which of a uniform factor is its range.
        """
        low, high = self.ppf([_TAIL, 1.0 - _TAIL]).tolist()
        return Scale(width=(high - low) / (1.0 - 2.0 * _TAIL), by="quantiles")

    def ppf(self, u: ArrayLike) -> NDArray[np.float64]:
        """Return the quantiles of probabilities `u`, elementwise; ValueError unless 0 < u < 1."""
        probabilities = np.asarray(u, dtype=np.float64)
        # A probability that is no number is not above 0 either.
        if probabilities.size and not (probabilities.min() > 0.0 and probabilities.max() < 1.0):
            raise ValueError("a probability must lie strictly between 0 and 1")
        return self.quantiles(probabilities)

    def to_json(self) -> dict[str, Any]:
        """Return the distribution as `from_json` reads it."""
        return {"kind": self.kind, **asdict(self)}

    @staticmethod
    def from_json(data: Mapping[str, Any]) -> "Distribution":
        """Read `{"kind": ..., <parameter>: <number>, ...}`; a discrete one has lists of numbers.

        Raises:
            ValueError: the kind is unknown, a parameter is missing, unknown or no finite number, or
                the parameters contradict each other.
        """
        kind = data.get("kind")
        known = {cls.kind: cls for cls in _KINDS}
        if not isinstance(kind, str) or kind not in known:
            raise ValueError(
                f"kind of a distribution must be one of {', '.join(known)}, not {kind!r}"
            )
        parameters = {name: value for name, value in data.items() if name != "kind"}
        wanted = [field.name for field in fields(known[kind])]
        if set(parameters) != set(wanted):
            given = ", ".join(map(str, parameters)) or "nothing"
            raise ValueError(f"a {kind} distribution takes {', '.join(wanted)}, not {given}")
        return known[kind](**parameters)


@dataclass(frozen=True, kw_only=True)
class Uniform(Distribution):
    """Equally likely everywhere from `low` to `high`."""

    kind: ClassVar[str] = "uniform"
    low: float
    high: float

    def _check(self) -> None:
        _ordered(self.kind, self.low, self.high)

    @property
    def scale(self) -> Scale:
        """Its range."""
        return Scale(width=self.high - self.low, by="range")

    def quantiles(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        # Rounded it may come out above the highest value, but never below the lowest.
        return np.minimum(self.low + u * (self.high - self.low), self.high)


@dataclass(frozen=True, kw_only=True)
class Normal(Distribution):
    """Gauss's distribution with standard deviation `sd`."""

    kind: ClassVar[str] = "normal"
    mean: float
    sd: float

    def _check(self) -> None:
        _positive(self.kind, "sd", self.sd)

    def quantiles(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(self.mean + self.sd * ndtri(u), dtype=np.float64)


@dataclass(frozen=True, kw_only=True)
class TruncatedNormal(Distribution):
    """A normal distribution of `mean` and `sd`, cut off below `low` and above `high`."""

    kind: ClassVar[str] = "truncated_normal"
    mean: float
    sd: float
    low: float
    high: float

    def _check(self) -> None:
        _positive(self.kind, "sd", self.sd)
        _ordered(self.kind, self.low, self.high)

    def quantiles(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        a, b = (self.low - self.mean) / self.sd, (self.high - self.mean) / self.sd
        x = truncnorm.ppf(u, a, b, loc=self.mean, scale=self.sd)
        return _clipped(np.asarray(x, dtype=np.float64), self.low, self.high)


@dataclass(frozen=True, kw_only=True)
class Triangular(Distribution):
    """A density that rises linearly from `low` to `mode` and falls to `high`."""

    kind: ClassVar[str] = "triangular"
    low: float
    mode: float
    high: float

    def _check(self) -> None:
        _ordered(self.kind, self.low, self.high)
        if not self.low <= self.mode <= self.high:
            raise ValueError("mode of a triangular distribution must lie from low to high")

    def quantiles(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        width, rise, fall = self.high - self.low, self.mode - self.low, self.high - self.mode
        x = np.where(
            u * width < rise,
            self.low + np.sqrt(u * width * rise),
            self.high - np.sqrt((1.0 - u) * width * fall),
        )
        return _clipped(x, self.low, self.high)


@dataclass(frozen=True, kw_only=True)
class LogUniform(Distribution):
    """A logarithm that is equally likely everywhere from log `low` to log `high`."""

    kind: ClassVar[str] = "loguniform"
    low: float
    high: float

    def _check(self) -> None:
        _positive(self.kind, "low", self.low)
        _ordered(self.kind, self.low, self.high)

    def quantiles(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        x = np.exp(log(self.low) + u * (log(self.high) - log(self.low)))
        return _clipped(x, self.low, self.high)


@dataclass(frozen=True, kw_only=True)
class Discrete(Distribution):
    """One of several values, each with its probability.

    Elementary effects of such a factor say how the output changes along the order of its values.
    """

    kind: ClassVar[str] = "discrete"
    #: Rising.
    values: tuple[float, ...]
    #: Positive, of sum 1.
    probabilities: tuple[float, ...]

    def __post_init__(self) -> None:
        for name in ("values", "probabilities"):
            numbers = getattr(self, name)
            if (
                not isinstance(numbers, list | tuple)
                or not numbers
                or any(
                    isinstance(number, bool)
                    or not isinstance(number, int | float)
                    or not isfinite(number)
                    for number in numbers
                )
            ):
                raise ValueError(f"{name} of a discrete distribution must be finite numbers")
            object.__setattr__(self, name, tuple(map(float, numbers)))
        self._check()

    def _check(self) -> None:
        if len(self.values) < 2:
            raise ValueError("a discrete distribution needs two values or more")
        if len(self.values) != len(self.probabilities):
            raise ValueError("a discrete distribution needs a probability for every value")
        if any(a >= b for a, b in pairwise(self.values)):
            raise ValueError("values of a discrete distribution must rise")
        for probability in self.probabilities:
            _positive(self.kind, "every probability", probability)
        if abs(fsum(self.probabilities) - 1.0) > 1e-9:
            raise ValueError(
                f"probabilities of a discrete distribution must add up to 1, not "
                f"{fsum(self.probabilities):g}"
            )

    @property
    def scale(self) -> Scale:
        """From its lowest to its highest value: quantiles of few values may coincide."""
        return Scale(width=self.values[-1] - self.values[0], by="range")

    def quantiles(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        edges = np.cumsum(self.probabilities)[:-1]
        return np.asarray(self.values)[np.searchsorted(edges, u, side="left")]

    def to_json(self) -> dict[str, Any]:
        return {
            "kind": self.kind,
            "values": list(self.values),
            "probabilities": list(self.probabilities),
        }


def scales(distributions: Mapping[str, Distribution]) -> dict[str, Scale]:
    """Return `Distribution.scale` of every factor: what the step of the paper's equation 22 is."""
    return {name: distribution.scale for name, distribution in distributions.items()}


_KINDS: tuple[type[Distribution], ...] = (
    Uniform,
    Normal,
    TruncatedNormal,
    Triangular,
    LogUniform,
    Discrete,
)


def _clipped(x: NDArray[np.float64], low: float, high: float) -> NDArray[np.float64]:
    """Return `x` within [low, high]; `np.clip` takes several times as long for a row's few."""
    return np.minimum(np.maximum(x, low), high)


def _ordered(kind: str, low: float, high: float) -> None:
    if not low < high:
        raise ValueError(
            f"low of a {kind} distribution must be below high, not {low:g} and {high:g}"
        )
    if not isfinite(high - low):
        raise ValueError(f"low and high of a {kind} distribution are too far apart")


def _positive(kind: str, name: str, value: float) -> None:
    if not value > 0.0:
        raise ValueError(f"{name} of a {kind} distribution must be positive, not {value:g}")
