"""A model that is not deterministic: its seed is sampled, and its noise is told as a share."""

from dataclasses import replace
from math import log
from random import Random

import pytest

from analysis.sensitivity.records import LoggedResult
from analysis.sensitivity.remarks import remarks
from analysis.sensitivity.service import analyse
from models.folder import read_folder
from server.errors import InvalidStudyError
from server.logic.study.plans import FactorChoice, draw_up
from server.logic.study.points import for_analysis, parameters, point
from server.records import Plan, Study
from server.states import StudyState
from tests.testbed.models import EXAMPLES

MODEL = read_folder(EXAMPLES / "noisy_pendulum").description
TORQUE, NOISE = 0.5, 0.01
#: Of torque * gain / stiffness, both uniform, and of the sensor, which adds its own.
_MEAN = TORQUE * log(20.0 / 5.0) / 15.0
_GAIN = 0.4**2 / 12.0
_STIFFNESS = TORQUE**2 / (5.0 * 20.0) - _MEAN**2
_TOTAL = _STIFFNESS + _GAIN * _MEAN**2 + _GAIN * _STIFFNESS + NOISE**2
TRUE = {
    "stiffness": (_STIFFNESS + _GAIN * _STIFFNESS) / _TOTAL,
    "motor_gain": _GAIN * (_MEAN**2 + _STIFFNESS) / _TOTAL,
    "seed": NOISE**2 / _TOTAL,
}


def drawn(rows: int = 4, **changes: object) -> Plan:
    asked = {
        "name": "noise",
        "model": MODEL,
        "called": MODEL.version,
        "method": "saltelli",
        "sampling": "owen_blocks",
        "rows": rows,
        "seed": 11,
        "factors": None,
        "fixed": {},
        "outputs": None,
    }
    return draw_up(**{**asked, **changes})  # type: ignore[arg-type]


def measured(plan: Plan, row: int, position: int) -> float:
    """Evaluate the example's law."""
    asked = point(plan, row, parameters(plan, row)[position])
    x = asked["parameters"]
    angle = x["motor_gain"] * TORQUE / x["stiffness"]
    return float(angle + Random(asked["model_seed"]).gauss(0.0, NOISE))


def test_its_share_of_the_variance_is_in_its_interval_and_the_factors_shares_stay_their_own() -> (
    None
):
    plan = drawn(rows=128)
    study = for_analysis(Study(id="s", plan=plan, state=StudyState.RUNNING, created_at=0.0))
    results = [
        LoggedResult(
            seq=row * plan.width + position + 1,
            instance=f"{row}:{position}",
            row=row,
            position=position,
            outcome="ok",
            outputs={"rest_angle": measured(plan, row, position)},
        )
        for row in range(plan.rows)
        for position in range(plan.width)
    ]
    snapshot = analyse(study, results)
    factors = snapshot["outputs"]["rest_angle"]["factors"]
    for name, truth in TRUE.items():
        found = factors[name]["total_order"]
        width = found["high"] - found["low"]
        # One 90 % interval in ten misses; twice as wide, one in a thousand.
        assert found["low"] - width / 2 <= truth <= found["high"] + width / 2
        assert width < 0.4
    said = " ".join(remarks(snapshot, "rest_angle"))
    assert f"own noise is {factors['seed']['total_order']['value']:.1%} of the variance" in said


def test_runs_of_a_row_share_their_seed_but_the_one_that_differs_by_it() -> None:
    plan = drawn()
    for row in range(plan.rows):
        points = [point(plan, row, values) for values in parameters(plan, row)]
        # A, one for each factor with that of B, and B.
        seeds = [one["model_seed"] for one in points]
        assert len(set(seeds)) == 2
        assert sorted(map(seeds.count, set(seeds))) == [2, plan.width - 2]
        first = points[0]
        replicas = [one for one in points if one["parameters"] == first["parameters"]]
        assert len(replicas) == 2
        assert replicas[0]["model_seed"] != replicas[1]["model_seed"]
    assert len({point(plan, row, parameters(plan, row)[0])["model_seed"] for row in range(4)}) == 4


def test_screening_draws_new_seeds_in_every_row_though_it_has_few_levels() -> None:
    plan = drawn(rows=16, method="morris", sampling="random_trajectories")
    seeds = {
        point(plan, row, values)["model_seed"]
        for row in range(plan.rows)
        for values in parameters(plan, row)
    }
    assert len(seeds) == 2 * plan.rows


def test_the_seed_is_sampled_with_the_factors_that_are_named_and_may_be_held() -> None:
    assert list(drawn(factors=[FactorChoice(name="stiffness")]).distributions) == [
        "stiffness",
        "seed",
    ]
    held = drawn(fixed={"seed": 7.0})
    assert "seed" not in held.distributions
    assert {point(held, row, parameters(held, row)[1])["model_seed"] for row in range(4)} == {7}
    with pytest.raises(InvalidStudyError, match="seed must be a whole number"):
        drawn(fixed={"seed": 0.5})
    with pytest.raises(InvalidStudyError, match="seed must be a whole number"):
        drawn(fixed={"seed": -1.0})


def test_a_deterministic_model_has_none() -> None:
    quiet = replace(MODEL, deterministic=True)
    assert list(drawn(model=quiet).distributions) == ["stiffness", "motor_gain"]
