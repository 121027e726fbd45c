"""A wearer: the six factors of Table 1 as one record, and what the paper's figures scale with."""

from collections.abc import Mapping
from dataclasses import dataclass

from sim.parameters.factors import NOMINAL


@dataclass(frozen=True, kw_only=True)
class Wearer:
    """The arm of one person, in SI units: the factors of Table 1 and what its lengths are over."""

    upper_arm_length: float
    forearm_length: float
    upper_arm_mass: float
    forearm_mass: float
    upper_arm_elasticity: float
    forearm_elasticity: float
    nominal_upper_arm_length: float = NOMINAL["upper_arm_length"]
    nominal_forearm_length: float = NOMINAL["forearm_length"]

    @property
    def upper_arm_scale(self) -> float:
        """Upper arm length over that of the wearer whose elbow lies on the exoskeleton's."""
        return self.upper_arm_length / self.nominal_upper_arm_length

    @property
    def forearm_scale(self) -> float:
        """Forearm length over the nominal one."""
        return self.forearm_length / self.nominal_forearm_length


def wearer_of(values: Mapping[str, float]) -> Wearer:
    """Return the wearer with the factor `values`; a factor left out is nominal.

    Raises:
        ValueError: a name is not a factor of Table 1, or a value is not positive.
    """
    for name, value in values.items():
        if name not in NOMINAL:
            raise ValueError(f"the elbow has no factor {name!r}: it has {', '.join(NOMINAL)}")
        if not 0.0 < value < float("inf"):
            raise ValueError(f"factor {name} must be positive and finite, not {value}")
    return Wearer(**{**NOMINAL, **values})


NOMINAL_WEARER = wearer_of({})
