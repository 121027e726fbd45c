"""What is not in Table 1 but moves K_h as much: how the device is worn, driven and resisted."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from sim.parameters.effects import EFFECT_FACTORS, PREFIX, effects_of
from sim.parameters.factors import CONDITIONS, NOMINAL
from sim.parameters.wearer import Wearer, wearer_of
from sim.robot.control import Gains


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """The factors of `sim.parameters.factors.CONDITIONS`, in SI units."""

    activation: float
    cuff_friction: float
    strap_tension: float
    tissue_scale: float
    cuff_position: float
    cuff_compliance: float
    robot_friction: float
    movement_amplitude: float
    movement_rate: float
    proportional_gain: float
    derivative_gain: float
    integral_gain: float
    activation_rise: float
    reflex_gain: float
    reflex_threshold: float
    reflex_delay: float
    refitted_muscles: float
    tissue_coupling: float
    upper_cuff_position: float
    seat_angle: float
    nominal_upper_arm_length: float
    nominal_forearm_length: float
    extension_stop: float
    #: Undeclared effects that are on, with their parameters (`sim.parameters.effects`).
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def gains(self, own: Gains) -> Gains:
        """Return the controllers' gains on a device whose `own` these factors multiply."""
        return Gains(
            kp=self.proportional_gain * own.kp,
            kv=self.derivative_gain * own.kv,
            ki=self.integral_gain * own.ki,
        )


def conditions_of(values: Mapping[str, float]) -> Conditions:
    """Return the conditions with the given `values`; one left out takes its default.

    Raises:
        ValueError: a value is outside what the simulation can mean.
    """
    effects = effects_of({n: value for n, value in values.items() if n.startswith(PREFIX)})
    chosen = {factor.name: factor.nominal for factor in CONDITIONS}
    chosen |= {n: value for n, value in values.items() if not n.startswith(PREFIX)}
    for name, low, high in (
        ("activation", 0.0, 1.0),
        ("cuff_friction", 0.0, 2.0),
        ("strap_tension", 0.0, 200.0),
        ("tissue_scale", 0.01, 10.0),
        ("cuff_position", -0.05, 0.05),
        ("cuff_compliance", 0.0, 1.0),
        ("robot_friction", 0.0, 30.0),
        ("movement_amplitude", 0.05, 2.0),
        ("movement_rate", 0.1, 10.0),
        ("proportional_gain", 0.0, 20.0),
        ("derivative_gain", 0.0, 20.0),
        ("integral_gain", 0.0, 20.0),
        ("activation_rise", -1.0, 5.0),
        ("reflex_gain", 0.0, 10.0),
        ("reflex_threshold", 0.0, 20.0),
        ("reflex_delay", 0.0, 1.0),
        ("refitted_muscles", 0.0, 1.0),
        ("tissue_coupling", 0.0, 10.0),
        ("upper_cuff_position", -0.05, 0.05),
        ("seat_angle", -0.7, 0.25),
        ("nominal_upper_arm_length", 0.2, 0.6),
        ("nominal_forearm_length", 0.2, 0.6),
        ("extension_stop", 0.0, 1000.0),
    ):
        if not low <= chosen[name] <= high:
            raise ValueError(f"{name} must lie between {low:g} and {high:g}, not {chosen[name]}")
    return Conditions(**chosen, effects=effects)


def split(values: Mapping[str, float]) -> tuple[Wearer, Conditions]:
    """Return the wearer and the conditions that `values` (factor name to SI value) describe.

    Raises:
        ValueError: a name is no factor of the elbow, or a value means nothing.
    """
    known = {factor.name for factor in (*CONDITIONS, *EFFECT_FACTORS)}
    for name in values:
        if name not in NOMINAL and name not in known:
            raise ValueError(
                f"the elbow has no factor {name!r}: it has "
                f"{', '.join((*NOMINAL, *(factor.name for factor in CONDITIONS)))} "
                "and effect.NAME.PARAMETER"
            )
    conditions = conditions_of({name: value for name, value in values.items() if name in known})
    wearer = replace(
        wearer_of({name: value for name, value in values.items() if name in NOMINAL}),
        nominal_upper_arm_length=conditions.nominal_upper_arm_length,
        nominal_forearm_length=conditions.nominal_forearm_length,
    )
    return wearer, conditions


DEFAULT_CONDITIONS = conditions_of({})
