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
