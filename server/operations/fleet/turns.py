"""A turn: results and requests of many workers, about one study, in one transaction.

On PostgreSQL a transaction waits for the server most of the time, and all that change one study
wait for each other. So those who wait share one, which reads and writes sets of rows. It serves
what workers do nearly always. Whatever is unusual it leaves to `results` and `leasing`,
which decide in the same way one by one.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

from server.logic.fleet.comparisons import GATHER_SECONDS
from server.operations.fleet.exchange import Answer, Exchange
from server.operations.fleet.leasing import Grant
from server.operations.fleet.results import Post
from server.operations.fleet.served import ServedStudy
from server.records import record
from server.store.fleet.turns import TurnConnection

#: A row as instances are called by it.
_ROW = re.compile(r"0|[1-9][0-9]{0,9}")


@record
class Turn:
    """What came of a turn."""

    #: What everybody is answered; None: it needs a transaction of its own.
    answers: Sequence[tuple[Exchange, Answer | None]]
    #: The study to serve next whoever brings no results; empty: there is none.
    next_study: str = ""


async def take_turn(
    store: TurnConnection, study_id: str, waiting: Callable[[], Sequence[Exchange]]
) -> Turn:
    """Serve all who wait.

    Args:
        study_id: the study that is locked; empty: none.
        waiting: returns who waits, once it is: the longer that takes, the more there are.
    """
    async with store.turn() as turn:
        study = await turn.lock(study_id)
        exchanges = waiting()
        posts = [one.posted for one in exchanges if one.posted is not None]
        hosts = {one.request.worker.host for one in exchanges if one.request is not None}
        named = set() if study is None else _rows_named(study.id, posts)
        seen, slots = await turn.look(
            study,
            leases_of=[post.lease for post in posts],
            hosts=hosts,
            asked_by=max((one.now for one in exchanges), default=0.0) - GATHER_SECONDS,
            rows=named,
            wanted={} if study is None else _wanted(exchanges, study.plan.model),
        )
        served = ServedStudy(study, seen, slots)
        # A lease may hold more than what is posted.
        if study is not None and (more := served.rows_of(posts) - named):
            served.fill(await turn.rows(study, more))
        answers = [(one, served.serve(one)) for one in exchanges]
        changes = served.changes()
        fences = {} if changes is None else await turn.write(changes)
    return Turn(
        answers=[(one, _with_fence(answer, fences)) for one, answer in answers],
        next_study=next((first for first, _ in seen.work), ""),
    )


def _rows_named(study_id: str, posts: Iterable[Post]) -> set[int]:
    """Return the rows of a study that posts name, as far as they do as they should."""
    named = (report.instance.split(":") for post in posts for report in post.reports)
    return {
        int(row[0])
        for whose, *row in named
        if whose == study_id and len(row) == 2 and _ROW.fullmatch(row[0])
    }


def _wanted(exchanges: Iterable[Exchange], model: str) -> dict[str, int]:
    """Return how many instances of a model are asked for, by kind of machine."""
    found: dict[str, int] = {}
    for one in exchanges:
        if one.request is not None:
            kind = one.request.host_class(model)
            found[kind] = found.get(kind, 0) + one.request.max_instances
    return found


def _with_fence(answer: Answer | None, fences: Mapping[str, int]) -> Answer | None:
    if answer is None:
        return None
    judgements, found = answer
    if isinstance(found, Grant):
        lease = replace(found.lease, fence=fences[found.lease.id])
        found = Grant(lease=lease, study=found.study)
    return judgements, found
