"""The life of closing the loop on one session: waiting -> running -> done or failed.

One lease holds one of them. What says more about a machine than about the session (a crash, a time
out, a report that makes no sense, silence) is tried again on the budgets that instances have; that
the session cannot be analysed is final at once.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import ceil, isfinite
from typing import Any

from server.logic.leases import Lease, expiry
from server.logic.slots import BUDGETS

#: What a worker hands in, and how each file is called where it is read.
FILES = ("report.json", "report.html", "model_after.xml", "residuals.csv")
VERDICTS = ("adequate", "effect_found", "unexplained", "not_identifiable")
#: A report is tens of kilobytes.
MAX_REPORT_BYTES = 8_000_000
#: Levels of nesting it may have.
REPORT_DEPTH = 64
#: Outcomes a worker may report besides "bad_session".
RETRIED = ("crashed", "timed_out")
#: The session cannot be analysed: no other machine could.
BAD_SESSION = "bad_session"
#: Questions for work that idle workers may ask in all, and how long one may stay away, seconds.
ASKS_PER_SECOND = 5
ASK_SECONDS = (2, 15)
#: Characters kept of a progress line, and of a reason.
PROGRESS_LENGTH, REASON_LENGTH = 200, 4000


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """One lease of a job."""

    lease: str
    fence: int
    worker: str
    host: str
    granted_at: float
    #: How it ended: "done", "lost", "late" (another was faster) or a cause; None while it lasts.
    ended: str | None = None
    reason: str = ""


@dataclass(frozen=True, kw_only=True)
class Proof:
    """What a worker shows to speak for a job."""

    lease: str
    fence: int
    worker: str


@dataclass(frozen=True, kw_only=True)
class CloseLoop:
    """Closing the loop on one session, once."""

    id: str
    session_id: str
    #: "waiting", "running", "done" or "failed".
    state: str
    created_at: float
    finished_at: float | None = None
    #: When its lease ends; None unless running.
    expires_at: float | None = None
    #: How often it was handed out: the fence of its last lease.
    grants: int = 0
    attempts: tuple[Attempt, ...] = ()
    #: What its worker last said it is at.
    progress: str = ""
    #: Digest of the code that the report comes from.
    code: str | None = None
    #: Why it failed: {"outcome", "detail", "file", "column", "line"}.
    fault: Mapping[str, Any] | None = None
    verdict: str | None = None

    @property
    def current(self) -> Attempt | None:
        """The attempt that is under way; None unless running."""
        return self.attempts[-1] if self.state == "running" else None

    @property
    def avoid(self) -> str | None:
        """The host on which it last went wrong: another is to try next, if there is one."""
        return self.attempts[-1].host if self.state == "waiting" and self.attempts else None


def answers(job: CloseLoop, code: str) -> bool:
    """Say whether `job` will do for somebody who asks to close the loop with `code`."""
    return job.state in ("waiting", "running") or (job.state == "done" and job.code == code)


def handed_out(
    job: CloseLoop, *, lease: str, worker: str, host: str, now: float, ttl: float
) -> CloseLoop:
    """Return a waiting job as it is under a new lease."""
    fence = job.grants + 1
    attempt = Attempt(lease=lease, fence=fence, worker=worker, host=host, granted_at=now)
    return replace(
        job,
        state="running",
        expires_at=expiry(now, ttl),
        grants=fence,
        attempts=(*job.attempts, attempt),
        progress="",
    )


def ask_again_in(workers: int) -> int:
    """Return the seconds after which one of so many workers without a job should ask again.

    The more there are, the less each has to: together they notice a new job soon enough.
    """
    low, high = ASK_SECONDS
    return min(max(low, ceil(workers / ASKS_PER_SECOND)), high)


def lease_of(job: CloseLoop, lease: str) -> Lease | None:
    """Return one of a job's leases, as `server.logic.leases` judges them; None if it never was."""
    for attempt in job.attempts:
        if attempt.lease == lease:
            held = attempt is job.current
            return Lease(
                id=lease,
                fence=attempt.fence,
                worker=attempt.worker,
                study="",
                state="open" if held else (attempt.ended or "finished"),
                expires_at=(job.expires_at or 0.0) if held else 0.0,
                instances=(),
            )
    return None


def released(job: CloseLoop) -> CloseLoop:
    """Return a running job that its worker gave up unharmed: nothing is counted."""
    return replace(job, state="waiting", expires_at=None, attempts=job.attempts[:-1], progress="")


def after_attempt(job: CloseLoop, *, cause: str, reason: str, now: float) -> CloseLoop:
    """Return a running job whose attempt ended for `cause`, a key of BUDGETS.

    It waits again or, the budget spent, has failed.
    """
    job = _ended(job, cause, reason)
    if sum(attempt.ended == cause for attempt in job.attempts) < BUDGETS[cause]:
        return replace(job, state="waiting", expires_at=None, progress="")
    return failed(job, outcome=cause, detail=reason, now=now)


def failed(
    job: CloseLoop,
    *,
    outcome: str,
    detail: str,
    now: float,
    where: Mapping[str, str | int | None] | None = None,
) -> CloseLoop:
    """Return a job that has failed for good; `where`: file, column and line of a bad session."""
    place = where or {"file": None, "column": None, "line": None}
    return replace(
        job if job.current is None else _ended(job, outcome, detail),
        state="failed",
        expires_at=None,
        finished_at=now,
        fault={"outcome": outcome, "detail": detail, **place},
    )


def finished(job: CloseLoop, lease: str, *, code: str, verdict: str, now: float) -> CloseLoop:
    """Return a job whose report came under `lease`, which may be an older one than that it has."""
    attempts = tuple(
        replace(attempt, ended="done", reason="")
        if attempt.lease == lease
        else replace(attempt, ended=attempt.ended or "late")
        for attempt in job.attempts
    )
    return replace(
        job,
        state="done",
        expires_at=None,
        finished_at=now,
        attempts=attempts,
        code=code,
        verdict=verdict,
        fault=None,
    )


def verdict_of(report: bytes) -> str:
    """Return the verdict of a report.json that a worker hands in.

    Raises:
        ValueError: it is no report; the message says why.
    """
    if len(report) > MAX_REPORT_BYTES:
        raise ValueError(f"report.json has more than {MAX_REPORT_BYTES} bytes")
    content = parsed(report)
    if not _is_plain(content):
        raise ValueError(
            f"report.json is nested more than {REPORT_DEPTH} deep, or has a number without end"
        )
    if content.get("schema") != 1 or content.get("verdict") not in VERDICTS:
        raise ValueError(f"report.json must have schema 1 and a verdict of {', '.join(VERDICTS)}")
    return str(content["verdict"])


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


def _is_plain(content: Any) -> bool:
    """Say whether a parsed value can be written as JSON again by any reader."""
    left = [(content, 0)]
    while left:
        value, depth = left.pop()
        if depth > REPORT_DEPTH or (isinstance(value, float) and not isfinite(value)):
            return False
        if isinstance(value, dict | list):
            inside = value.values() if isinstance(value, dict) else value
            left.extend((item, depth + 1) for item in inside)
    return True


def cut(text: str, length: int) -> str:
    """Return a worker's text as it is kept: PostgreSQL cannot store the character NUL."""
    return text.encode(errors="replace").decode().replace("\0", "")[:length]


def attempts_from_json(content: Sequence[Mapping[str, Any]]) -> tuple[Attempt, ...]:
    """Return the attempts of a job as they were stored."""
    return tuple(Attempt(**entry) for entry in content)


def attempts_to_json(attempts: Sequence[Attempt]) -> list[dict[str, Any]]:
    """Return the attempts of a job as they are stored."""
    return [asdict(attempt) for attempt in attempts]


def _ended(job: CloseLoop, how: str, reason: str) -> CloseLoop:
    last = replace(job.attempts[-1], ended=how, reason=reason)
    return replace(job, attempts=(*job.attempts[:-1], last))
