"""Groups of factors: rows, closed forms, SALib on the same samples, and groups that are none."""

import json
import warnings
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from SALib.analyze import morris as salib_morris
from SALib.analyze import sobol as salib_sobol

from analysis.designs import instance_parameters, row_width, unit_row
from analysis.designs.distributions import Uniform
from analysis.designs.groups import fault_in, places_of, units_of
from analysis.sensitivity.estimator_state import EstimatorState, StaleStateError
from analysis.sensitivity.estimators import MorrisEstimator, SaltelliEstimator
from analysis.sensitivity.records import LoggedResult, StudyPlan
from analysis.sensitivity.service import analyse
from models.curves import Curve

Array = NDArray[np.float64]

FACTORS = ("x1", "x2", "x3")
GROUPS = {"outer": ("x1", "x3")}
PLACES = places_of(FACTORS, GROUPS)
#: The same for SALib.
PROBLEM = {
    "num_vars": 3,
    "names": list(FACTORS),
    "groups": ["outer", "x2", "outer"],
    "bounds": [[0.0, 1.0]] * 3,
}
#: Variance shares of Ishigami and Homma 1990 for a = 7, b = 0.1.
VARIANCE = 49 / 8 + np.pi**4 / 50 + np.pi**8 / 1800 + 0.5
SHARE_2 = 49 / 8 / VARIANCE


def ishigami(unit: Array) -> Array:
    x = np.pi * (2.0 * unit - 1.0)
    value: Array = np.sin(x[..., 0]) * (1.0 + 0.1 * x[..., 2] ** 4) + 7.0 * np.sin(x[..., 1]) ** 2
    return value


def rows_of(method: str, sampling: str, rows: int) -> Array:
    return np.stack([unit_row(method, sampling, 3, row, 3, units=PLACES) for row in range(rows)])


def test_units_are_groups_and_the_factors_in_none_each_in_the_place_of_its_first() -> None:
    assert units_of("abcd", {"late": ("d", "b")}) == {"a": ("a",), "late": ("b", "d"), "c": ("c",)}
    assert places_of("abcd", {"late": ("d", "b")}) == [[0], [1, 3], [2]]
    assert places_of("ab", {}) == [[0], [1]]


def test_a_row_exchanges_the_factors_of_a_group_together() -> None:
    a, b, mixed, other, *back = unit_row(
        "saltelli_second_order", "owen_blocks", 3, 5, 3, units=PLACES
    )
    assert mixed.tolist() == [b[0], a[1], b[2]] and other.tolist() == [a[0], b[1], a[2]]
    assert back[0].tolist() == [a[0], b[1], a[2]] and len(back) == 2
    assert (
        row_width("saltelli", 2) == len(unit_row("saltelli", "sobol", 3, 5, 3, units=PLACES)) == 4
    )


def test_groups_of_one_factor_each_change_no_bit() -> None:
    alone = [[0], [1], [2]]
    for method in ("saltelli", "saltelli_second_order"):
        for row in range(9):
            grouped = unit_row(method, "owen_blocks", 3, row, 3, units=alone)
            assert np.array_equal(grouped, unit_row(method, "owen_blocks", 3, row, 3))
    for row in range(9):
        grouped = unit_row("morris", "random_trajectories", 3, row, 3, units=alone)
        assert np.array_equal(grouped, unit_row("morris", "random_trajectories", 3, row, 3))


def test_groups_of_a_study_begun_along_trajectories_far_apart_stay_as_they_were() -> None:
    expected = [[0.125, 0.875, 0.875], [0.125, 0.375, 0.875], [0.625, 0.375, 0.375]]
    grouped = unit_row("morris", "trajectories", 3, 4, 3, units=PLACES)
    assert grouped.tolist() == expected


def test_a_trajectory_moves_every_factor_of_a_group_by_two_levels_at_once() -> None:
    rows = rows_of("morris", "random_trajectories", 40)
    steps = np.abs(np.diff(rows, axis=1))
    assert set(np.unique(steps.round(12))) == {0.0, 0.5}
    assert np.array_equal(steps[:, :, 0], steps[:, :, 2])
    assert (steps.sum(axis=1) == 0.5).all()
    assert set(np.unique(rows)) == {0.125, 0.375, 0.625, 0.875}
    up = np.diff(rows, axis=1).sum(axis=1) > 0
    assert 0.2 < (up[:, 0] == up[:, 2]).mean() < 0.8


def test_indices_of_groups_come_to_those_of_ishigami() -> None:
    values = ishigami(rows_of("saltelli", "owen_blocks", 2048))[..., None]
    estimator = SaltelliEstimator(sampling="owen_blocks", seed=3, factors=2, outputs=1)
    estimator.add_rows(range(2048), values)
    for index in ("first_order", "total_order"):
        found = estimator.indices()[index]
        # Between the groups nothing interacts, so S and ST are one.
        assert found.value[0] == pytest.approx([1.0 - SHARE_2, SHARE_2], abs=0.02)
        assert (found.low[0] <= [1.0 - SHARE_2, SHARE_2]).all()
        assert (found.high[0] >= [1.0 - SHARE_2, SHARE_2]).all()


def test_salib_says_the_same_of_groups_on_the_same_samples() -> None:
    values = ishigami(rows_of("saltelli", "owen_blocks", 512))
    ours = SaltelliEstimator(sampling="owen_blocks", seed=3, factors=2, outputs=1)
    ours.add_rows(range(512), values[..., None])
    ordered = values[:, [0, 2, 3, 1]].ravel()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        theirs = salib_sobol.analyze(PROBLEM, ordered, calc_second_order=False, num_resamples=2)
    found = ours.indices()
    assert found["total_order"].value[0] == pytest.approx(theirs["ST"], abs=1e-9)
    # They centre B by the mean of all runs, we by that of A and B: else S is the same.
    a, b, mixed = values[:, 0], values[:, 1], values[:, 2:]
    apart = (np.mean([a, b]) - values.mean()) * (mixed - a[:, None]).mean(axis=0)
    same = found["first_order"].value[0] + apart / np.var([a, b])
    assert same == pytest.approx(theirs["S1"], abs=1e-9)


def test_salib_says_the_same_of_elementary_effects_of_groups() -> None:
    points = rows_of("morris", "random_trajectories", 30)
    values = ishigami(points)
    ours = MorrisEstimator(sampling="random_trajectories", seed=3, factors=2, outputs=1)
    ours.add_rows(range(30), values[..., None])
    theirs = salib_morris.analyze(
        PROBLEM, points.reshape(-1, 3), values.ravel(), num_levels=4, num_resamples=2
    )
    # They take the step of four levels from end to end, 2 / 3; ours are middles, 1 / 2 apart.
    assert ours.indices()["mu_star"].value[0] == pytest.approx(
        np.array(theirs["mu_star"]) * (2 / 3) / 0.5, abs=1e-9
    )


def plan(method: str, sampling: str = "owen_blocks", rows: int = 8) -> StudyPlan:
    return StudyPlan(
        id="s",
        method=method,
        seed=3,
        sampling=sampling,
        rows=rows,
        factors=FACTORS,
        groups=GROUPS,
        outputs=("y", "w[0]", "w[1]"),
        curves={"w": Curve(points=2, over="time")},
    )


def results(of: StudyPlan) -> list[LoggedResult]:
    found = []
    for row in range(of.rows):
        unit = unit_row(of.method, of.sampling, of.seed, row, 3, units=PLACES)
        for position, value in enumerate(ishigami(unit).tolist()):
            found.append(
                LoggedResult(
                    seq=len(found) + 1,
                    instance="",
                    row=row,
                    position=position,
                    outcome="ok",
                    outputs={"y": value, "w[0]": value, "w[1]": 2.0 * value},
                )
            )
    return found


@pytest.mark.parametrize(
    ("method", "sampling"),
    [
        ("saltelli", "owen_blocks"),
        ("saltelli_second_order", "owen_blocks"),
        ("morris", "random_trajectories"),
    ],
)
def test_a_study_says_its_indices_of_groups(method: str, sampling: str) -> None:
    study = plan(method, sampling)
    every = results(study)
    snapshot = analyse(study, every)
    assert snapshot == json.loads(json.dumps(analyse(study, every[::-1])))
    for said in (snapshot["outputs"]["y"], snapshot["curves"]["w"]):
        assert list(said["factors"]) == ["outer", "x2"]
    outer = snapshot["outputs"]["y"]["factors"]["outer"]
    if method == "morris":
        # Its factors go up and down at once: such effects have no sign.
        assert outer["mu"]["value"] is outer["sigma"]["high"] is None
        assert outer["mu_star"]["value"] > 0.0
        along = snapshot["outputs"]["y"]["convergence"]["factors"]["outer"]
        assert set(along["mu"]["value"]) == set(along["sigma"]["high"]) == {None}
        assert along["mu_star"]["value"][-1] == outer["mu_star"]["value"]
        curve = snapshot["curves"]["w"]
        line, scores = curve["factors"]["outer"], curve["components"][0]["factors"]
        assert line["mu"]["value"] == line["sigma"]["band_high"] == [None, None]
        assert None not in line["mu_star"]["value"]
        assert scores["outer"]["mu"]["value"] is None is scores["outer"]["sigma"]["low"]
        assert scores["x2"]["sigma"]["value"] is not None
        assert snapshot["outputs"]["y"]["factors"]["x2"]["sigma"]["value"] is not None
    else:
        both = outer["total_order"]["value"] - outer["first_order"]["value"]
        assert outer["interaction"]["value"] == pytest.approx(both)


def test_a_state_of_other_groups_is_another_study() -> None:
    study = plan("saltelli")
    state = EstimatorState(study)
    state.take(results(study)[:5])
    data = state.to_bytes()
    assert EstimatorState.from_bytes(study, data).cursor == 5
    with pytest.raises(StaleStateError):
        EstimatorState.from_bytes(replace(study, groups={"outer": ("x2", "x3")}), data)


def test_instances_of_groups_have_every_factor() -> None:
    distributions = dict.fromkeys(FACTORS, Uniform(low=0.0, high=2.0))
    points = instance_parameters("saltelli", "sobol", 3, 0, distributions, groups=GROUPS)
    assert [list(point) for point in points] == [list(FACTORS)] * 4
    assert points[2]["x1"] == points[1]["x1"] and points[2]["x2"] == points[0]["x2"]


@pytest.mark.parametrize(
    ("groups", "said"),
    [
        ({"g": ["x1", "x4"]}, ("g", "g has x4, which is not sampled: x1, x2, x3 are")),
        ({"g": []}, ("g", "g has no factors: name at least one, or leave it out")),
        ({"g": ["x1", "x1"]}, ("g", "x1 is in g twice: a factor is in one group only")),
        (
            {"g": ["x1", "x2"], "h": ["x3", "x2"]},
            ("h", "x2 is in g and h: a factor is in one group only"),
        ),
        ({"x2": ["x1"]}, ("x2", "x2 is the name of a factor: call the group otherwise")),
        (
            {"seed": ["x1"]},
            ("seed", "seed is what a model's own noise is called: call the group otherwise"),
        ),
        ({"g": ["x1", "x2", "x3"]}, None),
        ({}, None),
    ],
)
def test_groups_that_are_none_are_a_sentence(
    groups: dict[str, list[str]], said: tuple[str, str] | None
) -> None:
    assert fault_in(FACTORS, groups) == said


def test_groups_of_morris_move_along_trajectories_only() -> None:
    with pytest.raises(ValueError, match="choose sampling random_trajectories"):
        unit_row("morris", "owen_blocks", 3, 0, 3, units=PLACES)
