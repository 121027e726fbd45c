"""Effects that the simulated arm or robot has and the nominal model lacks, as factors of a study.

What closing the loop finds in measured trials goes back into the simulated assessment under its
name: the parameter PARAM of the effect NAME is the factor `effect.NAME.PARAM`. Nothing here imports
MuJoCo; `sim.effects.carried` puts the effects into a model.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, isfinite
from types import MappingProxyType

from sim.parameters.factors import Factor

PREFIX = "effect."


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One parameter of an effect."""

    unit: str
    #: Range of a study that names none.
    low: float
    high: float
    #: Value without the effect, or a harmless one if the effect is off by another parameter.
    neutral: float
    description: str
    #: Whether the effect is off while this parameter (and its like) is neutral.
    switches: bool = False
    #: Closed interval outside which the value means nothing.
    floor: float = -inf
    ceiling: float = inf


@dataclass(frozen=True, kw_only=True)
class Undeclared:
    """One effect: whose joint it acts on, and its parameters."""

    #: "robot" or "human".
    owner: str
    parameters: Mapping[str, Parameter] = field(default_factory=dict)


def _size(unit: str, high: float, description: str, *, low: float = 0.0) -> Parameter:
    """Return a parameter that switches its effect and cannot change sign if `low` is 0."""
    floor = 0.0 if low >= 0.0 else -inf
    return Parameter(
        unit=unit,
        low=low,
        high=high,
        neutral=0.0,
        description=description,
        switches=True,
        floor=floor,
    )


_SIDE = Parameter(
    unit="1", low=-1.0, high=1.0, neutral=1.0, description="+1 acts in flexion, -1 in extension"
)
#: Beyond any angle: the reflex has no threshold angle.
NO_ANGLE = -100.0

UNDECLARED: Mapping[str, Undeclared] = MappingProxyType(
    {
        "coulomb_friction": Undeclared(
            owner="robot",
            parameters={"torque": _size("Nm", 3.0, "friction of the robot's joint")},
        ),
        "viscous_friction": Undeclared(
            owner="robot",
            parameters={"damping": _size("Nm s/rad", 2.0, "further damping of the robot's joint")},
        ),
        "stribeck_friction": Undeclared(
            owner="robot",
            parameters={
                "torque": _size("Nm", 3.0, "friction of the robot's joint when fast"),
                "breakaway_excess": _size("Nm", 2.0, "how much more of it there is when slow"),
                "stribeck_velocity": Parameter(
                    unit="rad/s",
                    low=0.02,
                    high=0.5,
                    neutral=0.1,
                    description="speed at which the excess is lost",
                    floor=1e-3,
                ),
            },
        ),
        "asymmetric_friction": Undeclared(
            owner="robot",
            parameters={
                "torque_positive": _size("Nm", 3.0, "friction of the robot's joint in flexion"),
                "torque_negative": _size("Nm", 3.0, "its friction in extension"),
                "viscous_difference": _size(
                    "Nm s/rad", 1.0, "damping in flexion less that in extension", low=-1.0
                ),
            },
        ),
        "load_dependent_friction": Undeclared(
            owner="robot",
            parameters={
                "torque": _size("Nm", 3.0, "friction of the robot's joint without load"),
                "load_share": _size("1", 0.3, "further friction over the motor's torque"),
            },
        ),
        "position_dependent_friction": Undeclared(
            owner="robot",
            parameters={
                "torque_middle": _size("Nm", 3.0, "friction in the middle of the range"),
                "torque_slope": _size("Nm/rad", 1.0, "its slope over the angle", low=-1.0),
                "torque_curvature": _size("Nm/rad2", 1.0, "its curvature", low=-1.0),
                "middle": Parameter(
                    unit="rad", low=0.5, high=1.5, neutral=1.0, description="middle of the range"
                ),
            },
        ),
        "torque_offset": Undeclared(
            owner="robot",
            parameters={"torque": _size("Nm", 2.0, "what the motor must add", low=-2.0)},
        ),
        "torque_gain": Undeclared(
            owner="robot",
            parameters={
                "gain": Parameter(
                    unit="1",
                    low=0.8,
                    high=1.2,
                    neutral=1.0,
                    description="torque at the joint over the torque reported",
                    switches=True,
                    floor=0.2,
                    ceiling=5.0,
                )
            },
        ),
        "added_inertia": Undeclared(
            owner="robot",
            parameters={
                "inertia": Parameter(
                    unit="kg m2",
                    low=0.0,
                    high=0.1,
                    neutral=0.0,
                    description="further inertia of the robot's joint",
                    switches=True,
                    floor=-0.14,
                )
            },
        ),
        "payload": Undeclared(
            owner="robot",
            parameters={
                "mass": Parameter(
                    unit="kg",
                    low=0.0,
                    high=1.0,
                    neutral=0.0,
                    description="mass on the robot's link",
                    switches=True,
                    floor=-0.45,
                ),
                "distance": Parameter(
                    unit="m",
                    low=0.05,
                    high=0.3,
                    neutral=0.1,
                    description="its distance from the joint, towards the link's centre of mass",
                    floor=0.0,
                    ceiling=2.0,
                ),
            },
        ),
        "torque_ripple": Undeclared(
            owner="robot",
            parameters={
                "cosine": _size("Nm", 1.0, "ripple, cosine part", low=-1.0),
                "sine": _size("Nm", 1.0, "ripple, sine part", low=-1.0),
                "order": Parameter(
                    unit="1", low=1.0, high=40.0, neutral=12.0, description="periods a turn"
                ),
            },
        ),
        "nonlinear_stiffness": Undeclared(
            owner="human",
            parameters={
                "cubic_stiffness": _size("Nm/rad3", 5.0, "hardening of the limb's joint", low=-5.0),
                "centre": Parameter(
                    unit="rad", low=0.5, high=1.5, neutral=1.0, description="angle without torque"
                ),
            },
        ),
        "end_range_torque": Undeclared(
            owner="human",
            parameters={
                "stiffness": _size("Nm/rad", 20.0, "steepness (Nm/rad2 or Nm by the power)"),
                "onset": Parameter(
                    unit="rad", low=0.2, high=1.8, neutral=1.5, description="angle where it begins"
                ),
                "side": _SIDE,
                "power": Parameter(
                    unit="1",
                    low=0.0,
                    high=2.0,
                    neutral=1.0,
                    description="1 or 2; 0 stands for an exponential",
                    floor=0.0,
                    ceiling=4.0,
                ),
                "width": Parameter(
                    unit="rad",
                    low=0.1,
                    high=0.5,
                    neutral=0.3,
                    description="width of the exponential",
                    floor=0.01,
                ),
            },
        ),
        "stretch_reflex": Undeclared(
            owner="human",
            parameters={
                "gain": _size("Nm s/rad", 5.0, "torque against a stretch beyond the threshold"),
                "threshold_velocity": Parameter(
                    unit="rad/s",
                    low=0.0,
                    high=2.0,
                    neutral=0.5,
                    description="speed of stretch beyond which it acts",
                    floor=0.0,
                ),
                "threshold_angle": Parameter(
                    unit="rad",
                    low=0.2,
                    high=1.8,
                    neutral=NO_ANGLE,
                    description=f"angle beyond which it acts; {NO_ANGLE:g} for every angle",
                ),
                "delay": Parameter(
                    unit="s",
                    low=0.0,
                    high=0.1,
                    neutral=0.0,
                    description="time from stretch to torque",
                    floor=0.0,
                    ceiling=0.5,
                ),
                "side": _SIDE,
            },
        ),
    }
)


def _factors() -> tuple[Factor, ...]:
    return tuple(
        Factor(
            name=f"{PREFIX}{effect}.{name}",
            unit=parameter.unit,
            low=parameter.low,
            high=parameter.high,
            nominal=parameter.neutral,
            description=f"{effect}: {parameter.description}",
            optional=True,
        )
        for effect, undeclared in UNDECLARED.items()
        for name, parameter in undeclared.parameters.items()
    )


#: Every parameter of every effect; off unless a study asks for it.
EFFECT_FACTORS = _factors()


def effects_of(values: Mapping[str, float]) -> Mapping[str, Mapping[str, float]]:
    """Return the effects that are on, each with all its parameters.

    Args:
        values: `effect.NAME.PARAM` to value (SI units); one left out is neutral.

    Raises:
        ValueError: a name is unknown, or a value means nothing.
    """
    nominal = {factor.name: factor.nominal for factor in EFFECT_FACTORS}
    for name in values:
        if name not in nominal:
            raise ValueError(
                f"there is no effect factor {name!r}: take effect.NAME.PARAMETER with NAME one of "
                f"{', '.join(UNDECLARED)}"
            )
    found: dict[str, Mapping[str, float]] = {}
    for effect, undeclared in UNDECLARED.items():
        own = {
            name: float(values.get(f"{PREFIX}{effect}.{name}", parameter.neutral))
            for name, parameter in undeclared.parameters.items()
        }
        for name, parameter in undeclared.parameters.items():
            if not isfinite(own[name]) or not parameter.floor <= own[name] <= parameter.ceiling:
                raise ValueError(
                    f"{PREFIX}{effect}.{name} must be finite, at least {parameter.floor:g} and at "
                    f"most {parameter.ceiling:g}, not {own[name]:g}"
                )
        if any(own[name] != p.neutral for name, p in undeclared.parameters.items() if p.switches):
            found[effect] = MappingProxyType(own)
    return MappingProxyType(found)
