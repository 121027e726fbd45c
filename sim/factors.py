"""The six uncertain factors of the paper's Table 1, with the nominal wearer made consistent.

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


#: Paper, Table 1.
TABLE_1: tuple[Factor, ...] = (
    Factor(
        name="upper_arm_length",
        unit="m",
        low=0.2728,
        high=0.3778,
        nominal=0.3337,
        description="shoulder to elbow; differs from the exoskeleton's link by a joint offset",
    ),
    Factor(
        name="forearm_length",
        unit="m",
        low=0.2827,
        high=0.3455,
        nominal=0.3190,
        description="elbow to wrist; moves muscle insertions and the tissue in its cuff",
    ),
    Factor(
        name="upper_arm_mass",
        unit="kg",
        low=0.3,
        high=3.41,
        nominal=1.761,
        description="mass of the upper arm beside the 0.489 kg of tissue in the cuff",
    ),
    Factor(
        name="forearm_mass",
        unit="kg",
        low=0.1,
        high=1.82,
        nominal=0.962,
        description="mass of the forearm beside the 0.351 kg of tissue in the cuff and the hand",
    ),
    Factor(
        name="upper_arm_elasticity",
        unit="N/m",
        low=100.5,
        high=974.43,
        nominal=537.465,
        description="stiffness of one element of the upper arm's soft tissue",
    ),
    Factor(
        name="forearm_elasticity",
        unit="N/m",
        low=100.5,
        high=974.43,
        nominal=537.465,
        description="stiffness of one element of the forearm's soft tissue",
    ),
)

NOMINAL: Mapping[str, float] = {factor.name: factor.nominal for factor in TABLE_1}
