"""What screening promises: it fixes a factor only on evidence, and says which."""

from typing import Any

import pytest

from analysis.sensitivity.judgement.screening import influence, least_influential, propose_fixing
from analysis.sensitivity.service import analyse
from analysis.sensitivity.snapshot import empty_snapshot
from tests.testbed.studies import results_of, study_plan


def snapshot_of(**factors: tuple[float | None, float | None, float | None]) -> dict[str, Any]:
    """Return a snapshot of factors given as (mu*, its upper limit, sigma)."""
    return {
        "method": "morris",
        "level": 0.9,
        "outputs": {
            "error": {
                "factors": {
                    name: {
                        "mu_star": {"value": mu_star, "low": mu_star, "high": high},
                        "sigma": {"value": sigma, "low": sigma, "high": sigma},
                        "n": 150 if mu_star is not None else 1,
                    }
                    for name, (mu_star, high, sigma) in factors.items()
                }
            }
        },
    }


def test_a_clearly_negligible_factor_is_proposed_with_the_numbers() -> None:
    snapshot = snapshot_of(length=(7.0, 7.5, 4.6), mass=(0.10, 0.11, 0.11), weight=(1.6, 1.7, 0.1))
    proposal = propose_fixing(snapshot, "error")
    assert proposal.factor == "mass"
    assert proposal.evidence == (
        "Over 150 elementary effects, mass has the least influence on error: mu* 0.1 (90 % "
        "interval 0.1 to 0.11), sigma 0.11. The upper limit is below 0.7, 10 % of the largest mu* "
        "(length, 7)."
    )
    assert [entry["factor"] for entry in proposal.table] == ["mass", "weight", "length"]
    assert proposal.table[0]["distance"] == pytest.approx((0.10**2 + 0.11**2) ** 0.5)


@pytest.mark.parametrize(("high", "fixed"), [(0.69, "mass"), (0.71, None), (0.9, None)])
def test_the_upper_limit_decides_not_the_estimate(high: float, fixed: str | None) -> None:
    snapshot = snapshot_of(length=(7.0, 7.5, 4.6), mass=(0.1, high, 0.1))
    assert propose_fixing(snapshot, "error").factor == fixed
    assert least_influential(snapshot, "error") == "mass"


def test_a_factor_that_acts_by_interaction_is_not_the_least_influential() -> None:
    """Its mu* is smaller, but it lies further from the origin of the plane."""
    snapshot = snapshot_of(length=(7.0, 7.5, 4.6), mass=(0.2, 0.3, 0.1), tissue=(0.1, 0.2, 0.5))
    assert least_influential(snapshot, "error") == "mass"


def test_nothing_is_fixed_while_a_factor_has_no_estimate() -> None:
    snapshot = snapshot_of(length=(7.0, 7.5, 4.6), mass=(None, None, None))
    proposal = propose_fixing(snapshot, "error")
    assert proposal.factor is None
    assert "mass has 1 elementary effects on error, and an interval needs" in proposal.evidence
    assert least_influential(snapshot, "error") == "length"
    empty = empty_snapshot(study_plan("morris", rows=3))
    assert least_influential(empty, "y") is None
    assert propose_fixing(empty, "y").factor is None


def test_nothing_is_fixed_when_nothing_matters() -> None:
    snapshot = snapshot_of(length=(0.0, 0.0, 0.0), mass=(0.0, 0.0, 0.0))
    assert propose_fixing(snapshot, "error").factor is None


def test_a_factor_without_influence_is_found_in_a_real_study() -> None:
    plan = study_plan("morris", rows=256)
    snapshot = analyse(plan, results_of(plan))
    assert propose_fixing(snapshot, "z").factor in ("a", "c")
    assert propose_fixing(snapshot, "y").factor is None


def test_screening_needs_a_screening_and_a_known_output() -> None:
    plan = study_plan("saltelli", rows=4)
    with pytest.raises(ValueError, match="needs a study of method morris, not saltelli"):
        propose_fixing(empty_snapshot(plan), "y")
    with pytest.raises(ValueError, match="the study has no output 'x': it has y, z"):
        least_influential(empty_snapshot(study_plan("morris", rows=4)), "x")


def shares(**factors: tuple[float | None, float | None, float | None]) -> dict[str, Any]:
    """Return factors given as (low, ST, high)."""
    return {
        name: {"total_order": {"low": low, "value": value, "high": high}, "n": 256}
        for name, (low, value, high) in factors.items()
    }


@pytest.mark.parametrize(
    ("factor", "kind"),
    [
        ((0.2, 0.3, 0.5), "influential"),
        ((0.05, 0.3, 0.5), "influential"),
        ((0.01, 0.04, 0.07), "undecided"),
        ((0.0, 0.01, 0.049), "non_influential"),
        ((0.0, 0.0, 0.0), "non_influential"),
        ((None, 0.3, None), "undecided"),
        ((None, None, None), "undecided"),
    ],
)
def test_a_factor_matters_if_its_whole_interval_is_above_the_threshold(
    factor: tuple[float | None, float | None, float | None], kind: str
) -> None:
    found = influence(shares(a=factor, other=(0.5, 0.6, 0.7)), "saltelli", trusted=True)
    assert found.threshold == 0.05 and found.by == "total_order"
    assert "a" in getattr(found, kind)
    everywhere = (*found.influential, *found.non_influential, *found.undecided)
    assert sorted(everywhere) == ["a", "other"]


def test_before_any_estimate_there_is_no_threshold_and_where_nothing_acts_nothing_matters() -> None:
    nothing = influence(shares(a=(None, None, None)), "saltelli", trusted=True)
    assert (nothing.threshold, nothing.undecided) == (None, ("a",))
    idle = {"mu_star": {"low": 0.0, "value": 0.0, "high": 0.0}, "n": 256}
    still = influence({"a": idle, "b": idle}, "morris", trusted=True)
    assert (still.threshold, still.non_influential) == (0.0, ("a", "b"))


@pytest.mark.parametrize(("high", "n", "enough"), [(0.04, 128, True), (0.0, 128, False)])
def test_what_moved_nothing_at_all_takes_more_rows_to_be_called_non_influential(
    high: float, n: int, enough: bool
) -> None:
    """An event in 0.015 of the cube is missed by 128 rows in 2 of 100 studies."""
    factor = {"total_order": {"low": 0.0, "value": 0.0, "high": high}, "n": n}
    found = influence({"a": factor}, "saltelli", trusted=True)
    assert found.non_influential == (("a",) if enough else ())


def test_a_sample_that_cannot_be_trusted_calls_no_factor_non_influential() -> None:
    few = influence(shares(a=(0.0, 0.01, 0.02)), "saltelli", trusted=False)
    assert (few.non_influential, few.undecided) == ((), ("a",))


@pytest.mark.parametrize(
    ("worst", "hidden", "called"),
    [(1.0, True, False), (None, True, False), (0.03, True, True), (1.0, False, True)],
)
def test_no_factor_is_non_influential_that_runs_may_hide_which_fail_where_factors_say_so(
    worst: float | None, hidden: bool, called: bool
) -> None:
    """It was, two lines below "the true ST lies within 0.002 to 1": a stranger's."""
    factors = shares(a=(0.0, 0.01, 0.02))
    bounds = {"total_order": {"low": 0.0, "value": 0.1, "high": worst}}
    factors["a"]["worst_case"] = bounds if worst is not None else None
    found = influence(factors, "saltelli", trusted=True, hidden=hidden)
    assert found.non_influential == (("a",) if called else ())


@pytest.mark.parametrize(("n", "fixed"), [(127, None), (128, "mass")])
def test_nothing_is_fixed_on_fewer_than_128_rows(n: int, fixed: str | None) -> None:
    snapshot = snapshot_of(length=(7.0, 7.5, 4.6), mass=(0.1, 0.11, 0.1))
    for factor in snapshot["outputs"]["error"]["factors"].values():
        factor["n"] = n
    found = propose_fixing(snapshot, "error")
    assert found.factor == fixed
    said = "127 rows are too few to call a factor non-influential." in found.evidence
    assert said == (fixed is None)
