"""What a distribution promises: SciPy's quantiles, a faithful JSON form, and clear refusals."""

from typing import Any

import numpy as np
import pytest
from scipy import stats

from analysis.designs.distributions import Distribution, TruncatedNormal, scales

#: A distribution as JSON and SciPy's name for the same.
CASES: list[tuple[dict[str, Any], Any]] = [
    ({"kind": "uniform", "low": -2.0, "high": 5.0}, stats.uniform(-2.0, 7.0)),
    ({"kind": "normal", "mean": 3.0, "sd": 0.5}, stats.norm(3.0, 0.5)),
    (
        {"kind": "truncated_normal", "mean": 1.0, "sd": 2.0, "low": 0.0, "high": 4.0},
        stats.truncnorm(-0.5, 1.5, loc=1.0, scale=2.0),
    ),
    (
        {"kind": "truncated_normal", "mean": 1.0, "sd": 2.0, "low": 0.0, "high": 1.0},
        stats.truncnorm(-0.5, 0.0, loc=1.0, scale=2.0),
    ),
    (
        {"kind": "truncated_normal", "mean": 1.0, "sd": 2.0, "low": 1.0, "high": 9.0},
        stats.truncnorm(0.0, 4.0, loc=1.0, scale=2.0),
    ),
    (
        {"kind": "triangular", "low": 1.0, "mode": 2.0, "high": 5.0},
        stats.triang(0.25, loc=1.0, scale=4.0),
    ),
    (
        {"kind": "triangular", "low": 1.0, "mode": 1.0, "high": 5.0},
        stats.triang(0.0, loc=1.0, scale=4.0),
    ),
    ({"kind": "loguniform", "low": 0.01, "high": 100.0}, stats.loguniform(0.01, 100.0)),
    (
        {"kind": "discrete", "values": [-1.0, 0.5, 4.0], "probabilities": [0.15, 0.6, 0.25]},
        stats.rv_discrete(values=([-1.0, 0.5, 4.0], [0.15, 0.6, 0.25])),
    ),
]


@pytest.mark.parametrize(("data", "oracle"), CASES)
def test_quantiles_are_scipys(data: dict[str, Any], oracle: Any) -> None:
    u = np.linspace(0.001, 0.999, 101)
    np.testing.assert_allclose(Distribution.from_json(data).ppf(u), oracle.ppf(u), rtol=1e-12)


def test_a_truncated_normal_is_scipys_to_the_last_bit() -> None:
    # A study that was begun with SciPy's own is gone on with.
    rng = np.random.default_rng(3)
    for mean, sd, a in rng.normal(size=(40, 3)) * (3.0, 1.0, 3.0):
        b = a + rng.uniform(0.1, 4.0)
        mine = TruncatedNormal(
            mean=mean, sd=abs(sd), low=mean + a * abs(sd), high=mean + b * abs(sd)
        )
        a, b = (mine.low - mine.mean) / mine.sd, (mine.high - mine.mean) / mine.sd
        u = rng.uniform(size=7)
        theirs = stats.truncnorm.ppf(u, a, b, loc=mine.mean, scale=mine.sd)
        np.testing.assert_array_equal(mine.ppf(u), theirs.clip(mine.low, mine.high))


@pytest.mark.parametrize(("data", "oracle"), CASES)
def test_json_survives_a_round_trip(data: dict[str, Any], oracle: Any) -> None:
    distribution = Distribution.from_json(data)
    assert distribution.to_json() == data
    assert Distribution.from_json(distribution.to_json()) == distribution


@pytest.mark.parametrize(("data", "oracle"), CASES)
def test_no_quantile_leaves_the_support(data: dict[str, Any], oracle: Any) -> None:
    x = Distribution.from_json(data).ppf([2.0**-53, 1.0 - 2.0**-53])
    low, high = oracle.support()
    assert np.all((x >= low) & (x <= high))


def test_a_far_tail_of_a_normal_is_still_a_distribution() -> None:
    x = TruncatedNormal(mean=0.0, sd=1.0, low=20.0, high=21.0).ppf(np.linspace(0.01, 0.99, 9))
    assert np.all(np.diff(x) > 0.0)
    assert np.all((x > 20.0) & (x < 21.0))


@pytest.mark.parametrize("mean", [-1e100, -1e17, -1e9, 1e9, 1e100])
@pytest.mark.parametrize("sd", [1.0, 1e-250])
def test_a_truncation_without_mass_that_numbers_can_tell_is_refused(mean: float, sd: float) -> None:
    """Below a mean of -1e100 every draw was 2, the end that is further off."""
    with pytest.raises(ValueError, match=r"has no mass from 1 to 2 that numbers can tell: choose"):
        TruncatedNormal(mean=mean, sd=sd, low=1.0, high=2.0)


def test_a_narrow_normal_within_its_range_is_none_without_mass() -> None:
    narrow = TruncatedNormal(mean=1e9, sd=1e-8, low=1e9 - 1.0, high=1e9 + 1.0)
    assert narrow.ppf(0.5) == 1e9


def test_whole_numbers_are_read_as_numbers() -> None:
    assert Distribution.from_json({"kind": "uniform", "low": 0, "high": 2}).ppf(0.5) == 1.0


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        ({"low": 0.0, "high": 1.0}, "kind of a distribution must be one of uniform, normal"),
        ({"kind": "cauchy"}, "not 'cauchy'"),
        ({"kind": ["uniform"]}, "kind of a distribution must be one of"),
        ({"kind": "uniform", "low": 0.0}, "takes low, high, not low"),
        ({"kind": "uniform"}, "takes low, high, not nothing"),
        ({"kind": "normal", "mean": 0.0, "sd": 1.0, "low": 0.0}, "takes mean, sd"),
        (
            {"kind": "uniform", "low": 1.0, "high": 1.0},
            "low of a uniform .* must be below",
        ),
        ({"kind": "uniform", "low": 0.0, "high": 1e308}, "high of a uniform .* within ±1e\\+100"),
        (
            {"kind": "discrete", "values": [0.0, -1e200], "probabilities": [0.5, 0.5]},
            "values of a discrete .* within ±1e\\+100",
        ),
        (
            {"kind": "uniform", "low": float("nan"), "high": 1.0},
            "low of a uniform .* finite",
        ),
        (
            {"kind": "uniform", "low": 0.0, "high": float("inf")},
            "high of a uniform .* finite",
        ),
        ({"kind": "uniform", "low": "0", "high": 1.0}, "low of a uniform .* finite"),
        ({"kind": "uniform", "low": False, "high": 1.0}, "low of a uniform .* finite"),
        (
            {"kind": "normal", "mean": 0.0, "sd": 0.0},
            "sd of a normal .* must be positive",
        ),
        ({"kind": "loguniform", "low": 0.0, "high": 1.0}, "low of a loguniform .* positive"),
        ({"kind": "triangular", "low": 0.0, "mode": 2.0, "high": 1.0}, "mode of a triangular"),
        (
            {"kind": "discrete", "values": 3.0, "probabilities": [1.0]},
            "values of a discrete distribution must be finite numbers",
        ),
        (
            {"kind": "discrete", "values": [1.0, float("inf")], "probabilities": [0.5, 0.5]},
            "values of a discrete distribution must be finite numbers",
        ),
        ({"kind": "discrete", "values": [1.0], "probabilities": [1.0]}, "two values or more"),
        (
            {"kind": "discrete", "values": [1.0, 2.0], "probabilities": [1.0]},
            "a probability for every value",
        ),
        ({"kind": "discrete", "values": [2.0, 1.0], "probabilities": [0.5, 0.5]}, "must rise"),
        (
            {"kind": "discrete", "values": [1.0, 2.0], "probabilities": [1.0, 0.0]},
            "every probability of a discrete distribution must be positive",
        ),
        (
            {"kind": "discrete", "values": [1.0, 2.0], "probabilities": [0.5, 0.6]},
            "must add up to 1, not 1.1",
        ),
    ],
)
def test_nonsense_is_refused_in_one_sentence(data: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        Distribution.from_json(data)


@pytest.mark.parametrize("u", [0.0, 1.0, -0.1, float("nan")])
def test_a_probability_of_zero_or_one_has_no_quantile(u: float) -> None:
    with pytest.raises(ValueError, match="strictly between"):
        Distribution.from_json({"kind": "normal", "mean": 0.0, "sd": 1.0}).ppf(u)


def test_every_distribution_has_a_width_by_its_range_or_its_quantiles() -> None:
    for data, _ in CASES:
        distribution = Distribution.from_json(data)
        found = scales({"x": distribution})["x"]
        low, high = distribution.ppf([1e-9, 1.0 - 1e-9]).tolist()
        if data["kind"] in ("uniform", "discrete"):
            assert found.by == "range"
            assert found.width == pytest.approx(high - low, rel=1e-6)
        else:
            # The mean slope of the quantile function over the central 90 %.
            u = np.linspace(0.05, 0.95, 20_001)
            slope = np.gradient(distribution.ppf(u), u).mean()
            assert found.by == "quantiles"
            assert found.width == pytest.approx(slope, rel=1e-3)
