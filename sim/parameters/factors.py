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
    #: Whether a study samples it only if told to.
    optional: bool = False


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


def _condition(
    name: str, unit: str, low: float, high: float, nominal: float, description: str
) -> Factor:
    return Factor(
        name=name,
        unit=unit,
        low=low,
        high=high,
        nominal=nominal,
        description=description,
        optional=True,
    )


#: With it the compression test encloses the moduli of the paper's figure 6 from 10 to 20 % strain.
TISSUE_COUPLING = 0.17

#: Not in the paper's Table 1, at these values unless a study asks for others. Ranges are what a lab
#: may meet.
CONDITIONS: tuple[Factor, ...] = (
    _condition("activation", "1", 0.2, 0.5, 0.4, "co-contraction of the joint's muscles"),
    _condition(
        "cuff_friction", "1", 0.3, 0.8, 0.5, "Coulomb friction of cuff and strap on the arm"
    ),
    _condition("strap_tension", "N", 15.0, 60.0, 30.0, "tension each strap is closed with"),
    _condition("tissue_scale", "1", 0.2, 1.0, 1.0, "stiffness and viscosity of all tissue"),
    _condition(
        "cuff_position", "m", -0.02, 0.02, 0.0, "forearm cuff, from its place towards the hand"
    ),
    _condition(
        "cuff_compliance", "m/N", 0.0, 0.002, 0.0, "forearm cuff on a slide along the forearm"
    ),
    _condition("robot_friction", "Nm", 0.0, 3.0, 0.0, "Coulomb friction of the joint, undeclared"),
    _condition("movement_amplitude", "rad", 1.2, 1.75, 1.7453292519943295, "range of the movement"),
    _condition("movement_rate", "1/s", 1.5, 3.0, 2.0, "rate of the sigmoid"),
    _condition("proportional_gain", "1", 0.5, 4.0, 1.0, "the controller's, over the device's own"),
    _condition("derivative_gain", "1", 0.5, 2.0, 1.0, "the controller's, over the device's own"),
    _condition("integral_gain", "1", 0.0, 8.0, 1.0, "the controller's; 0: equation 19"),
    _condition(
        "activation_rise",
        "1",
        -0.5,
        0.5,
        0.0,
        "activation gained by the movement's end, as a share",
    ),
    _condition(
        "reflex_gain", "s/rad", 0.0, 0.4, 0.0, "activation of a stretch reflex per excess velocity"
    ),
    _condition("reflex_threshold", "rad/s", 0.25, 0.75, 0.5, "velocity at which the reflex begins"),
    _condition("reflex_delay", "s", 0.02, 0.1, 0.05, "from stretch to the muscles' input"),
    _condition(
        "refitted_muscles", "1", 0.0, 1.0, 1.0, "0: the paper's; from 0.5: refitted to its figure 3"
    ),
    _condition(
        "tissue_coupling",
        "1",
        0.0,
        1.0,
        TISSUE_COUPLING,
        "springs between tissue elements, over their own",
    ),
    _condition(
        "upper_cuff_position", "m", -0.02, 0.02, 0.0, "upper arm cuff, moved towards the elbow"
    ),
    _condition(
        "seat_angle",
        "rad",
        -0.35,
        0.1,
        0.0,
        "robot's elbow when the straps were closed, from start",
    ),
    _condition(
        "nominal_upper_arm_length",
        "m",
        0.3337,
        0.3637,
        NOMINAL["upper_arm_length"],
        "at this length the human elbow lies on the robot's axis",
    ),
    _condition(
        "nominal_forearm_length",
        "m",
        0.319,
        0.349,
        NOMINAL["forearm_length"],
        "length of the forearm as it is drawn",
    ),
    _condition(
        "extension_stop",
        "Nm/rad",
        0.0,
        60.0,
        30.0,
        "passive stiffness of the elbow below 5 degrees",
    ),
)
