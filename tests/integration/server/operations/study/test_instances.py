"""What is written of a lease, whether it comes whole or in parts."""

from collections.abc import Callable

import pytest
import sqlalchemy as sa
from sqlalchemy.engine import Engine

from server.logic.fleet.verdicts import Report
from server.logic.study.points import instance_id
from server.operations import check
from server.operations.fleet import leases
from server.operations.fleet.exchange import Grant
from server.operations.study import studies
from server.records import Place, Plan
from server.store.database.engine import reading
from server.store.database.schema import instances
from tests.testbed.coordinators import exchanges

Leasing = Callable[..., Grant]

#: Instances in a row of the study.
WIDTH = 4


@pytest.fixture
def grants(engine: Engine, plan: Callable[..., Plan], lease: Leasing) -> tuple[Grant, Grant]:
    """Leases of two workers in rows 0 to 2: the first one's begins and ends within a row."""
    studies.create(engine, plan(rows=4), key=None, digest="", now=0.0)
    lease("early", 1)
    return lease("w", 10), lease("v", 5)


def standing(engine: Engine, grant: Grant) -> dict[Place, tuple[str, str | None]]:
    """Return state and lease of every instance of a lease."""
    query = sa.select(
        instances.c.row, instances.c.position, instances.c.state, instances.c.lease_id
    )
    with reading(engine) as connection:
        found = {(r.row, r.position): (r.state, r.lease_id) for r in connection.execute(query)}
    return {place: found[place] for place in grant.lease.instances}


def post(
    engine: Engine, grant: Grant, report: Callable[..., Report], *places: Place, **changes: str
) -> None:
    reports = [report(instance_id(grant.study.id, *place), **changes) for place in places]
    assert set(exchanges.hand_in(engine, grant.lease, reports, now=1.0)) == {"accepted"}


@pytest.mark.parametrize(
    "chosen",
    [
        lambda place: True,
        lambda place: place == (1, 2),
        lambda place: place[0] == 1,
        # Nothing is said of the row between.
        lambda place: place[0] != 1,
        lambda place: place != (2, 2),
    ],
    ids=["all", "one", "a row", "rows apart", "all but the last"],
)
def test_what_was_posted_is_done_and_the_rest_is_held_as_before(
    engine: Engine,
    grants: tuple[Grant, Grant],
    report: Callable[..., Report],
    chosen: Callable[[Place], bool],
) -> None:
    mine, theirs = grants
    posted = [place for place in mine.lease.instances if chosen(place)]
    post(engine, mine, report, *posted)
    held = ("leased", mine.lease.id)
    assert standing(engine, mine) == {
        place: ("done", None) if place in posted else held for place in mine.lease.instances
    }
    assert set(standing(engine, theirs).values()) == {("leased", theirs.lease.id)}
    assert check.faults(engine) == []


def test_what_goes_wrong_waits_again_while_the_others_are_done(
    engine: Engine, grants: tuple[Grant, Grant], report: Callable[..., Report]
) -> None:
    mine, _ = grants
    first, *others = mine.lease.instances
    post(engine, mine, report, first, outcome="crashed")
    post(engine, mine, report, *others)
    assert standing(engine, mine) == {
        place: ("pending" if place == first else "done", None) for place in mine.lease.instances
    }
    assert check.faults(engine) == []


def test_late_results_of_two_leases_are_done_and_take_nothing_from_a_third(
    engine: Engine, grants: tuple[Grant, Grant], lease: Leasing, report: Callable[..., Report]
) -> None:
    mine, theirs = grants
    leases.release(engine, mine.lease.id, fence=mine.lease.fence, now=1.0)
    again = lease("u", 6)
    post(engine, mine, report, *mine.lease.instances)
    assert set(standing(engine, mine).values()) == {("done", None)}
    assert set(standing(engine, again).values()) == {("done", None)}
    assert set(standing(engine, theirs).values()) == {("leased", theirs.lease.id)}
    assert check.faults(engine) == []


def test_more_than_one_statement_takes_is_written_whole(
    engine: Engine, plan: Callable[..., Plan], lease: Leasing, report: Callable[..., Report]
) -> None:
    studies.create(engine, plan(rows=30), key=None, digest="", now=0.0)
    all_of_it = lease("w", 30 * WIDTH)
    post(engine, all_of_it, report, *all_of_it.lease.instances)
    (study,) = studies.every(engine)
    assert (study.state, study.ok_count, study.rows_complete) == ("complete", 30 * WIDTH, 30)
    assert check.faults(engine) == []
