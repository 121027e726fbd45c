"""What the world may ask for."""

import pytest

from sim.models import ELBOW, MODELS


def test_every_model_names_its_factors_and_outputs_once() -> None:
    for model in MODELS.values():
        names = [factor.name for factor in model.factors]
        assert len(set(names)) == len(names)
        assert len(set(model.outputs)) == len(model.outputs) > 0
    with pytest.raises(KeyError):
        ELBOW.factor("x1")


def test_what_a_factor_was_validated_for_is_in_its_reach_and_twice_its_highest_is_the_end() -> None:
    for factor in ELBOW.factors:
        low, high = factor.reach
        assert low <= min(factor.low, factor.nominal), factor.name
        assert max(factor.high, factor.nominal) <= high, factor.name
    assert ELBOW.factor("forearm_mass").reach == (0.05, 3.64)
    assert ELBOW.factor("cuff_compliance").reach == (0.0, 0.004)
