"""A turn: results and requests of workers, about one study, in one transaction.

On PostgreSQL a transaction waits for the server most of the time, and all that change one study
wait for each other. So those who wait share one, which reads and writes sets of rows.
"""

import re
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import TypeVar

from sqlalchemy.engine import Connection

from server.logic.fleet.comparisons import GATHER_SECONDS
from server.logic.fleet.verdicts import Judgement
from server.operations.fleet import leasing, results
from server.operations.fleet.exchange import Deferred, Exchange, Grant, Post, Served
from server.operations.fleet.served import ServedStudy
from server.records import record
from server.store.fleet.turns import Turn, at_once, turn_within

T = TypeVar("T")

#: A turn serves so many at most, and others only while it is about fewer instances than these: who
#: comes next should not wait long, and large requests gain nothing by company.
MOST = 100
MOST_INSTANCES = 500
#: A row as instances are called by it.
_ROW = re.compile(r"0|[1-9][0-9]{0,9}")


@record
class TurnOutcome:
    """What came of a turn."""

    #: What each is answered, in order.
    answers: Sequence[Served]
    #: The study to serve next whoever brings no results; empty: there is none.
    next_study: str = ""


async def take_turn(
    turn: Turn,
    study_id: str,
    waiting: Callable[[], Sequence[Exchange]],
    ahead: Callable[[Grant], object] = lambda _: None,
) -> TurnOutcome:
    """Serve all who wait, one after the other.

    Args:
        turn: the transaction.
        study_id: the study that is locked; empty: none.
        waiting: returns who waits, once it is: the longer that takes, the more there are.
        ahead: is given each lease before it is written, which may fail.
    """
    study = await turn.lock(study_id) if study_id else None
    exchanges = waiting()
    posts = [one.posted for one in exchanges if one.posted is not None]
    hosts = {one.request.worker.host for one in exchanges if one.request is not None}
    named = set() if study is None else _rows_named(study.id, posts)
    seen = await turn.look(
        study,
        leases_of=[post.lease for post in posts],
        hosts=hosts,
        asked_by=max((one.now for one in exchanges), default=0.0) - GATHER_SECONDS,
        rows=named,
        wanted={} if study is None else _wanted(exchanges, study.plan.model),
    )
    served = ServedStudy(turn, study, seen, exchanges)
    # A lease may hold more than what is posted.
    if study is not None and (more := served.rows_of(posts) - named):
        served.fill(await turn.rows(study, more))
    answers = [await _serve(served, one) for one in exchanges]
    for _, found in answers:
        if isinstance(found, Grant):
            ahead(found)
    await served.write(end=True)
    # Only now every lease has its fence.
    answers = [served.with_fence(answer) for answer in answers]
    return TurnOutcome(answers=answers, next_study=next((first for first, _ in seen.work), ""))


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


def serve_within(connection: Connection, exchanges: Sequence[Exchange]) -> list[Served]:
    """Serve all in as many turns as it takes, in a transaction that others begin and end."""
    served: dict[int, Served] = {}
    waiting = [*enumerate(exchanges)]
    while waiting:
        turn = turn_within(connection)
        first = waiting[0][1]
        study = first.study
        if not study and first.request is not None:
            work, _ = at_once(turn.wanted((), asked_by=0.0))
            study = next((one for one, model in work if model in first.request.models), "")
        taken, waiting = next_turn(waiting, study)
        together = [one for _, one in taken]
        found = at_once(take_turn(turn, study, partial(list, together)))
        served |= zip((number for number, _ in taken), found.answers, strict=True)
    return [served[number] for number in range(len(exchanges))]


def next_turn(
    waiting: Sequence[tuple[T, Exchange]], study: str
) -> tuple[list[tuple[T, Exchange]], list[tuple[T, Exchange]]]:
    """Return whom the next turn serves, who bring results of a study or none; and who waits on."""
    taken: list[tuple[T, Exchange]] = []
    left: list[tuple[T, Exchange]] = []
    instances = 0
    for one in waiting:
        full = len(taken) == MOST or instances >= MOST_INSTANCES
        if full or one[1].study not in ("", study):
            left.append(one)
        else:
            taken.append(one)
            instances += one[1].size
    return taken, left


def _rows_named(study_id: str, posts: Iterable[Post]) -> set[int]:
    """Return the rows of a study that posts name, as far as they do as they should."""
    begin = f"{study_id}:"
    named = {report.instance.rpartition(":")[0] for post in posts for report in post.reports}
    rows = {name.removeprefix(begin) for name in named if name.startswith(begin)}
    return {int(row) for row in rows if _ROW.fullmatch(row)}


def _wanted(exchanges: Iterable[Exchange], model: str) -> dict[str, int]:
    """Return how many instances of a model are asked for, by host class."""
    found: dict[str, int] = {}
    for one in exchanges:
        if one.request is not None:
            host_class = one.request.host_class(model)
            found[host_class] = found.get(host_class, 0) + one.request.most(model)
    return found
