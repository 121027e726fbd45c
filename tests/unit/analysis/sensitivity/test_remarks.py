"""What a reader is told besides the numbers, and that an old snapshot has less to tell."""

from analysis.sensitivity.remarks import remarks, warning
from analysis.sensitivity.service import analyse
from analysis.sensitivity.snapshot import empty_snapshot
from tests.testbed.studies import results_of, study_plan


def test_failures_ranking_and_precision_each_have_a_sentence() -> None:
    plan = study_plan("saltelli", rows=64)
    snapshot = analyse(plan, results_of(plan, failed=[(3, 1), (5, 0)]))
    said = remarks(snapshot, "y", target=0.05)
    failures, worst, ranking, few, screened, sequence, advice = said
    assert failures.startswith("2 of 320 runs failed (0.6%): too few to tell")
    assert worst.startswith("Whatever the failed runs would have said within the range of y that")
    assert "the true ST lies within: a 0." in worst
    assert ranking.endswith("the same order, 100% with a first.")
    assert few == "Intervals of fewer than 128 rows are not to be believed yet."
    assert screened.startswith("Non-influential on y (ST below 0.05; a dummy factor has 0): none")
    assert sequence.startswith("Points of one Sobol sequence depend on each other: intervals are")
    assert "more rows" in advice and "bring y to ±0.05" in advice
    assert warning(snapshot) == ""


def test_failures_that_depend_on_the_factors_are_a_warning() -> None:
    plan = study_plan("saltelli", rows=64)
    failed = [
        (r.row, r.position)
        for r in results_of(plan, lambda x: {"y": x["b"], "z": 0.0})
        if r.outputs["y"] > 1.5
    ]
    snapshot = analyse(plan, results_of(plan, failed=failed))
    assert "failures depend on the factors: b" in warning(snapshot)
    assert remarks(snapshot, "y")[0] == warning(snapshot)


def test_a_stiffness_that_no_line_describes_is_said_to_be_none() -> None:
    plan = study_plan("saltelli", rows=4)
    snapshot = analyse(plan, results_of(plan))
    outputs = snapshot["outputs"]
    outputs["stiffness_error"] = outputs["stiffness_error_authors"] = outputs["y"]
    outputs["stiffness_true_r2"] = {**outputs["z"], "mean": 0.97}
    outputs["stiffness_true_r2_authors"] = {**outputs["z"], "mean": 0.04}
    said = "A single stiffness does not describe these movements: a line explains, on average, 4%"
    assert any(r.startswith(said) for r in remarks(snapshot, "stiffness_error_authors"))
    for output in ("stiffness_error", "y"):
        assert not any("single stiffness" in r for r in remarks(snapshot, output))


def test_nothing_is_said_where_nothing_is_known() -> None:
    assert remarks(empty_snapshot(study_plan("morris", rows=3)), "y") == []
    assert remarks({"outputs": {"y": {}}}, "y") == []
    assert warning({"outputs": {}}) == ""


def test_an_index_that_few_rows_make_up_is_named() -> None:
    plan = study_plan("saltelli", rows=16)
    rare = results_of(plan, lambda x: {"y": float(x["b"] > 1.97), "z": x["a"]})
    snapshot = analyse(plan, rare)
    behind = {name: f["rests_on"] for name, f in snapshot["outputs"]["y"]["factors"].items()}
    assert behind["a"] is None and 0.9 < behind["b"] < 2.0
    said = " ".join(remarks(snapshot, "y"))
    assert "Few rows make up the total-order index of b on y: as many as 1.0 of equal" in said
    assert "more rows make it honest" in said
    assert "Few rows" not in " ".join(remarks(snapshot, "z"))


def test_a_screening_says_what_does_too_little_and_what_is_open() -> None:
    plan = study_plan("morris", rows=256)
    idle = results_of(plan, lambda x: {"y": x["a"] + 0.01 * x["b"], "z": x["b"]})
    said = " ".join(remarks(analyse(plan, idle), "y"))
    expected = (
        "Non-influential on y (μ* below 0.2, 10% of the largest; a dummy factor has 0): b, c."
    )
    assert expected in said and "Undecided" not in said
    few = analyse(plan, idle[:4])
    assert "a dummy factor has 0): none yet. Undecided: a, b, c." in " ".join(remarks(few, "y"))


def test_of_eight_sequences_nothing_is_said_against_their_intervals() -> None:
    plan = study_plan("saltelli", rows=16, sampling="owen_blocks")
    assert "Sobol sequence" not in " ".join(remarks(analyse(plan, results_of(plan)), "y"))


def test_an_interval_of_a_share_above_one_never_comes_without_a_remark() -> None:
    share = {"value": 1.05, "low": 1.0004, "high": 1.1}
    below = {"value": 0.99, "low": 0.9, "high": 1.1}
    snapshot = {
        "outputs": {
            "y": {
                "factors": {
                    "a": {"first_order": share, "total_order": below},
                    "b": {"first_order": below, "total_order": share, "n": 9},
                }
            }
        }
    }
    (said,) = remarks(snapshot, "y")
    assert said.startswith(
        "The whole interval of S of a, ST of b on y lies above 1, where no share"
    )
    snapshot["outputs"]["y"]["factors"] = {"a": {"first_order": below, "total_order": below}}
    assert remarks(snapshot, "y") == []
