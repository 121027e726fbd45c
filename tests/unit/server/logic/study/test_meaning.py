"""A study is not taken if its model can never mean one of its values, wherever it was validated."""

from typing import Any

import pytest

from server.errors import InvalidStudyError
from server.logic.study.plans import FactorChoice
from sim.models import MODELS
from sim.parameters.conditions import split
from tests.testbed.coordinators.records import plan

#: Has every factor of an assessment.
EFFECTS = MODELS["elbow_effects"]


def taken(**request: Any) -> bool:
    try:
        plan(model=EFFECTS.name, **request)
    except InvalidStudyError:
        return False
    return True


def meant(name: str, value: float) -> bool:
    """Whether `assess` takes a value."""
    try:
        split({name: value})
    except ValueError:
        return False
    return True


@pytest.mark.parametrize("factor", EFFECTS.factors, ids=lambda factor: factor.name)
def test_a_value_is_taken_if_and_only_if_the_assessment_can_mean_it(factor: Any) -> None:
    other = "upper_arm_mass" if factor.name == "forearm_mass" else "forearm_mass"
    ends = [end for end in (*factor.bounds, *factor.reach) if abs(end) < 1e300]
    values = {0.0, -1.0, 0.5, 1e-6, 0.02, 1e9, factor.low, factor.high, factor.nominal}
    values |= {end + step for end in ends for step in (-0.25, -1e-6, 0.0, 1e-6, 0.25)}
    for value in values:
        means = meant(factor.name, value)
        fixed = {"fixed": {factor.name: value}, "factors": [FactorChoice(name=other)]}
        assert taken(**fixed) == means, value
        discrete = {"kind": "discrete", "values": sorted((factor.nominal, value))}
        discrete |= {"probabilities": [0.0001, 0.9999]}
        choice = FactorChoice(name=factor.name, distribution=discrete)
        assert taken(factors=[choice]) == (means and value != factor.nominal), value


WIDE = {"kind": "uniform", "low": 0.01, "high": 0.04}
NORMAL = {"kind": "normal", "mean": 0.5, "sd": 0.3}


@pytest.mark.parametrize(
    ("request_", "pointer", "sentence"),
    [
        ({"fixed": {"muscles": 0.5}}, "/fixed/muscles", "muscles must be paper, .* not 0.5"),
        ({"fixed": {"forearm_mass": -1}}, "/fixed/forearm_mass", "must be at least 0.001, not -1"),
        (
            {"factors": [("movement_amplitude", WIDE)]},
            "/factors/0/distribution",
            "movement_amplitude must lie between 0.05 and 2, not 0.01",
        ),
        (
            {"factors": [("forearm_length", None), ("forearm_mass", NORMAL)]},
            "/factors/1/distribution",
            "forearm_mass must be at least 0.001, not -0.4",
        ),
        (
            {"factors": [("muscles", {**WIDE, "high": 1.0})]},
            "/factors/0/distribution",
            "muscles is a choice .* discrete distribution",
        ),
        (
            {"fixed": {"effect.coulomb_friction.torque": -1.0}},
            "/fixed/effect.coulomb_friction.torque",
            "must be at least 0, not -1",
        ),
    ],
)
def test_what_no_run_could_mean_is_refused_with_its_place(
    request_: dict[str, Any], pointer: str, sentence: str
) -> None:
    factors = [FactorChoice(name=n, distribution=d) for n, d in request_.get("factors", ())]
    with pytest.raises(InvalidStudyError, match=sentence) as refusal:
        plan(model=EFFECTS.name, **{**request_, "factors": factors or None})
    assert refusal.value.pointer == pointer
