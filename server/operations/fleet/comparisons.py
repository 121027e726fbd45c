"""Second opinions: asking for them, comparing, and what they say of a host.

Whoever changes a study's comparisons has locked the study.
"""

import logging
from collections.abc import Iterable, Sequence

from sqlalchemy.engine import Connection, Engine

from server.logic.fleet.comparisons import Reputation, concluded, is_chosen, is_comparable, put_back
from server.logic.fleet.verdicts import Judgement, Report, as_result, fault_in
from server.logic.study.points import instance_id
from server.records import Lease, Result, Study
from server.states import ComparisonState, Verdict
from server.store import models
from server.store.database.engine import reading, writing
from server.store.fleet import comparisons, results
from server.store.study import studies

log = logging.getLogger(__name__)


def ask(
    connection: Connection,
    study: Study,
    found: Iterable[Result],
    lease: Lease,
    *,
    share: float,
    now: float,
) -> None:
    """Ask for second opinions on those new final results of a lease that are chosen for it.

    None is asked for on a model that is not deterministic: two of its numbers may differ.
    """
    chosen = [
        (result.row, result.position)
        for result in found
        if is_comparable(result) and is_chosen(study.plan.seed, result.row, result.position, share)
    ]
    if chosen and "@" in study.plan.model:
        model = models.find(connection, study.plan.model)
        if model is not None and not model.description.deterministic:
            return
    comparisons.add(connection, study.id, chosen, host=lease.host, worker=lease.worker, now=now)


def judge(
    connection: Connection,
    study: Study,
    reports: Sequence[Report],
    *,
    lease: Lease,
    tolerance: float,
    now: float,
) -> tuple[list[Judgement], bool]:
    """Compare reports with the results that they were asked to be second opinions on.

    `tolerance`: largest relative difference of an output at which both agree.

    Returns:
        A judgement of each report, in order, and whether the lease still holds anything.
    """
    stored = results.at(connection, study.id, lease.instances)
    asked = {
        instance_id(study.id, one.row, one.position): one
        for one in comparisons.of_lease(connection, lease.id)
    }
    open_ones = {name for name, one in asked.items() if one.state == ComparisonState.LEASED}
    judgements = []
    for report in reports:
        # Each counts once, also within one request.
        one = asked.pop(report.instance, None)
        if one is None:
            verdict, detail = Verdict.UNKNOWN, "the lease does not hold this instance"
        elif report.instance not in open_ones:
            verdict, detail = Verdict.DUPLICATE, ""
        elif (fault := fault_in(report, study.plan.outputs, study.plan.curves)) is not None:
            verdict, detail = Verdict.INVALID, fault
            comparisons.save(connection, put_back(one))
        else:
            verdict, detail = Verdict.ACCEPTED, "a second opinion"
            second = as_result(report, one.row, one.position, study.plan.outputs, study.plan.curves)
            first = stored.get((one.row, one.position))
            if first is None or not is_comparable(second):
                after = put_back(one)
            else:
                after = concluded(one, first, second, lease, tolerance=tolerance, now=now)
            comparisons.save(connection, after)
            if after.state == ComparisonState.DISAGREED:
                about = {"study": study.id, "instance": report.instance, "worker": lease.worker}
                hosts = one.first_host, lease.host
                log.warning("hosts %s and %s disagree on an instance", *hosts, extra=about)
        open_ones.discard(report.instance)
        judgements.append(Judgement(about=report.instance, verdict=verdict, detail=detail))
    return judgements, bool(open_ones)


def let_go(connection: Connection, lease: Lease, *, counted: bool) -> None:
    """Have what an ended lease still held wait again; `counted`: its worker fell silent."""
    for one in comparisons.of_lease(connection, lease.id):
        if one.state == ComparisonState.LEASED:
            comparisons.save(connection, put_back(one, counted=counted))


def give_up(engine: Engine, *, now: float, patience: float) -> None:
    """Ask no more about studies that no longer run and for which nobody came for `patience` s."""
    with reading(engine) as connection:
        concerned = comparisons.ended_studies_waiting(connection, asked_before=now - patience)
    for study_id in concerned:
        with writing(engine) as connection:
            studies.find(connection, study_id, lock=True)
            comparisons.abandon(connection, study_id, asked_before=now - patience)


def reputations(engine: Engine) -> dict[str, Reputation]:
    """Return how every host came out of its comparisons."""
    with reading(engine) as connection:
        counts = comparisons.counts(connection)
    return {host: Reputation(**found) for host, found in counts.items()}
