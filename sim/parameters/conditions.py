"""What is not in Table 1 but moves K_h as much: how the device is worn, driven and resisted."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from models.factors import Factor, check_bounds, no_factor
from sim.parameters.effects import PREFIX, effect_factors, effects_of
from sim.parameters.factors import choice, factor, factors_of
from sim.parameters.wearer import NOMINAL, NOMINAL_LENGTHS, TABLE_1, Wearer, wearer_of

#: With it the compression test encloses the moduli of the paper's figure 6 from 10 to 20 % strain.
TISSUE_COUPLING = 0.17

#: The elbow's muscles by name (`sim.body.muscles.elbow`).
MUSCLES = ("paper", "holzbaur2005", "physiological")

Range = tuple[float, float]


def _condition(unit: str, nominal: float, study: Range, bounds: Range, description: str) -> Any:
    return factor(unit, nominal, study, description, bounds=bounds, optional=True)


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """Unit, nominal value, range that a lab may meet, bounds and meaning of each condition."""

    # The authors' code.
    activation: float = _condition(
        "1", 0.4, (0.2, 0.5), (0.0, 1.0), "co-contraction of the joint's muscles"
    )
    # On living skin 0.46 with a standard deviation of 0.15 (Zhang and Mak 1999).
    cuff_friction: float = _condition(
        "1", 0.5, (0.3, 0.8), (0.0, 2.0), "Coulomb friction of cuff and strap on the arm"
    )
    # Ours: the arm stays in its cuffs.
    strap_tension: float = _condition(
        "N", 30.0, (15.0, 60.0), (0.0, 200.0), "tension each strap is closed with"
    )
    tissue_scale: float = _condition(
        "1", 1.0, (0.2, 1.0), (0.01, 10.0), "stiffness and viscosity of all tissue"
    )
    cuff_position: float = _condition(
        "m", 0.0, (-0.02, 0.02), (-0.05, 0.05), "forearm cuff, from its place towards the hand"
    )
    cuff_compliance: float = _condition(
        "m/N", 0.0, (0.0, 0.002), (0.0, 1.0), "forearm cuff on a slide along the forearm"
    )
    robot_friction: float = _condition(
        "Nm", 0.0, (0.0, 3.0), (0.0, 30.0), "Coulomb friction of the joint, undeclared"
    )
    movement_amplitude: float = _condition(
        "rad", 1.7453292519943295, (1.2, 1.75), (0.05, 2.0), "range of the movement"
    )
    movement_rate: float = _condition("1/s", 2.0, (1.5, 3.0), (0.1, 10.0), "rate of the sigmoid")
    proportional_gain: float = _condition(
        "1", 1.0, (0.5, 4.0), (0.0, 20.0), "the controller's, over the device's own"
    )
    derivative_gain: float = _condition(
        "1", 1.0, (0.5, 2.0), (0.0, 20.0), "the controller's, over the device's own"
    )
    integral_gain: float = _condition(
        "1", 1.0, (0.0, 8.0), (0.0, 20.0), "the controller's; 0: equation 19"
    )
    activation_rise: float = _condition(
        "1", 0.0, (-0.5, 0.5), (-1.0, 5.0), "activation gained by the movement's end, as a share"
    )
    reflex_gain: float = _condition(
        "s/rad", 0.0, (0.0, 0.4), (0.0, 10.0), "activation of a stretch reflex per excess velocity"
    )
    reflex_threshold: float = _condition(
        "rad/s", 0.5, (0.25, 0.75), (0.0, 20.0), "velocity at which the reflex begins"
    )
    reflex_delay: float = _condition(
        "s", 0.05, (0.02, 0.1), (0.0, 1.0), "from stretch to the muscles' input"
    )
    muscles: float = choice(
        MUSCLES, "paper", "the elbow's: the paper's (0), as published (1), fitted to figure 3 (2)"
    )
    tissue_coupling: float = _condition(
        "1",
        TISSUE_COUPLING,
        (0.0, 1.0),
        (0.0, 10.0),
        "springs between tissue elements, over their own",
    )
    upper_cuff_position: float = _condition(
        "m", 0.0, (-0.02, 0.02), (-0.05, 0.05), "upper arm cuff, moved towards the elbow"
    )
    seat_angle: float = _condition(
        "rad",
        0.0,
        (-0.35, 0.1),
        (-0.7, 0.25),
        "robot's elbow when the straps were closed, from start",
    )
    nominal_upper_arm_length: float = _condition(
        "m",
        NOMINAL_LENGTHS[0],
        (0.3337, 0.3637),
        (0.2, 0.6),
        "at this length the human elbow lies on the robot's axis",
    )
    nominal_forearm_length: float = _condition(
        "m", NOMINAL_LENGTHS[1], (0.319, 0.349), (0.2, 0.6), "length of the forearm as it is drawn"
    )
    elbow_offset: float = _condition(
        "m",
        0.0,
        (-0.01, 0.01),
        (-0.05, 0.05),
        "human elbow above the robot's axis, lengths nominal",
    )
    # Ours: long heavy arms do not hyperextend.
    extension_stop: float = _condition(
        "Nm/rad", 30.0, (0.0, 60.0), (0.0, 1000.0), "passive stiffness of the elbow below 5 degrees"
    )
    # What a patient's limb is beside its muscles' paths: a study of patients varies these.
    muscle_strength: float = _condition(
        "1", 1.0, (0.4, 1.6), (0.01, 10.0), "peak force of the elbow's muscles, over the set's own"
    )
    passive_stiffness: float = _condition(
        "Nm/rad", 0.0, (0.0, 10.0), (0.0, 100.0), "spring of the human elbow beside its muscles"
    )
    passive_damping: float = _condition(
        "Nm s/rad", 0.0, (0.0, 1.5), (0.0, 100.0), "damper of the human elbow beside its own"
    )
    # Wiegner and Watts 1986, n = 19.
    neutral_angle: float = _condition(
        "rad", 1.8675, (1.52, 2.22), (0.0, 3.14), "where that spring is slack"
    )
    #: Undeclared effects that are on, with their parameters (`sim.parameters.effects`).
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


#: Not in the paper's Table 1, at their nominal values unless a study asks for others.
CONDITIONS: tuple[Factor, ...] = factors_of(Conditions)
#: Those that only explicit contact has.
CONTACT_ONLY = ("cuff_friction", "strap_tension", "tissue_coupling")
DEFAULT_CONDITIONS = Conditions()


def conditions_of(values: Mapping[str, float]) -> Conditions:
    """Return the conditions with the given `values` (numbers); one left out takes its default.

    Raises:
        ValueError: a value is outside what the simulation can mean.
    """
    effects = effects_of({n: value for n, value in values.items() if n.startswith(PREFIX)})
    own = {n: value for n, value in values.items() if not n.startswith(PREFIX)}
    check_bounds(CONDITIONS, own)
    return Conditions(**own, effects=effects)


def split(values: Mapping[str, float | str]) -> tuple[Wearer, Conditions]:
    """Return the wearer and the conditions that `values` (factor name to SI value) describe.

    The value of a choice (`muscles`) may be its name.

    Raises:
        ValueError: a name is no factor of the elbow, or a value means nothing.
    """
    known = {factor.name: factor for factor in (*TABLE_1, *CONDITIONS, *effect_factors())}
    for name in values:
        if name not in known:
            own = (*NOMINAL, *(factor.name for factor in CONDITIONS), "effect.NAME.PARAMETER")
            raise ValueError(no_factor("the elbow", name, own))
    numbers = {name: known[name].number(value) for name, value in values.items()}
    of_wearer = {name: value for name, value in numbers.items() if name in NOMINAL}
    conditions = conditions_of({n: value for n, value in numbers.items() if n not in NOMINAL})
    wearer = replace(
        wearer_of(of_wearer),
        nominal_upper_arm_length=conditions.nominal_upper_arm_length,
        nominal_forearm_length=conditions.nominal_forearm_length,
        elbow_offset=conditions.elbow_offset,
    )
    return wearer, conditions
