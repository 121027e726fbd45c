"""A turn: results and requests of workers, about one study, in one transaction.

On PostgreSQL a transaction waits for the server most of the time, and all that change one study
wait for each other. So those who wait share one, which reads and writes sets of rows.
"""

import re
from collections.abc import Callable, Iterable, Sequence

from sqlalchemy.engine import Connection

from server.logic.fleet.comparisons import GATHER_SECONDS
from server.logic.fleet.verdicts import Judgement
from server.operations.fleet import leasing, results
from server.operations.fleet.exchange import Deferred, Exchange, Post, Served
from server.operations.fleet.served import ServedStudy
from server.records import record
from server.store.fleet.turns import Turn, at_once, turn_within

#: A row as instances are called by it.
_ROW = re.compile(r"0|[1-9][0-9]{0,9}")


@record
class Taken:
    """What came of a turn."""

    #: What each is answered, in order.
    answers: Sequence[Served]
    #: The study to serve next whoever brings no results; empty: there is none.
    next_study: str = ""


async def take_turn(turn: Turn, study_id: str, waiting: Callable[[], Sequence[Exchange]]) -> Taken:
    """Serve all who wait, one after the other.

    Args:
        turn: the transaction.
        study_id: the study that is locked; empty: none.
        waiting: returns who waits, once it is: the longer that takes, the more there are.
    """
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
    served = ServedStudy(turn, study, seen, slots)
    # A lease may hold more than what is posted.
    if study is not None and (more := served.rows_of(posts) - named):
        served.fill(await turn.rows(study, more))
    answers = [await _serve(served, one) for one in exchanges]
    await served.write(end=True)
    # Only now every lease has its fence.
    answers = [served.with_fence(answer) for answer in answers]
    return Taken(answers=answers, next_study=next((first for first, _ in seen.work), ""))


async def _serve(served: ServedStudy, exchange: Exchange) -> Served:
    """Take in what a worker brings, give it what it asks for, and remember it."""
    served.begin(exchange.now)
    judgements: list[Judgement] = []
    posted, request = exchange.posted, exchange.request
    done = None
    if posted is not None:
        taken = await results.take(served, exchange, posted)
        if isinstance(taken, Deferred):
            return [], taken
        judgements, done = taken.judgements, taken.done
        if done is not None and (request is None or request.worker.id != posted.worker):
            heard = served.changes.heard
            heard[posted.worker] = heard.get(posted.worker, 0) + done
            done = 0
    if request is None:
        return judgements, None
    found = await leasing.grant(served, exchange, request)
    served.changes.workers.append((request.worker, request.host_class(), done or 0))
    return judgements, found


def serve_within(connection: Connection, exchange: Exchange) -> Served:
    """Serve one, in a turn of its own within a transaction that others begin and end."""
    turn = turn_within(connection)
    study, request = exchange.study, exchange.request
    if not study and request is not None:
        work, _ = at_once(turn.wanted((), asked_by=0.0))
        study = next((first for first, model in work if model in request.models), "")
    (answer,) = at_once(take_turn(turn, study, lambda: [exchange])).answers
    return answer


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
