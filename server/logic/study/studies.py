"""The life of a study: what each event makes of it and its counters."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

from server.errors import ConflictError
from server.logic.study.plans import check_rows
from server.records import Instance, Place, Result, Study
from server.states import InstanceState, Outcome, StudyState

# Looked up once: in Python 3.11 a member of an enum takes as long as a call.
_LEASED, _DONE, _OK = InstanceState.LEASED, InstanceState.DONE, Outcome.OK


def new_rows(study: Study, count: int) -> tuple[list[Place], int]:
    """Return the places in as many new rows as `count` instances take, and how many are wanted."""
    width = study.plan.width
    first = study.handed_out
    count = min(count, study.plan.instances - first)
    whole = -(-count // width) * width
    return [divmod(number, width) for number in range(first, first + whole)], count


def handed_out(study: Study, *, begun: int, leased: int, identity: Mapping[str, str]) -> Study:
    """Return a study after a lease.

    Args:
        begun: instances in rows that the lease begins.
        leased: instances that it holds.
        identity: the code of who gets it, to which the study belongs if it does to none.
    """
    return replace(
        study,
        handed_out=study.handed_out + begun,
        leased=study.leased + leased,
        identity=identity if study.bound_to is None else study.identity,
    )


def with_changes(
    study: Study,
    *,
    before: Mapping[Place, Instance],
    after: Mapping[Place, Instance],
    filed: Sequence[Result],
    now: float,
) -> Study:
    """Return a study of which instances changed; complete if this was the last of it.

    Args:
        before: all instances of the rows concerned as they were.
        after: those that changed, as they are now: pending or done.
    """
    done = study.result_count + len(filed)
    failed = [result.outcome for result in filed if result.outcome != _OK]
    finished = bool(filed) and done == study.plan.instances and study.state != StudyState.CANCELLED
    # A row is complete with the last of its results, so no row is counted twice.
    open_rows = {row for (row, _), one in {**before, **after}.items() if one.state != _DONE}
    return drained(
        replace(
            study,
            leased=study.leased - sum(before[place].state == _LEASED for place in after),
            result_count=done,
            ok_count=study.ok_count + len(filed) - len(failed),
            failures=dict(Counter(study.failures) + Counter(failed)) if failed else study.failures,
            rows_complete=study.rows_complete + len({result.row for result in filed} - open_rows),
            state=StudyState.COMPLETE if finished else study.state,
            finished_at=now if finished else study.finished_at,
        )
    )


def with_found(study: Study, found: Sequence[Result]) -> Study:
    """Return a study in which results have come for instances that were given up as lost."""
    failed = [result.outcome for result in found if result.outcome != Outcome.OK]
    failures = Counter(study.failures) - Counter({Outcome.LOST: len(found)}) + Counter(failed)
    return replace(
        study,
        ok_count=study.ok_count + len(found) - len(failed),
        failures=dict(failures),
        edition=study.edition + 1,
    )


def recounted(
    study: Study, *, outcomes: Mapping[str, int], rows_complete: int, leased: int
) -> Study:
    """Return a study some of whose results were taken back; it runs again if work is left.

    Args:
        outcomes: how many final results it has, by outcome.
        rows_complete: rows in which every position has one.
        leased: instances that workers hold.
    """
    done = sum(outcomes.values())
    again = study.state == StudyState.COMPLETE and done < study.plan.instances
    return replace(
        study,
        result_count=done,
        ok_count=outcomes.get(Outcome.OK, 0),
        failures={name: count for name, count in outcomes.items() if name != Outcome.OK},
        rows_complete=rows_complete,
        leased=leased,
        state=StudyState.RUNNING if again else study.state,
        finished_at=None if again else study.finished_at,
        edition=study.edition + 1,
    )


def switched(study: Study, state: StudyState) -> Study:
    """Return the study in `state`; ConflictError if it has ended."""
    if study.state.has_ended:
        raise ConflictError(f"study {study.id} is {study.state}: it cannot become {state}")
    return drained(replace(study, state=state))


def cancelled(study: Study, now: float) -> Study:
    """Return the study cancelled; ConflictError if it is complete."""
    if study.state == StudyState.COMPLETE:
        raise ConflictError(f"study {study.id} is already complete")
    if study.state == StudyState.CANCELLED:
        return study
    return replace(study, state=StudyState.CANCELLED, finished_at=now)


def extended(study: Study, rows: int) -> Study:
    """Return the study with as many rows; what there is of it stays as it is.

    Raises:
        InvalidStudyError: no study can have that many.
        ConflictError: this one cannot.
    """
    check_rows(study.plan.method, rows)
    if (objection := _objection_to_extension(study, rows)) is not None:
        raise ConflictError(f"study {study.id} cannot have {rows} rows: {objection}")
    if rows == study.plan.rows:
        return study
    resumed = study.state == StudyState.COMPLETE
    return replace(
        study,
        plan=replace(study.plan, rows=rows),
        state=StudyState.RUNNING if resumed else study.state,
        finished_at=None if resumed else study.finished_at,
        edition=study.edition + 1,
    )


def _objection_to_extension(study: Study, rows: int) -> str | None:
    """Say in a sentence why a study cannot have `rows` rows; None if it can."""
    if study.state == StudyState.CANCELLED:
        return "it was cancelled"
    if rows < study.plan.rows:
        return f"it has {study.plan.rows} rows, and a study never shrinks"
    return None


def drained(study: Study) -> Study:
    """Return a draining study paused, if all of its begun rows are done; any other as it is."""
    if study.state == StudyState.DRAINING and study.handed_out == study.result_count:
        return replace(study, state=StudyState.PAUSED)
    return study
