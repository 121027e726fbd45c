"""Every effect that a residual can be traced to, and those that an assessment can have."""

from collections.abc import Mapping
from types import MappingProxyType

from sim.effects.effect import Effect
from sim.effects.laws import (
    backlash,
    coupling,
    drive,
    elastic,
    ends,
    friction,
    inertia,
    limb,
    load_friction,
    loose_link,
    reflexes,
    relaxation,
    transmission,
)

#: Candidates for a residual, simplest first.
EFFECTS: tuple[Effect, ...] = (
    drive.TorqueOffset(),
    friction.Coulomb(),
    friction.Viscous(),
    inertia.AddedInertia(),
    drive.TorqueGain(),
    drive.PositionOffset(),
    inertia.GravityTorque(),
    drive.TimeDelay(),
    drive.ActuatorLag(),
    elastic.JointStiffness(),
    relaxation.StressRelaxation(),
    inertia.Payload(),
    load_friction.LoadDependent(),
    elastic.NonlinearStiffness(),
    loose_link.SeriesElasticity(),
    drive.Drift(),
    transmission.Hysteresis(),
    backlash.Backlash(),
    limb.Thixotropy(),
    coupling.CrossJointCoupling(),
    coupling.CoupledMotor(),
    friction.Stribeck(),
    friction.Asymmetric(),
    load_friction.DirectionalLoad(),
    load_friction.QuadraticLoad(),
    friction.PositionDependent(),
    ends.EndRange(),
    elastic.SofteningStiffness(),
    ends.BothEnds(),
    transmission.TorqueRipple(),
    limb.ThixotropicStiffness(),
    reflexes.StretchReflex(),
    reflexes.BothReflexes(),
    load_friction.StribeckLoad(),
)
#: Asked of robots in the place of a limb's effect of the same name.
OF_ROBOTS: tuple[Effect, ...] = (elastic.HardeningSpring(),)
#: Name of what all links share, which is asked of no single joint.
LINK_INERTIA = inertia.LinkInertia.name
#: The declared impedance, which is no candidate.
VISCOELASTIC = elastic.Viscoelastic()
#: Every effect that a session may declare.
BY_NAME: Mapping[str, Effect] = MappingProxyType(
    {effect.name: effect for effect in (VISCOELASTIC, *EFFECTS)}
)
_ORDER = """
coulomb_friction viscous_friction stribeck_friction asymmetric_friction load_dependent_friction
position_dependent_friction torque_offset torque_gain added_inertia payload torque_ripple
nonlinear_stiffness end_range_torque stretch_reflex
"""
#: Effects that a simulated assessment can have, in the order of their factors.
ASSESSED: Mapping[str, Effect] = MappingProxyType({name: BY_NAME[name] for name in _ORDER.split()})


def law_of(name: str, *, of_limb: bool) -> Effect:
    """Return the effect that a session means by a name, at a limb's joint or at a robot's own."""
    own = () if of_limb else OF_ROBOTS
    return next((effect for effect in own if effect.name == name), BY_NAME[name])
