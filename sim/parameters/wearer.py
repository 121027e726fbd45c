"""A wearer: the six factors of the paper's Table 1, and what the paper's figures scale with.

The paper states two nominal wearers: section 2.2.1 gives 36.37 cm and 34.9 cm for the upper arm and
the forearm, section 2.3 gives 33.37 cm and 31.9 cm. We take section 2.3's lengths as nominal,
because that is the wearer the nominal model of equation 20 describes, and read Table 1's lengths
literally: each is a deviation from a wearer whose joints coincide with the exoskeleton's.

Section 2.2.1's masses, 2.25 kg and 1.31 kg, include the soft tissue at the attachments (0.489 kg
and 0.351 kg). Table 1 starts at 0.3 kg and 0.1 kg and is centred on 1.86 kg and 0.96 kg, so it
varies what remains beside that tissue: nominally 1.761 kg and 0.962 kg.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf

from models.factors import Factor, check_bounds
from sim.parameters.factors import factor, factors_of

#: Lengths of upper arm and forearm of the paper's section 2.3, m.
NOMINAL_LENGTHS = (0.3337, 0.3190)


#: MuJoCo builds no arm that is much shorter or lighter: bones of 1 um lie "too close" to a point.
_BOUNDS = (1e-3, inf)


@dataclass(frozen=True, kw_only=True)
class Wearer:
    """The arm of one person, in SI units: the factors of Table 1 and what its lengths are over."""

    upper_arm_length: float = factor(
        "m",
        NOMINAL_LENGTHS[0],
        (0.2728, 0.3778),
        "shoulder to elbow; differs from the exoskeleton's link by a joint offset",
        bounds=_BOUNDS,
    )
    forearm_length: float = factor(
        "m",
        NOMINAL_LENGTHS[1],
        (0.2827, 0.3455),
        "elbow to wrist; moves muscle insertions and the tissue in its cuff",
        bounds=_BOUNDS,
    )
    upper_arm_mass: float = factor(
        "kg",
        1.761,
        (0.3, 3.41),
        "mass of the upper arm beside the 0.489 kg of tissue in the cuff",
        bounds=_BOUNDS,
    )
    forearm_mass: float = factor(
        "kg",
        0.962,
        (0.1, 1.82),
        "mass of the forearm beside the 0.351 kg of tissue in the cuff and the hand",
        bounds=_BOUNDS,
    )
    upper_arm_elasticity: float = factor(
        "N/m",
        537.465,
        (100.5, 974.43),
        "stiffness of one element of the upper arm's soft tissue",
        bounds=_BOUNDS,
    )
    forearm_elasticity: float = factor(
        "N/m",
        537.465,
        (100.5, 974.43),
        "stiffness of one element of the forearm's soft tissue",
        bounds=_BOUNDS,
    )
    nominal_upper_arm_length: float = NOMINAL_LENGTHS[0]
    nominal_forearm_length: float = NOMINAL_LENGTHS[1]
    #: How far the elbow's axis lies above the robot's at the nominal length, m.
    elbow_offset: float = 0.0

    @property
    def upper_arm_scale(self) -> float:
        """Upper arm length over that of the wearer whose elbow lies on the exoskeleton's."""
        return self.upper_arm_length / self.nominal_upper_arm_length

    @property
    def forearm_scale(self) -> float:
        """Forearm length over the nominal one."""
        return self.forearm_length / self.nominal_forearm_length


#: Paper, Table 1.
TABLE_1: tuple[Factor, ...] = factors_of(Wearer)
#: Other ranges of the lengths by name: "aligned10" is the authors' code, "aligned" has no range.
RANGES: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "table_1": {},
    "aligned10": {f.name: (0.9 * f.nominal, 1.1 * f.nominal) for f in TABLE_1[:2]},
    "aligned": {f.name: (f.nominal, f.nominal) for f in TABLE_1[:2]},
}
NOMINAL: Mapping[str, float] = {factor.name: factor.nominal for factor in TABLE_1}
NOMINAL_WEARER = Wearer()


def wearer_of(values: Mapping[str, float]) -> Wearer:
    """Return the wearer with the factor `values`; a factor left out is nominal.

    Raises:
        ValueError: a name is not a factor of Table 1, or a value is not positive or far too small.
    """
    for name, value in values.items():
        if name not in NOMINAL:
            raise ValueError(f"the elbow has no factor {name!r}: it has {', '.join(NOMINAL)}")
        if not 0.0 < value < float("inf"):
            raise ValueError(f"factor {name} must be positive and finite, not {value}")
    check_bounds(TABLE_1, values)
    return Wearer(**values)
