"""Effects as factors: off unless asked for, checked, and told apart by their owner."""

import pytest

from sim.effects.laws.reflexes import NO_ANGLE
from sim.models import ELBOW, MODELS, WITH_EFFECTS
from sim.parameters.conditions import DEFAULT_CONDITIONS, conditions_of, split
from sim.parameters.effects import effect_factors, effects_of


def test_no_effect_is_on_unless_it_is_asked_for() -> None:
    assert not DEFAULT_CONDITIONS.effects
    neutral = {factor.name: factor.nominal for factor in effect_factors()}
    assert not effects_of(neutral)


def test_an_effect_that_is_on_has_all_its_parameters() -> None:
    on = effects_of({"effect.stretch_reflex.gain": 4.0})
    assert set(on) == {"stretch_reflex"}
    assert on["stretch_reflex"]["gain"] == 4.0
    assert on["stretch_reflex"]["threshold_angle"] == NO_ANGLE


def test_a_parameter_that_sizes_nothing_switches_nothing_on() -> None:
    assert not effects_of({"effect.payload.distance": 0.2, "effect.stretch_reflex.delay": 0.03})


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("effect.magic.torque", 1.0, "no effect factor"),
        ("effect.coulomb_friction.force", 1.0, "no effect factor"),
        ("effect.coulomb_friction.torque", -1.0, "at least 0"),
        ("effect.torque_gain.gain", 0.0, r"at least 0\.2"),
        ("effect.payload.mass", float("nan"), "finite"),
    ],
)
def test_what_means_nothing_is_refused(name: str, value: float, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        effects_of({name: value})


def test_conditions_take_effects_beside_their_own_factors() -> None:
    conditions = conditions_of({"activation": 0.1, "effect.torque_offset.torque": 0.5})
    assert conditions.activation == 0.1
    assert conditions.effects == {"torque_offset": {"torque": 0.5}}
    wearer, conditions = split({"forearm_mass": 1.0, "effect.torque_offset.torque": 0.5})
    assert wearer.forearm_mass == 1.0 and conditions.effects


def test_only_the_models_with_effects_offer_them_and_sample_none_by_default() -> None:
    names = {factor.name for factor in effect_factors()}
    for model in MODELS.values():
        own = {factor.name for factor in model.factors}
        assert names <= own if model.name in WITH_EFFECTS else not names & own
    for name in WITH_EFFECTS:
        assert MODELS[name].sampled == ELBOW.sampled
