"""Distributions a factor may be drawn from, by their quantile functions.

These are in Johnson, Kotz and Balakrishnan 1994, Continuous univariate distributions.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from itertools import pairwise
from math import fsum, log
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import log1p, log_ndtr, logsumexp, ndtr, ndtri, ndtri_exp

from analysis.json_values import is_finite_number

#: Of a larger number the square, of which variances are made, is no number.
LARGEST = 1e100
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
    #: Parameters that must be above 0.
    positive: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        for field in fields(self):
            object.__setattr__(self, field.name, self._read(field.name, getattr(self, field.name)))
        given = vars(self)
        for name in self.positive:
            self._check_positive(name, given[name])
        if "low" in given:
            low, high = given["low"], given["high"]
            if not low < high:
                raise ValueError(
                    f"low of a {self.kind} distribution must be below high, not {low:g} and "
                    f"{high:g}"
                )

    def _read(self, name: str, value: Any) -> Any:
        """Return a parameter as it is kept; ValueError if it is not a finite number."""
        if not is_finite_number(value):
            raise ValueError(f"{name} of a {self.kind} distribution must be a finite number")
        self._check_size(name, value)
        return float(value)

    def _check_size(self, name: str, value: float) -> None:
        if abs(value) > LARGEST:
            raise ValueError(
                f"{name} of a {self.kind} distribution must be within ±{LARGEST:g}, not {value:g}"
            )

    def _check_positive(self, name: str, value: float) -> None:
        if not value > 0.0:
            raise ValueError(
                f"{name} of a {self.kind} distribution must be positive, not {value:g}"
            )

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
        parameters = {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in asdict(self).items()
        }
        return {"kind": self.kind, **parameters}

    @staticmethod
    def from_json(data: Mapping[str, Any]) -> "Distribution":
        """Read `{"kind": ..., <parameter>: <number>, ...}`; a discrete one has lists of numbers.

        Raises:
            ValueError: the kind is unknown, a parameter is missing, unknown or no finite number, or
                the parameters contradict each other.
        """
        kind = data.get("kind")
        known = {cls.kind: cls for cls in Distribution.__subclasses__()}
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
    positive: ClassVar[tuple[str, ...]] = ("sd",)
    mean: float
    sd: float

    def quantiles(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(self.mean + self.sd * ndtri(u), dtype=np.float64)


@dataclass(frozen=True, kw_only=True)
class TruncatedNormal(Distribution):
    """A normal distribution of `mean` and `sd`, cut off below `low` and above `high`."""

    kind: ClassVar[str] = "truncated_normal"
    positive: ClassVar[tuple[str, ...]] = ("sd",)
    mean: float
    sd: float
    low: float
    high: float

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.low <= self.mean <= self.high:
            return
        # So far out that all is at one number, doubles cannot tell at which end of the range.
        with np.errstate(all="ignore"):
            rise = np.diff(self.ppf([_TAIL, 0.5, 1.0 - _TAIL]))
        if not np.all(rise > 0.0):
            raise ValueError(
                f"a {self.kind} distribution of mean {self.mean:g} and sd {self.sd:g} has no mass "
                f"from {self.low:g} to {self.high:g} that numbers can tell: choose a range nearer "
                "to the mean, or a larger sd"
            )

    def quantiles(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        a, b = (self.low - self.mean) / self.sd, (self.high - self.mean) / self.sd
        # In logarithms, and below the mean: far out in a tail nothing else is left of a quantile.
        # They are those of `scipy.stats.truncnorm`, which takes a second to import.
        if a < 0.0:
            x = ndtri_exp(_log_sum(log_ndtr(a), np.log(u) + _log_mass(a, b)))
        else:
            x = -ndtri_exp(_log_sum(log_ndtr(-b), np.log1p(-u) + _log_mass(a, b)))
        return _clipped(x * self.sd + self.mean, self.low, self.high)


@dataclass(frozen=True, kw_only=True)
class Triangular(Distribution):
    """A density that rises linearly from `low` to `mode` and falls to `high`."""

    kind: ClassVar[str] = "triangular"
    low: float
    mode: float
    high: float

    def __post_init__(self) -> None:
        super().__post_init__()
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
    positive: ClassVar[tuple[str, ...]] = ("low",)
    low: float
    high: float

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

    def _read(self, name: str, value: Any) -> Any:
        if (
            not isinstance(value, list | tuple)
            or not value
            or not all(map(is_finite_number, value))
        ):
            raise ValueError(f"{name} of a discrete distribution must be finite numbers")
        for one in value:
            self._check_size(name, one)
        return tuple(map(float, value))

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.values) < 2:
            raise ValueError("a discrete distribution needs two values or more")
        if len(self.values) != len(self.probabilities):
            raise ValueError("a discrete distribution needs a probability for every value")
        if any(a >= b for a, b in pairwise(self.values)):
            raise ValueError("values of a discrete distribution must rise")
        for probability in self.probabilities:
            self._check_positive("every probability", probability)
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


def scales(distributions: Mapping[str, Distribution]) -> dict[str, Scale]:
    """Return `Distribution.scale` of every factor: what the step of the paper's equation 22 is."""
    return {name: distribution.scale for name, distribution in distributions.items()}


def _log_mass(a: float, b: float) -> np.float64:
    """Return the logarithm of what the standard normal distribution holds from `a` to `b`."""
    if a <= 0.0 < b:
        return np.float64(log1p(-ndtr(a) - ndtr(-b)))
    if a > 0.0:
        a, b = -b, -a
    return np.float64(logsumexp([log_ndtr(b), log_ndtr(a) + np.pi * 1j]).real)


def _log_sum(p: float, q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the logarithm of the sum of what `p` and `q` are the logarithms of."""
    return np.asarray(logsumexp([np.full_like(q, p), q], axis=0), dtype=np.float64)


def _clipped(x: NDArray[np.float64], low: float, high: float) -> NDArray[np.float64]:
    """Return `x` within [low, high]; `np.clip` takes several times as long for a row's few."""
    return np.minimum(np.maximum(x, low), high)
