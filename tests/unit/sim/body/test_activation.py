"""Activation patterns: constant, with the movement's phase, and a velocity-threshold reflex."""

from collections.abc import Mapping

import numpy as np
import pytest

from sim.assessment.assess import assess
from sim.assessment.steps import activation_pattern
from sim.body.activation import ActivationPattern
from sim.body.muscles.authors import CO_CONTRACTING, ELBOW_EXTENSORS, ELBOW_FLEXORS
from sim.parameters.conditions import conditions_of
from sim.parameters.fidelity import BUSHING
from sim.parameters.wearer import NOMINAL_WEARER
from sim.system.build import build_system
from sim.system.start import reset_to_start

FLEXORS = [muscle.name for muscle in ELBOW_FLEXORS]
STEPS = 100


def pattern_of(values: Mapping[str, float]) -> tuple[ActivationPattern, np.ndarray]:
    """Return a pattern over 1 s and which of its muscles flex."""
    system = build_system(NOMINAL_WEARER, conditions_of(values), BUSHING)
    pattern = activation_pattern(system, reset_to_start(system), np.linspace(1.9, 0.2, STEPS))
    names = [muscle.name for muscle in CO_CONTRACTING[system.target.muscles]]
    assert len(names) == len(FLEXORS) + len(ELBOW_EXTENSORS)
    return pattern, np.isin(names, FLEXORS)


def test_activation_is_constant_unless_asked_otherwise() -> None:
    pattern, _ = pattern_of({"activation": 0.3})
    pattern.velocity[:] = -5.0
    assert np.all(pattern.activations(0, STEPS) == 0.3)


def test_activation_rises_with_the_movement() -> None:
    pattern, _ = pattern_of({"activation_rise": 0.5})
    activations = pattern.activations(0, STEPS)
    assert activations[0] == pytest.approx(0.4)
    assert activations[-1] == pytest.approx(0.6)
    assert np.all(np.diff(activations, axis=0) > 0.0)


def test_a_reflex_answers_a_stretch_above_its_threshold_after_its_delay() -> None:
    values = {"reflex_gain": 0.2, "reflex_threshold": 0.5, "reflex_delay": 0.04}
    pattern, flexes = pattern_of(values)
    pattern.velocity[:20], pattern.velocity[20:] = -0.45, -0.9
    activations = pattern.activations(0, STEPS)
    assert np.all(activations[:24] == 0.4), "below the threshold, or the delay has not passed"
    assert activations[24:, flexes] == pytest.approx(0.4 + 0.2 * (0.9 - 0.5))
    assert np.all(activations[:, ~flexes] == 0.4), "extension does not stretch the extensors"


def test_flexion_stretches_the_extensors() -> None:
    pattern, flexes = pattern_of({"reflex_gain": 0.2, "reflex_threshold": 0.5})
    pattern.velocity[:] = 1.0
    activations = pattern.activations(50, 10)
    assert np.all(activations[:, flexes] == 0.4)
    assert activations[:, ~flexes] == pytest.approx(0.5)


def test_no_activation_leaves_what_a_muscle_can_have() -> None:
    pattern, flexes = pattern_of({"reflex_gain": 10.0})
    pattern.velocity[:] = -2.0
    assert np.all(pattern.activations(50, 10)[:, flexes] == 1.0)


def test_step_by_step_and_in_pieces_the_pattern_is_the_same() -> None:
    pattern, _ = pattern_of({"reflex_gain": 0.3, "activation_rise": 0.2})
    pattern.velocity[:] = np.random.default_rng(3).normal(size=STEPS)
    steps = np.vstack([pattern.activations(step, 1) for step in range(STEPS)])
    assert np.array_equal(steps, pattern.activations(0, STEPS))


def test_a_reflex_raises_the_muscles_torque_only_after_the_threshold_was_passed() -> None:
    values = {"reflex_gain": 0.2, "reflex_threshold": 0.5, "reflex_delay": 0.05}
    plain, reflex = (assess(v, fidelity="bushing").record for v in ({}, values))
    assert plain is not None and reflex is not None
    fast = int(np.argmax(-plain.q_velocity[:, plain.joint] > 0.5))
    assert fast > 50
    before = slice(0, fast + 5)
    assert reflex.human_torque[before] == pytest.approx(plain.human_torque[before], abs=1e-6)
    at_peak = int(np.argmin(plain.q_velocity[:, plain.joint]))
    assert reflex.human_torque[at_peak] > plain.human_torque[at_peak] + 1.0


def test_a_threshold_that_no_movement_reaches_changes_nothing() -> None:
    plain = assess({}, fidelity="bushing")
    unmoved = assess({"reflex_gain": 0.4, "reflex_threshold": 3.0}, fidelity="bushing")
    assert unmoved.outputs == pytest.approx(plain.outputs, rel=1e-6)


def test_a_reflex_shows_as_damping() -> None:
    plain, reflex = (assess(v, fidelity="bushing") for v in ({}, {"reflex_gain": 0.2}))
    assert reflex.outputs["damping_estimate"] < plain.outputs["damping_estimate"] - 2.0
