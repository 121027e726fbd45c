"""Taking final results back, so that their instances run again.

What is taken back is kept in the table `superseded`. The results left are numbered anew without
gaps, and the analysis starts over: indices are a function of the set of results, so they come out
as if the replaced ones had never been.
"""

from collections.abc import Sequence
from dataclasses import replace

from sqlalchemy.engine import Connection, Engine

from server.errors import ConflictError
from server.logic.fleet.hosts import classes
from server.logic.study.instances import reopened
from server.logic.study.studies import recounted
from server.records import Instance, Study
from server.states import InstanceState, StudyState
from server.store.database.engine import reading, writing
from server.store.fleet import comparisons, workers
from server.store.study import instances, reruns, snapshots, studies


def rerun(
    engine: Engine, study_id: str, *, which: str, outcomes: Sequence[str] | None, now: float
) -> tuple[Study, int]:
    """Run final results again; returns the study and how many results were taken back.

    Args:
        which: "failed": in their rows and on the same kind of machine; "all": every row, on any
            machine and with any version, as if the study had just been submitted.
        outcomes: only failures of these names; None: all of them.

    Raises:
        ConflictError: it is cancelled; or all of it shall run again while workers hold some.
    """
    with writing(engine) as connection:
        study = studies.find(connection, study_id, lock=True)
        if study.state == StudyState.CANCELLED:
            raise ConflictError(f"study {study_id} is cancelled: submit it again")
        if which == "failed":
            again = reruns.failed(connection, study_id, outcomes)
            return _reopen(connection, study, again, unbound=False, now=now, why=which)
        if study.leased:
            raise ConflictError(
                f"workers hold {study.leased} instances of study {study_id}: pause it and "
                "wait for them"
            )
        study = replace(study, identity=None)
        again = reruns.every(connection, study_id)
        return _reopen(connection, study, again, unbound=True, now=now, why=which)


def free_stranded_rows(engine: Engine, *, now: float, patience: float) -> int:
    """Begin anew, on any kind of machine, the rows that wait for a kind that is gone.

    A row waits in vain when no worker of its class was heard of for `patience` seconds. Rows of
    which a worker still holds something are left alone.

    Returns:
        How many rows were freed.
    """
    heard_after = now - patience
    with reading(engine) as connection:
        there = workers.heard(connection, after=heard_after)
        alive = set[str]().union(*(classes(one.versions, one.models) for one in there))
        concerned = reruns.studies_with_stranded(connection, alive=alive)
    freed = 0
    for study_id in concerned:
        with writing(engine) as connection:
            study = studies.find(connection, study_id, lock=True)
            again = reruns.stranded(connection, study_id, alive=alive)
            if again:
                _reopen(connection, study, again, unbound=True, now=now, why="stranded")
            freed += len({one.row for one in again})
    return freed


def _reopen(
    connection: Connection,
    study: Study,
    again: Sequence[Instance],
    *,
    unbound: bool,
    now: float,
    why: str,
) -> tuple[Study, int]:
    """Reopen instances of a locked study, whether or not they have a result."""
    instances.update(connection, study.id, [reopened(one, unbound=unbound) for one in again])
    done = {one.row for one in again if one.state == InstanceState.DONE}
    taken = reruns.take_back(connection, study.id, done, now=now, why=why)
    if taken:
        comparisons.forget(connection, study.id, taken)
        reruns.number_anew(connection, study.id)
        snapshots.forget(connection, study.id)
    outcomes, rows_complete, leased = reruns.count(connection, study)
    study = recounted(study, outcomes=outcomes, rows_complete=rows_complete, leased=leased)
    studies.save(connection, study)
    return study, len(taken)
