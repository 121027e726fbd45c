"""Second opinions: asking for them, comparing, and what they say of a host.

Whoever changes a study's comparisons has locked the study.
"""

import logging
from collections.abc import Iterable, Mapping, Sequence

from sqlalchemy.engine import Engine

from server.logic.fleet.comparisons import Reputation, concluded, is_comparable, put_back
from server.logic.fleet.verdicts import Judgement, Report, as_result, fault_in
from server.logic.study.points import instance_id
from server.records import Comparison, Lease, Place, Result, Study
from server.states import ComparisonState, Verdict
from server.store.database.engine import reading, writing
from server.store.fleet import comparisons
from server.store.study import studies

log = logging.getLogger(__name__)


def judge(
    study: Study,
    reports: Sequence[Report],
    *,
    asked: Iterable[Comparison],
    stored: Mapping[Place, Result],
    lease: Lease,
    tolerance: float,
    now: float,
) -> tuple[list[Judgement], list[Comparison], bool]:
    """Compare reports with the results that they were asked to be second opinions on.

    Args:
        study: the study.
        reports: of which some may be about anything.
        asked: what the lease was given.
        stored: the results in question, as far as they are still there.
        lease: under which they are reported.
        tolerance: largest relative difference of an output at which both agree.
        now: when.

    Returns:
        A judgement of each report, in order; the comparisons that changed; and whether the lease
        still holds anything.
    """
    given = {instance_id(study.id, one.row, one.position): one for one in asked}
    open_ones = {name for name, one in given.items() if one.state == ComparisonState.LEASED}
    known = {instance_id(study.id, *place) for place in lease.instances}
    judgements: list[Judgement] = []
    changed: list[Comparison] = []
    for report in reports:
        # Each counts once, also within one request.
        one = given.pop(report.instance, None)
        if one is None and report.instance in known:
            # Another host was quicker, or the result is gone: no work is lost.
            verdict, detail = Verdict.DUPLICATE, "a second opinion that is no longer asked for"
        elif one is None:
            verdict, detail = Verdict.UNKNOWN, "the lease does not hold this instance"
        elif report.instance not in open_ones:
            verdict, detail = Verdict.DUPLICATE, ""
        elif (fault := fault_in(report, study.plan.outputs, study.plan.curves)) is not None:
            verdict, detail = Verdict.INVALID, fault
            changed.append(put_back(one))
        else:
            verdict, detail = Verdict.ACCEPTED, "a second opinion"
            second = as_result(report, one.row, one.position, study.plan.outputs, study.plan.curves)
            first = stored.get((one.row, one.position))
            if first is None or not is_comparable(second):
                after = put_back(one)
            else:
                after = concluded(one, first, second, lease, tolerance=tolerance, now=now)
            changed.append(after)
            if after.state == ComparisonState.DISAGREED:
                about = {"study": study.id, "instance": report.instance, "worker": lease.worker}
                hosts = one.first_host, lease.host
                log.warning("hosts %s and %s disagree on an instance", *hosts, extra=about)
        open_ones.discard(report.instance)
        judgements.append(Judgement(about=report.instance, verdict=verdict, detail=detail))
    return judgements, changed, bool(open_ones)


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
