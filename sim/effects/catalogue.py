"""Every effect that a residual can be traced to, and those that an assessment can have."""

from collections.abc import Mapping
from types import MappingProxyType

from sim.effects.drive import (
    ActuatorLag,
    Drift,
    PositionOffset,
    TimeDelay,
    TorqueGain,
    TorqueOffset,
)
from sim.effects.effect import Effect
from sim.effects.elastic import EndRange, JointStiffness, NonlinearStiffness, Viscoelastic
from sim.effects.friction import (
    Asymmetric,
    Coulomb,
    LoadDependent,
    PositionDependent,
    Stribeck,
    Viscous,
)
from sim.effects.inertia import AddedInertia, Payload
from sim.effects.limb import CrossJointCoupling, StretchReflex, Thixotropy
from sim.effects.transmission import Backlash, Hysteresis, SeriesElasticity, TorqueRipple

#: Candidates for a residual, simplest first.
EFFECTS: tuple[Effect, ...] = (
    TorqueOffset(),
    Coulomb(),
    Viscous(),
    AddedInertia(),
    TorqueGain(),
    PositionOffset(),
    TimeDelay(),
    ActuatorLag(),
    JointStiffness(),
    Payload(),
    LoadDependent(),
    NonlinearStiffness(),
    SeriesElasticity(),
    Drift(),
    Hysteresis(),
    Backlash(),
    Thixotropy(),
    CrossJointCoupling(),
    Stribeck(),
    Asymmetric(),
    PositionDependent(),
    EndRange(),
    TorqueRipple(),
    StretchReflex(),
)
#: The declared impedance, which is no candidate.
VISCOELASTIC = Viscoelastic()
#: Every effect that a session may declare.
BY_NAME: Mapping[str, Effect] = MappingProxyType(
    {effect.name: effect for effect in (VISCOELASTIC, *EFFECTS)}
)
#: Effects that a simulated assessment can have, in the order of their factors.
ASSESSED: Mapping[str, Effect] = MappingProxyType(
    {
        name: BY_NAME[name]
        for name in (
            "coulomb_friction",
            "viscous_friction",
            "stribeck_friction",
            "asymmetric_friction",
            "load_dependent_friction",
            "position_dependent_friction",
            "torque_offset",
            "torque_gain",
            "added_inertia",
            "payload",
            "torque_ripple",
            "nonlinear_stiffness",
            "end_range_torque",
            "stretch_reflex",
        )
    }
)
