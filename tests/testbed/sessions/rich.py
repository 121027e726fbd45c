"""A rich recording without noise, and of every effect a place in its grid with its torque."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from analysis.closeloop.identification.balance.model import unfitted
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.session.contents import Session, Trial
from analysis.closeloop.session.device import Device
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.signals import Sampling
from sim.effects.catalogue import BY_NAME
from sim.effects.effect import Columns, Theta
from tests.testbed.sessions.effects import Arm
from tests.testbed.sessions.synthetic import mjcf

ELBOW = 1
#: For every effect, a place in its grid and its coefficients.
TRUTH: dict[str, tuple[dict[str, float], tuple[float, ...]]] = {
    "coulomb_friction": ({"smooth": 0.02}, (0.8,)),
    "viscous_friction": ({}, (0.5,)),
    "stribeck_friction": ({"smooth": 0.004, "speed": 0.24, "power": 2.0}, (0.6, 0.9)),
    "asymmetric_friction": ({"smooth": 0.004, "viscous": 1.0}, (0.9, 0.3, 0.1, 0.4)),
    "load_dependent_friction": ({"smooth": 0.004, "load": 0}, (0.3, 0.2)),
    "stribeck_load_friction": (
        {"smooth": 0.004, "speed": 0.24, "power": 2.0, "load": 0},
        (0.3, 0.1, 0.4, 0.1),
    ),
    "directional_load_friction": ({"smooth": 0.004, "load": 0}, (0.3, 0.3, 0.15)),
    "quadratic_load_friction": ({"smooth": 0.004, "load": 0}, (0.3, 0.1, 0.02)),
    "position_dependent_friction": ({"smooth": 0.004, "waves": 1.5}, (0.9, 0.3, 0.2)),
    "torque_offset": ({}, (0.7,)),
    "torque_gain": ({}, (-0.1,)),
    "payload": ({"distance": 1.6, "aside": 0.3}, (0.4,)),
    "added_inertia": ({}, (0.05,)),
    "position_offset": ({"offset": 0.1}, (0.1,)),
    "gravity_torque": ({"turned": 0.5}, (3.0,)),
    "joint_stiffness": ({}, (3.0, -2.0)),
    "nonlinear_stiffness": ({"centre": 1.0}, (5.0,)),
    "end_range_torque": ({"side": 1.0, "onset": 1.15, "power": 0.0, "width": 0.3}, (0.8,)),
    "softening_stiffness": ({"centre": 1.0, "width": 0.2, "power": 0.0}, (1.5,)),
    "end_range_both": (
        {"power": 0.0}
        | {"onset_positive": 1.15, "onset_negative": 0.85}
        | {"width_positive": 0.3, "width_negative": 0.25},
        (0.8, 0.6),
    ),
    "torque_ripple": ({"order": 23.6}, (0.4, 0.3)),
    "time_delay": ({"delay": 0.02}, ()),
    "actuator_lag": ({"time_constant": 0.03}, ()),
    "series_elasticity": (
        {
            "resonance": 5.0,
            "damping_ratio": 0.2,
            "inertia_behind": 1.0,
            "weight_behind": 1.0,
            "damping_behind": 1.0,
        },
        (0.0225,),
    ),
    "backlash": ({"crossed": 0.1, "inertia_behind": 1.0}, (1.2,)),
    "hysteresis": ({"distance": 0.25, "exponent": 1.0}, (1.2,)),
    "stretch_reflex": (
        {"side": 1.0, "delay": 0.06, "activation_time": 0.0, "speed": 0.15, "angle": -2.0},
        (1.5,),
    ),
    "stretch_reflex_both": (
        {"delay": 0.06, "activation_time": 0.0, "speed": 0.15},
        (1.5, 1.1),
    ),
    "thixotropy": (
        {"elastic_range": 0.08, "exponent": 0.0, "recovery": 0.4, "distance": 0.4},
        (1.5, 0.3),
    ),
    "stress_relaxation": ({"relaxation_time": 0.3, "decades": 1.0}, (3.0,)),
    "thixotropic_stiffness": ({"recovery": 1.5, "distance": 0.5}, (3.0, -2.5)),
    "drift": ({"level_off": 0.6}, (0.3, 0.5)),
    "coupled_motor": ({"other_dof": 0.0, "sense": 1.0, "smooth": 0.004}, (0.9, 0.4, 0.0)),
    "cross_joint_coupling": ({"other_dof": 0.0, "between": 0.0, "by": 0.0}, (2.0, 0.4, -0.6)),
}


def rich_recording(seconds: int = 5) -> Recording:
    """Both joints of the arm in rich motion, 5 s at 200 Hz unless more is wanted."""
    return swung(mjcf(Arm()), (-0.5, 1.0), (0.7, 0.4), seconds)


def swung(
    model: str,
    centre: tuple[float, ...],
    frequencies_hz: tuple[float, ...],
    seconds: int = 5,
    rate: float = 200.0,
) -> Recording:
    """Every joint of a model swings about its centre."""
    t = np.arange(int(rate * seconds)) / rate
    w = 2 * np.pi * np.array(frequencies_hz)
    q = np.array(centre) + 0.4 * np.sin(t[:, None] * w)
    v = 0.4 * w * np.cos(t[:, None] * w)
    a = -0.4 * w**2 * np.sin(t[:, None] * w)
    trial = Trial(file="a.csv", label="a", group="a", role="fit")
    return Recording(
        device=Device(mujoco.MjSpec.from_string(model), ()),
        session=Session(folder=Path(), model="device.xml", limb_joints=("elbow",), trials=(trial,)),
        sampling=Sampling(recorded=rate, working=rate, cutoff=20.0),
        slices=[slice(0, len(t))],
        trial=np.zeros(len(t), dtype=int),
        time=t,
        position=q,
        velocity=v,
        acceleration=a,
        effort=np.zeros_like(q),
        measured=np.ones(len(t)),
        extra=np.empty((len(t), 0)),
        extra_names=(),
        joints=tuple(range(len(centre))),
        fit_trials=(0,),
    )


def rich_elbow(seconds: int = 5) -> Recording:
    """Return the elbow alone of a rich recording."""
    return replace(rich_recording(seconds), joints=(ELBOW,), cache={})


def added(name: str, columns: Columns, theta: Theta, kept: tuple[int, ...] = (0,)) -> Term:
    """Return an effect of the elbow as one that was added to a model."""
    return Term(
        joint=ELBOW,
        columns=columns,
        kept=kept,
        effect=BY_NAME[name],
        theta=theta,
        candidate=Candidate(effect=BY_NAME[name], joint=ELBOW),
    )


def asked(recording: Recording, name: str) -> Recording:
    """Return the recording as one of which an effect can be asked: without a limb, of some."""
    if BY_NAME[name].applies(recording, ELBOW):
        return recording
    return replace(recording, session=replace(recording.session, limb_joints=()), cache={})


def torque(recording: Recording, name: str) -> np.ndarray:
    """Return what the motor has to add for the effect's truth, (n, joints)."""
    theta, coefficients = TRUTH[name]
    out = np.zeros_like(recording.position)
    for joint, columns in BY_NAME[name].columns(unfitted(recording, ELBOW), theta).items():
        out[:, joint] = columns @ coefficients
    return out


def values(recording: Recording, name: str) -> dict[str, float]:
    """Return the physical parameters of the effect's truth."""
    theta, coefficients = TRUTH[name]
    readings = BY_NAME[name].readings(unfitted(recording, ELBOW), theta)
    return {key: float(r.of(dict(enumerate(coefficients)))) for key, r in readings.items()}
