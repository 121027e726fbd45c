"""The catalogue: every effect that a residual can be traced to, simplest first."""

from analysis.closeloop.catalogue.actuator import (
    ActuatorLag,
    Drift,
    PositionOffset,
    TimeDelay,
    TorqueGain,
    TorqueOffset,
    TorqueRipple,
)
from analysis.closeloop.catalogue.effect import Candidate, Effect
from analysis.closeloop.catalogue.elastic import EndRange, JointStiffness, NonlinearStiffness
from analysis.closeloop.catalogue.friction import (
    Asymmetric,
    Coulomb,
    LoadDependent,
    PositionDependent,
    Stribeck,
    Viscous,
)
from analysis.closeloop.catalogue.inertia import AddedInertia, Payload
from analysis.closeloop.catalogue.limb import CrossJointCoupling, StretchReflex, Thixotropy
from analysis.closeloop.catalogue.transmission import Backlash, Hysteresis, SeriesElasticity
from analysis.closeloop.session.recording import Recording

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
BY_NAME = {effect.name: effect for effect in EFFECTS}
#: Effects whose torque at rest is not determined by the motion.
RUBBING = {
    "coulomb_friction",
    "stribeck_friction",
    "asymmetric_friction",
    "load_dependent_friction",
    "position_dependent_friction",
    "hysteresis",
    "thixotropy",
}
#: The declared effect of the paper's equation (3), with a neutral angle.
VISCOELASTIC = "viscoelastic_joint"


def candidates(recording: Recording) -> list[Candidate]:
    """Return every effect at every joint it can be asked of."""
    return [
        Candidate(effect=effect, joint=joint)
        for joint in recording.joints
        for effect in EFFECTS
        if effect.applies(recording, joint)
    ]
