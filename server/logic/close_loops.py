"""The life of a job on one session, to close the loop or to interpret it.

Waiting -> running -> done or failed.

One lease holds one of them. What says more about a machine than about the session (a crash, a time
out, a report that makes no sense, silence) is tried again on the budgets that instances have; that
the session cannot be analysed is final at once.
"""

import json
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

from analysis.closeloop.contract import SCHEMA, Verdict
from server.logic.fleet.hosts import GONE_SECONDS
from server.logic.fleet.leases import expiry
from server.logic.json_values import flaw_in
from server.logic.study.instances import BUDGETS
from server.records import Attempt, CloseLoopJob, Introduction, Lease
from server.states import CloseLoopState, JobKind, LeaseState

#: A report is tens of kilobytes.
MAX_REPORT_BYTES = 8_000_000
#: Levels of nesting it may have.
REPORT_DEPTH = 64
#: What an answer with a report says of its job: no report says it, or its file would tell others.
OF_JOB = ("id", "session_id", "state")
#: What is said of a recording that is like a bank's, or is not.
FAMILIAR, STRANGE = "familiar", "unfamiliar"
#: Characters kept of a progress line.
PROGRESS_LENGTH = 200
#: Of a worker that asks in vain it is written down only so often (seconds) that it is there.
NOTED_SECONDS = GONE_SECONDS / 4.0


def answers(
    job: CloseLoopJob,
    codes: Collection[str] | None,
    kind: JobKind = JobKind.CLOSE_LOOP,
    options: Mapping[str, Any] | None = None,
) -> bool:
    """Say whether `job` will do for somebody who asks for the same with one of `codes`.

    Args:
        job: what there is.
        codes: digests of what would answer now; None: whatever answered will do.
        kind: what is asked for.
        options: with what.
    """
    if (job.kind, job.options) != (kind, options):
        return False
    if job.state == CloseLoopState.DONE:
        return codes is None or job.code in codes
    return job.state != CloseLoopState.FAILED


def suits(job: CloseLoopJob, bank: str | None) -> bool:
    """Say whether a job is for a worker with this bank (None: it has none, and closes loops)."""
    if job.kind == JobKind.CLOSE_LOOP:
        return True
    wanted = (job.options or {}).get("bank")
    return bank is not None and wanted in (None, bank)


def handed_out(
    job: CloseLoopJob, *, lease: str, worker: Introduction, now: float, ttl: float
) -> CloseLoopJob:
    """Return a waiting job as it is under a new lease."""
    fence = job.grants + 1
    attempt = Attempt(lease=lease, fence=fence, worker=worker.id, host=worker.host, granted_at=now)
    return replace(
        job,
        state=CloseLoopState.RUNNING,
        expires_at=expiry(now, ttl),
        grants=fence,
        attempts=(*job.attempts, attempt),
        progress="",
    )


def is_noted(noted: float | None, now: float) -> bool:
    """Say whether it was written down lately, at `noted`, that a worker is there."""
    return noted is not None and noted <= now < noted + NOTED_SECONDS


def lease_of(job: CloseLoopJob, lease: str) -> Lease | None:
    """Return one of a job's leases, as `fleet.leases` judges them; None if it never was."""
    for attempt in job.attempts:
        if attempt.lease == lease:
            held = attempt is job.current
            return Lease(
                id=lease,
                fence=attempt.fence,
                worker=attempt.worker,
                study="",
                state=LeaseState.OPEN if held else (attempt.ended or LeaseState.FINISHED),
                expires_at=(job.expires_at or 0.0) if held else 0.0,
                instances=(),
            )
    return None


def released(job: CloseLoopJob) -> CloseLoopJob:
    """Return a running job that its worker gave up unharmed: nothing is counted."""
    return _waiting(replace(job, attempts=job.attempts[:-1]))


def after_attempt(job: CloseLoopJob, *, cause: str, reason: str, now: float) -> CloseLoopJob:
    """Return a running job whose attempt ended for `cause`, a key of BUDGETS.

    It waits again or, the budget spent, has failed.
    """
    job = _ended(job, cause, reason)
    if sum(attempt.ended == cause for attempt in job.attempts) < BUDGETS[cause]:
        return _waiting(job)
    return failed(job, outcome=cause, detail=reason, now=now)


def failed(
    job: CloseLoopJob,
    *,
    outcome: str,
    detail: str,
    now: float,
    where: Mapping[str, str | int | None] | None = None,
) -> CloseLoopJob:
    """Return a job that has failed for good; `where`: file, column and line of a bad session."""
    place = where or {"file": None, "column": None, "line": None}
    return replace(
        job if job.current is None else _ended(job, outcome, detail),
        state=CloseLoopState.FAILED,
        expires_at=None,
        finished_at=now,
        fault={"outcome": outcome, "detail": detail, **place},
    )


def finished(job: CloseLoopJob, lease: str, *, code: str, verdict: str, now: float) -> CloseLoopJob:
    """Return a job whose report came under `lease`, which may be an older one than that it has."""
    attempts = tuple(
        replace(attempt, ended="done", reason="")
        if attempt.lease == lease
        else replace(attempt, ended=attempt.ended or "late")
        for attempt in job.attempts
    )
    return replace(
        job,
        state=CloseLoopState.DONE,
        expires_at=None,
        finished_at=now,
        attempts=attempts,
        code=code,
        verdict=verdict,
        fault=None,
    )


def verdict_of(report: bytes, kind: JobKind = JobKind.CLOSE_LOOP) -> str:
    """Return the verdict of a report.json that a worker hands in.

    Of an interpretation it is FAMILIAR or STRANGE.

    Raises:
        ValueError: it is no report; the message says why.
    """
    if len(report) > MAX_REPORT_BYTES:
        raise ValueError(f"report.json has more than {MAX_REPORT_BYTES} bytes")
    content = parsed(report)
    if flaw_in(content, REPORT_DEPTH) is not None:
        raise ValueError(
            f"report.json is nested more than {REPORT_DEPTH} deep, has a number without end, or "
            "half of a character"
        )
    if taken := [name for name in OF_JOB if name in content]:
        raise ValueError(f"report.json may not have {', '.join(taken)}, which the coordinator says")
    if kind == JobKind.INTERPRETATION:
        familiar = content.get("familiar")
        if not isinstance(familiar, bool) or not _has_interval(content.get("stiffness")):
            raise ValueError("report.json must say stiffness with interval90, and familiar or not")
        return FAMILIAR if familiar else STRANGE
    if content.get("schema") != SCHEMA or content.get("verdict") not in [*Verdict]:
        raise ValueError(
            f"report.json must have schema {SCHEMA} and a verdict of {', '.join(Verdict)}"
        )
    return str(content["verdict"])


def _has_interval(entry: object) -> bool:
    if not isinstance(entry, dict):
        return False
    ends = entry.get("interval90")
    numbers = [entry.get("median"), *(ends if isinstance(ends, list) else ())]
    return len(numbers) == 3 and all(type(number) in (int, float) for number in numbers)


def parsed(report: bytes) -> dict[str, Any]:
    """Return a report.json as an object; ValueError if it holds none, or numbers that are none."""

    def refuse(word: str) -> float:
        raise ValueError(f"report.json holds {word}")

    try:
        content = json.loads(report, parse_constant=refuse)
    except (json.JSONDecodeError, UnicodeDecodeError):
        raise ValueError("report.json is not JSON") from None
    except RecursionError:
        raise ValueError("report.json is nested too deeply") from None
    if not isinstance(content, dict):
        raise ValueError("report.json must hold an object")
    return content


def _waiting(job: CloseLoopJob) -> CloseLoopJob:
    return replace(job, state=CloseLoopState.WAITING, expires_at=None, progress="")


def _ended(job: CloseLoopJob, how: str, reason: str) -> CloseLoopJob:
    last = replace(job.attempts[-1], ended=how, reason=reason)
    return replace(job, attempts=(*job.attempts[:-1], last))
