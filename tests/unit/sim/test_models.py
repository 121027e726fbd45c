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


def test_a_factor_may_leave_its_range_by_its_width_and_what_is_positive_be_halved() -> None:
    for factor in ELBOW.factors:
        low, high = factor.reach
        assert low <= min(factor.low, factor.nominal), factor.name
        assert max(factor.high, factor.nominal) <= high, factor.name
    assert ELBOW.factor("forearm_mass").reach == pytest.approx((0.05, 3.54))
    assert ELBOW.factor("forearm_length").reach == pytest.approx((0.2199, 0.4083))
    assert ELBOW.factor("strap_tension").reach == (0.0, 105.0)
    assert ELBOW.factor("cuff_compliance").reach == (0.0, 0.004)
