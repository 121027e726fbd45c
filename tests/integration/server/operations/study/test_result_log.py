"""The store as the analysis sees it."""

from collections.abc import Callable

import pytest
from sqlalchemy.engine import Engine

from analysis.sensitivity.service import ResultLog, analyse, catch_up
from server.errors import NotFoundError
from server.logic.fleet.verdicts import Report
from server.logic.study.points import instance_id
from server.operations.fleet.exchange import Grant
from server.operations.study import studies
from server.operations.study.result_log import StoreResultLog
from server.records import Plan, Study
from server.states import StudyState
from tests.testbed.coordinators import exchanges


@pytest.fixture
def study(
    engine: Engine,
    plan: Callable[..., Plan],
    report: Callable[..., Report],
    lease: Callable[..., Grant],
) -> Study:
    """A study of two rows, of which five instances have results: 0, 1, 2, a failure, and 4."""
    study, _ = studies.create(engine, plan(seed=3), key=None, digest="", now=0.0)
    held = lease("w", 5).lease
    names = [instance_id(study.id, *place) for place in held.instances]
    reports = [report(name, outputs={"y": float(i)}) for i, name in enumerate(names)]
    reports[3] = report(names[3], outcome="diverged", outputs={})
    exchanges.hand_in(engine, held, reports, now=1.0)
    return study


def test_the_plan_names_the_sampled_factors_and_the_kept_outputs(
    engine: Engine, study: Study
) -> None:
    plan = StoreResultLog(engine).plan(study.id)
    assert (plan.id, plan.method, plan.seed, plan.sampling) == (study.id, "morris", 3, "sobol")
    assert (plan.rows, plan.factors, plan.outputs) == (2, ("x1", "x2", "x3"), ("y",))
    with pytest.raises(NotFoundError):
        StoreResultLog(engine).plan("nothing")


def test_results_come_in_the_order_of_their_numbers(engine: Engine, study: Study) -> None:
    log = StoreResultLog(engine)
    found = log.results_after(study.id, 0, 100)
    assert [(r.seq, r.row, r.position, r.outcome) for r in found] == [
        (1, 0, 0, "ok"),
        (2, 0, 1, "ok"),
        (3, 0, 2, "ok"),
        (4, 0, 3, "diverged"),
        (5, 1, 0, "ok"),
    ]
    assert [dict(r.outputs) for r in found] == [{"y": 0.0}, {"y": 1.0}, {"y": 2.0}, {}, {"y": 4.0}]
    assert [r.instance for r in found][4] == instance_id(study.id, 1, 0)
    assert [r.seq for r in log.results_after(study.id, 2, 2)] == [3, 4]
    assert log.results_after(study.id, 5, 100) == []


def test_a_commit_needs_the_cursor_it_read(engine: Engine, study: Study) -> None:
    log = StoreResultLog(engine)
    assert log.load(study.id) == (0, None)
    assert log.snapshot(study.id) is None
    assert log.studies_with_news() == [study.id]

    def commit(expected: int, cursor: int, state: bytes) -> bool:
        return log.commit(
            study.id,
            expected_cursor=expected,
            cursor=cursor,
            state=state,
            snapshot={"cursor": cursor},
        )

    assert not commit(2, 3, b"too early")
    assert commit(0, 3, b"first")
    assert not commit(0, 4, b"second was not first")
    assert log.load(study.id) == (3, b"first")
    assert log.studies_with_news() == [study.id]
    assert commit(3, 5, b"third")
    assert log.load(study.id) == (5, b"third")
    assert log.snapshot(study.id) == {"cursor": 5}
    assert log.studies_with_news() == []


def test_the_analysis_catches_up_with_what_a_single_pass_over_the_results_says(
    engine: Engine, study: Study
) -> None:
    log: ResultLog = StoreResultLog(engine)
    assert catch_up(log, study.id) == 5
    expected = analyse(log.plan(study.id), log.results_after(study.id, 0, 100))
    assert StoreResultLog(engine).snapshot(study.id) == expected
    assert catch_up(log, study.id) == 0


def test_a_running_study_has_news_for_the_analysis_when_a_row_is_complete(
    engine: Engine,
    study: Study,
    report: Callable[..., Report],
    lease: Callable[..., Grant],
) -> None:
    log = StoreResultLog(engine)
    studies.extend(engine, study.id, 3)
    catch_up(log, study.id)
    held = lease("w", 3).lease
    names = [instance_id(study.id, *place) for place in held.instances]
    for name in names[:2]:
        exchanges.hand_in(engine, held, [report(name)], now=2.0)
        assert log.studies_with_news() == []
    # Nothing more may come of a paused one, so what there is of its row is told.
    studies.switch(engine, study.id, StudyState.PAUSED)
    assert log.studies_with_news() == [study.id]
    studies.switch(engine, study.id, StudyState.RUNNING)
    assert log.studies_with_news() == []
    exchanges.hand_in(engine, held, [report(names[2])], now=4.0)
    assert log.studies_with_news() == [study.id]
    catch_up(log, study.id)
    assert log.studies_with_news() == []
    found = log.snapshot(study.id)
    assert found is not None and (found["rows_complete"], found["cursor"]) == (2, 8)
