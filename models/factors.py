"""Factors: the uncertain inputs of a model."""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from math import inf, ulp
from types import MappingProxyType

#: Factors that no longer exist, each with what to write instead.
REPLACED: Mapping[str, str] = MappingProxyType(
    {
        "refitted_muscles": (
            "write muscles=paper for refitted_muscles=0, and muscles=physiological for 1"
        )
    }
)

#: So many values of a range can numbers tell apart at least; of fewer, a factor's effect would be
#: that of rounding.
FEWEST_VALUES = 1000


@dataclass(frozen=True, kw_only=True)
class Factor:
    """One uncertain input: its name, unit, range and nominal value."""

    name: str
    #: SI unit symbol; "1" if dimensionless.
    unit: str
    low: float
    high: float
    nominal: float
    description: str
    #: Closed interval outside which the value means nothing.
    bounds: tuple[float, float] = (-inf, inf)
    #: Whether a study samples it only if told to.
    optional: bool = False
    #: Names of its values if it is a choice: the value is a name's number, from 0.
    choices: tuple[str, ...] = ()

    @property
    def reach(self) -> tuple[float, float]:
        """Lowest and highest value that is not far outside its range.

        A range may be left by its own width, and a quantity that is positive throughout is at most
        halved or doubled. It may always be nominal, and what is optional off (0).
        """
        if self.choices:
            return self.bounds
        width = self.high - self.low
        low, high = self.low - width, self.high + width
        if self.low > 0.0:
            low, high = max(low, 0.5 * self.low), min(high, 2.0 * self.high)
        low, high = min(low, self.nominal), max(high, self.nominal)
        if self.optional:
            low, high = min(low, 0.0), max(high, 0.0)
        return max(low, self.bounds[0]), min(high, self.bounds[1])

    def check_reach(self, *values: float) -> None:
        """Raise ValueError, with the range, if a value is far outside that of this factor."""
        low, high = self.reach
        for value in values:
            if not low <= value <= high:
                unit = "" if self.unit == "1" else f" {self.unit}"
                raise ValueError(
                    f"{self.name} is {value:g}{unit}, far outside {self.low:g} to {self.high:g}, "
                    f"for which the model was validated: take {low:g} to {high:g}"
                )

    def number(self, value: float | str) -> float:
        """Return a value as a number; that of a choice may be told by its name.

        Raises:
            ValueError: it is no number, or no name of this choice.
        """
        if not isinstance(value, str):
            return float(value)
        if value in self.choices:
            return float(self.choices.index(value))
        if not self.choices:
            raise ValueError(f"{self.name} must be a number, not {value!r}")
        with suppress(ValueError):
            if float(value).is_integer():
                return float(value)
        raise ValueError(f"{self.name} must be {_one_of(self.choices)}, not {value!r}")


#: What decides the random numbers of a model that is not deterministic: a study samples it like a
#: factor, so that its total-order index is the share of the variance that is the model's own noise.
SEED = Factor(
    name="seed",
    unit="1",
    low=0.0,
    high=2.0**32,
    nominal=0.0,
    description="decides the model's random numbers",
    bounds=(0.0, 2.0**32),
)


def narrowest(*ends: float) -> float:
    """Return how wide a range with such ends must be, for numbers to tell enough values apart."""
    return FEWEST_VALUES * ulp(max(map(abs, ends)))


def no_factor(whose: str, name: str, known: Iterable[str]) -> str:
    """Return the sentence for a factor that does not exist: what to write instead, or all names."""
    if name in REPLACED:
        return f"{whose} no longer has the factor {name!r}: {REPLACED[name]}"
    return f"{whose} has no factor {name!r}: it has {', '.join(known)}"


def check_bounds(factors: tuple[Factor, ...], values: Mapping[str, float]) -> None:
    """Raise ValueError if a value lies outside its factor's bounds."""
    for factor in factors:
        low, high = factor.bounds
        value = values.get(factor.name, factor.nominal)
        if not low <= value <= high:
            raise ValueError(f"{factor.name} must {_within(low, high)}, not {value}")
        if factor.choices and value != int(value):
            raise ValueError(
                f"{factor.name} must be {_one_of(factor.choices)}, or a number of these from 0, "
                f"not {value}"
            )


def _within(low: float, high: float) -> str:
    if high == inf:
        return f"be at least {low:g}"
    return f"be at most {high:g}" if low == -inf else f"lie between {low:g} and {high:g}"


def _one_of(names: tuple[str, ...]) -> str:
    return f"{', '.join(names[:-1])} or {names[-1]}"
