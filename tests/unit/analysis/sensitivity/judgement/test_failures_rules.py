"""Where failures are said to depend on factors, error by error; the estimator is its sums."""

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from analysis.designs.radial import MEAN_INVERSE_STEP
from analysis.designs.trajectories import STEP
from analysis.sensitivity.judgement.failures import FailureDependence, judge

ERROR = 0.01
NAMES = ("a", "b", "c")


def replicated(*values: float, error: float = ERROR) -> Any:
    """Return an index of the third output whose 200 replicates have this standard error."""
    apart = np.where(np.arange(200) % 2, error, -error)
    shape = np.array(values)
    one = np.concatenate([shape[None], shape + apart[:, None]])
    return SimpleNamespace(
        weighted=np.repeat(one[:, None], 3, axis=1), n=np.full((3, len(values)), 500)
    )


@dataclass
class Sums:
    """Failures of a fifth of the runs, that go with the outputs as said."""

    method: str = "saltelli"
    sampling: str = "owen_blocks"
    rows: float = 101.0
    correlation: tuple[float, ...] = (0.0, 0.0, 0.0)
    off: tuple[float, ...] = (1.0, 2.0, 50.0)
    asked: list[int] = field(default_factory=list)

    def weighted_mean(self, output: int) -> Any:
        self.asked.append(output)
        return np.full(201, 0.2)

    def failing_with(self) -> Any:
        return SimpleNamespace(
            rows=np.full(3, self.rows),
            correlation=np.array(self.correlation),
            off=np.array(self.off),
        )


def judged(
    sums: Sums, zero: Any, floor: Any, outputs: tuple[str, ...] = (), failed: int = 20
) -> FailureDependence:
    marks = {
        "morris": ("mu", "mu_star"),
        "saltelli": ("first_order", "total_order"),
        "shapley": ("full_first_order", "independent_total_order"),
    }[sums.method]
    statistics: Any = dict(zip(marks, (zero, floor), strict=True))
    estimator: Any = sums
    return judge(estimator, statistics, 2, NAMES, outputs, failed=failed, runs=100)


IDLE, DUMMY = replicated(0.0, 0.0, 0.0), replicated(1.0, 1.0, 1.0)


def test_no_failure_is_nothing_to_say() -> None:
    verdict = judged(Sums(), IDLE, DUMMY, failed=0)
    assert verdict == FailureDependence(depends_on_factors=None, caused_by=(), sentence="")


def test_twenty_failures_are_enough_to_judge_and_nothing_shows() -> None:
    sums = Sums()
    assert judged(sums, IDLE, DUMMY) == FailureDependence(
        depends_on_factors=False,
        caused_by=(),
        sentence="20 of 100 runs failed (20.0%); nothing shows that failures depend on the "
        "factors.",
    )
    assert sums.asked == [2]
    few = judged(Sums(), replicated(0.9, 0.0, 0.0), DUMMY, failed=19)
    assert (few.depends_on_factors, few.caused_by, few.goes_with) == (None, (), ())


@pytest.mark.parametrize(
    ("method", "value", "named"),
    [
        ("saltelli", 3.6 * ERROR, True),
        ("saltelli", 3.4 * ERROR, False),
        # A share below zero is chance, a mean effect below zero is an effect.
        ("saltelli", -9.0 * ERROR, False),
        ("shapley", 3.6 * ERROR, True),
        ("morris", 3.6 * ERROR, True),
        ("morris", -3.6 * ERROR, True),
        ("morris", -3.4 * ERROR, False),
    ],
)
def test_a_factor_stands_out_from_three_and_a_half_errors_on(
    method: str, value: float, named: bool
) -> None:
    dummy = 2.0 * 0.2 * 0.8 * MEAN_INVERSE_STEP if method == "morris" else 1.0
    floor = replicated(dummy, dummy, dummy)
    verdict = judged(Sums(method), replicated(0.0, value, 0.0), floor)
    assert verdict.depends_on_factors is named
    assert verdict.caused_by == (("b",) if named else ())


def test_factors_whose_intervals_lie_above_that_of_the_least_are_named_the_largest_first() -> None:
    verdict = judged(Sums(), IDLE, replicated(1.05, 1.0, 1.2))
    assert (verdict.depends_on_factors, verdict.caused_by) == (True, ("c", "a"))
    assert verdict.sentence == (
        "20 of 100 runs failed (20.0%), and failures depend on the factors: c, a. The indices of "
        "the outputs describe the runs that succeeded, not the ranges as asked."
    )
    assert judged(Sums(), IDLE, replicated(1.015, 1.0, 1.0)).caused_by == ()


@pytest.mark.parametrize(("below", "depends"), [(3.6 * ERROR, True), (3.4 * ERROR, False)])
def test_indices_below_a_dummys_show_that_some_factor_matters(below: float, depends: bool) -> None:
    """As when two of them fail together: which, the intervals do not part."""
    same = 1.0 - below
    verdict = judged(Sums(), IDLE, replicated(same, same, same))
    assert (verdict.depends_on_factors, verdict.caused_by) == (depends, ())
    above = judged(Sums(), IDLE, replicated(*[1.0 + below] * 3))
    assert above.depends_on_factors is False


@pytest.mark.parametrize(
    ("sampling", "inverse"),
    [
        ("trajectories", 1.0 / STEP),
        ("random_trajectories", 1.0 / STEP),
        ("owen_blocks", MEAN_INVERSE_STEP),
    ],
)
def test_a_dummys_mean_effect_is_that_of_two_runs_of_which_one_fails(
    sampling: str, inverse: float
) -> None:
    dummy = 2.0 * 0.2 * 0.8 * inverse
    same = replicated(*[dummy - 3.4 * ERROR] * 3)
    assert judged(Sums("morris", sampling), IDLE, same).depends_on_factors is False
    less = replicated(*[dummy - 3.6 * ERROR] * 3)
    assert judged(Sums("morris", sampling), IDLE, less).depends_on_factors is True


LEAST = stats.norm.ppf(1.0 - 0.01 / (2 * 2))


def test_failures_go_with_an_output_beyond_what_chance_gives_in_one_study_of_a_hundred() -> None:
    """Both outputs together; the correlation of 101 rows errs by a tenth."""
    beyond, within = 0.1 * LEAST * 1.001, 0.1 * LEAST * 0.999
    verdict = judged(Sums(correlation=(beyond, -beyond, 0.9)), IDLE, DUMMY, ("y", "z"))
    assert (verdict.depends_on_factors, verdict.caused_by) == (True, ())
    assert verdict.goes_with == ("y", "z")
    assert verdict.sentence == (
        "20 of 100 runs failed (20.0%), and failures depend on the factors. They go with high y "
        "and low z. The indices of the outputs describe the runs that succeeded, not the ranges "
        "as asked."
    )
    clear = judged(Sums(correlation=(within, -within, 0.9)), IDLE, DUMMY, ("y", "z"))
    assert (clear.depends_on_factors, clear.goes_with) == (False, ())


def test_an_all_clear_says_how_far_off_nine_studies_of_ten_would_have_noticed() -> None:
    """Of the output in which it would have to be farthest; the indicator itself is none."""
    noticed = (LEAST + stats.norm.ppf(0.9)) / 10.0 * 2.0
    verdict = judged(Sums(), IDLE, DUMMY, ("y", "z"))
    assert verdict.detectable == pytest.approx(noticed)
    assert verdict.sentence == (
        "20 of 100 runs failed (20.0%); nothing shows that failures depend on the factors. Had "
        f"the rows of failed runs been {noticed:.2g} standard deviations off in an output, nine "
        "of ten such studies would show it."
    )
    half = judged(Sums(off=(1.0, np.nan, 9.0)), IDLE, DUMMY, ("y", "z"))
    assert half.detectable == pytest.approx(noticed / 2.0)
    unknown = judged(Sums(off=(np.nan, np.inf, 9.0)), IDLE, DUMMY, ("y", "z"))
    assert unknown.detectable is None and "Had the rows" not in unknown.sentence
    # One row, or none, tells nothing, and is no error.
    assert judged(Sums(rows=1.0), IDLE, DUMMY, ("y", "z")).detectable == pytest.approx(10 * noticed)


def test_an_index_that_does_not_vary_or_is_mostly_undefined_shows_nothing() -> None:
    still = replicated(0.5, 0.5, 0.5, error=0.0)
    assert judged(Sums(), still, DUMMY).depends_on_factors is False
    same = replicated(1.0, 1.0, 1.0, error=0.0)
    assert judged(Sums(), IDLE, same).depends_on_factors is False
    mostly = replicated(0.5, 0.5, 0.0)
    mostly.weighted[1:102, :, 0] = np.nan
    mostly.weighted[1:101, :, 1] = np.nan
    assert judged(Sums(), mostly, DUMMY).caused_by == ("b",)
    undefined = replicated(np.nan, 0.0, 0.0)
    undefined.weighted[1:] = 0.5
    assert judged(Sums(), undefined, DUMMY).caused_by == ()
