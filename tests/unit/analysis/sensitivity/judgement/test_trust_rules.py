"""Where trust ends, to the row and to the last digit; the estimator is its sums alone."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from analysis.sensitivity.estimators import Estimate
from analysis.sensitivity.judgement.trust import Trust, judge


@dataclass
class Sums:
    """What is asked of an estimator of two outputs, of which the second one is looked at."""

    rows: int
    runs: int
    kurtosis_of_y: float
    method: str = "saltelli"
    heavy_kurtosis: float = 6.0
    #: `kurtosis_of_y` if None.
    other: float | None = None
    sampling: str = "owen_blocks"
    #: The values of the output that is looked at.
    ends: tuple[float, float] = (0.0, 1.0)

    @property
    def least(self) -> Any:
        return np.array([0.0, self.ends[0]])

    @property
    def most(self) -> Any:
        return np.array([1.0, self.ends[1]])

    @property
    def effects(self) -> Any:
        return np.array([[9999, 9999], [self.rows, 1]])

    def independent_runs(self) -> Any:
        return np.array([9999, self.runs])

    def kurtosis(self) -> Any:
        return np.array([1.0, self.kurtosis_of_y])

    def other_kurtosis(self) -> Any:
        other = self.kurtosis_of_y if self.other is None else self.other
        return np.array([1.0, other])


@dataclass
class SumOfShares:
    """The sum of total-order indices, whose upper end is this."""

    high: float
    asked: list[float] = field(default_factory=list)

    def estimate(self, level: float) -> Estimate:
        self.asked.append(level)
        high = np.array([9.0, self.high])
        return Estimate(value=high, low=high, high=high)


class Shares(SumOfShares):
    """Shares of two factors, of which the second one's interval begins here."""

    def estimate(self, level: float) -> Estimate:
        low = np.array([[9.0, 9.0], [np.nan, super().estimate(level).low[1]]])
        return Estimate(value=low, low=low, high=low)


def judged(sums: Sums, **statistics: Any) -> Trust:
    return judge(sums, statistics, 1, "y")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("sums", "trusted"),
    [
        (Sums(rows=127, runs=254, kurtosis_of_y=9.0), None),
        (Sums(rows=127, runs=254, kurtosis_of_y=3.0), None),
        (Sums(rows=128, runs=256, kurtosis_of_y=3.0), True),
        (Sums(rows=128, runs=256, kurtosis_of_y=6.0), True),
        (Sums(rows=128, runs=256, kurtosis_of_y=6.01), False),
        (Sums(rows=256, runs=512, kurtosis_of_y=6.01), False),
        (Sums(rows=256, runs=512, kurtosis_of_y=99.0, other=6.0), True),
        (Sums(rows=256, runs=512, kurtosis_of_y=99.0, other=6.01), False),
        (Sums(rows=1024, runs=2048, kurtosis_of_y=6.0), True),
        (Sums(rows=1024, runs=2048, kurtosis_of_y=6.01), False),
        (Sums(rows=1024, runs=2048, kurtosis_of_y=9.0, heavy_kurtosis=9.0), True),
        (Sums(rows=1024, runs=2048, kurtosis_of_y=9.01, heavy_kurtosis=9.0), False),
        (Sums(rows=256, runs=512, kurtosis_of_y=99.0, other=float("nan")), False),
        (Sums(rows=2000, runs=4000, kurtosis_of_y=8.01), False),
        (Sums(rows=2000, runs=4000, kurtosis_of_y=8.0), True),
        (Sums(rows=2000, runs=4000, kurtosis_of_y=8.01, heavy_kurtosis=9.0), True),
        (Sums(rows=2000, runs=4000, kurtosis_of_y=float("nan")), True),
    ],
)
def test_a_tail_is_heavy_above_its_bound_and_seen_well_from_500_effective_runs_on(
    sums: Sums, trusted: bool | None
) -> None:
    found = judged(sums)
    assert found.trusted is trusted
    assert found.sentence.startswith("Do not trust") is (trusted is False)
    assert bool(found.sentence) is (trusted is not True)


def test_what_few_runs_make_up_is_said_of_shares_and_of_effects() -> None:
    assert judged(Sums(rows=500, runs=1000, kurtosis_of_y=8.0)).sentence == (
        "Do not trust these intervals: the variance of y rests on few runs (as many as 125 of "
        "equal size would, of 1,000), so shares of it may be far off, those of light factors too "
        "large."
    )
    screening = Sums(rows=500, runs=1000, kurtosis_of_y=8.0, method="morris")
    assert judged(screening).sentence == (
        "Do not trust these intervals: the largest effects on y rest on few rows (as many as 125 "
        "of equal size would, of 1,000), so sigma and the means may be far off."
    )


@pytest.mark.parametrize(("high", "trusted"), [(1.0, True), (1.2, True), (0.994, False)])
def test_shares_sum_to_one_or_more_by_their_interval_of_99_percent(
    high: float, trusted: bool
) -> None:
    light, total = Sums(rows=128, runs=256, kurtosis_of_y=3.0), SumOfShares(high)
    found = judged(light, sum_total_order=total)
    assert total.asked == [0.99]
    assert found.trusted is trusted
    if not trusted:
        assert found.sentence == (
            "Do not trust these intervals: the total-order indices of y sum to at most 0.99, and "
            "truly never to less than 1, so something that matters was seen too rarely."
        )


def test_both_reasons_are_said_and_of_too_few_rows_that_they_are_few() -> None:
    heavy = Sums(rows=128, runs=256, kurtosis_of_y=20.0)
    both = judged(heavy, sum_total_order=SumOfShares(0.5)).sentence
    assert "too large; the total-order indices of y sum to at most 0.50" in both
    few = Sums(rows=100, runs=200, kurtosis_of_y=20.0)
    found = judged(few, sum_total_order=SumOfShares(0.5))
    said = "Intervals of fewer than 128 rows are not to be believed yet."
    assert (found.trusted, found.sentence) == (None, said)


@pytest.mark.parametrize(
    ("runs", "unseen"), [(0, None), (2, None), (3, 1.0), (4, 0.75), (600, 0.005)]
)
def test_what_three_runs_in_a_sample_would_show_may_be_unseen(
    runs: int, unseen: float | None
) -> None:
    found = judged(Sums(rows=0, runs=runs, kurtosis_of_y=2.0))
    assert (found.runs, found.unseen, found.effective_runs) == (runs, unseen, runs / 2.0)


def test_an_unknown_kurtosis_leaves_the_effective_runs_unknown() -> None:
    assert judged(Sums(rows=0, runs=9, kurtosis_of_y=float("nan"))).effective_runs is None


@pytest.mark.parametrize(
    ("index", "what"),
    [("first_order", "a first-order index"), ("total_order", "a total-order index")],
)
def test_a_share_that_is_surely_above_one_is_not_to_be_trusted(index: str, what: str) -> None:
    enough = Sums(rows=128, runs=256, kurtosis_of_y=3.0)
    whole = Shares(1.0049)
    assert judged(enough, **{index: whole}).trusted is True
    assert whole.asked == [0.99]
    found = judged(enough, **{index: Shares(1.048)})
    assert found.trusted is False
    assert found.sentence == (
        f"Do not trust these intervals: {what} of y is at least 1.05, and truly never more than 1, "
        "so the rows are too few for a share of the variance."
    )


@pytest.mark.parametrize(
    ("ends", "said"),
    [
        ((0.0, 0.99e-100), "sums cannot hold the squares"),
        ((-1e-170, 1e-170), "sums cannot hold the squares"),
        ((0.0, 1.01e-100), ""),
        ((1e14, 1e14 + 4.0), "too few digits are left"),
        ((-1e14 - 4.0, -1e14), "too few digits are left"),
        ((1e13, 1e13 + 4.0), ""),
        ((0.0, 1e99), ""),
        ((0.0, 0.0), ""),
        ((0.3, np.nextafter(0.3, 1.0)), ""),
        ((np.inf, -np.inf), ""),
    ],
)
def test_what_double_precision_does_not_tell_is_not_to_be_trusted(
    ends: tuple[float, float], said: str
) -> None:
    found = judged(Sums(rows=256, runs=512, kurtosis_of_y=3.0, ends=ends))
    assert found.trusted is (not said) and said in found.sentence
    assert bool(found.sentence) is bool(said)
