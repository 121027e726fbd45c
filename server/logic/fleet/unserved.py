"""Why a study has nobody who works on it, in a sentence."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import inf

from server.logic.fleet.hosts import GONE_SECONDS, classes, objection_to_worker
from server.records import Study, Worker
from server.states import StudyState

#: Kinds of machines that are named at most, those with the most instances first.
MOST_KINDS = 3
#: Hosts that refuse a model that are named at most.
MOST_REFUSALS = 3


def why_it_waits(study: Study, alive: Sequence[Worker], listening: float = inf) -> str | None:
    """Return why no worker may have any of a study; None if one may.

    Args:
        alive: the workers that were heard from lately.
        listening: seconds since the coordinator began, before which nobody could be heard.
    """
    if not alive:
        return f"no worker was heard from {'yet' if listening < GONE_SECONDS else 'lately'}"
    model = study.plan.model
    able = [worker for worker in alive if "@" not in model or model in worker.models]
    if not able:
        return why_refused(model, alive) or f"no worker has the model {model}"
    objections = [objection_to_worker(study, worker) for worker in able]
    refused = list(dict.fromkeys(said for said in objections if said is not None))
    return None if None in objections else "; ".join(refused[:3])


def why_refused(model: str, alive: Iterable[Worker]) -> str | None:
    """Return why workers that have a model, or another version of it, refuse it; None: none do."""
    told = [f"{one.host} refuses it: {one.refused[model]}" for one in alive if model in one.refused]
    return "; ".join([*dict.fromkeys(told)][:MOST_REFUSALS]) or None


@dataclass(frozen=True, kw_only=True)
class Patience:
    """How long a begun row waits for its kind of machine before any other begins it anew."""

    seconds: float
    #: Since when the coordinator listens (seconds, UTC epoch): before, nobody could be heard.
    since: float


def why_its_rows_wait(
    study: Study,
    waiting: Mapping[str | None, int],
    heard: Sequence[Worker],
    *,
    now: float,
    patience: Patience,
) -> str | None:
    """Return which kinds of machines a study waits for that are gone; None if it does not.

    Args:
        study: the study.
        waiting: its instances of begun rows that nobody holds, by the class of machines that may
            have them; None: any.
        heard: the workers that were heard from while patience lasts.
        now: seconds, UTC epoch.
        patience: of begun rows.
    """
    if study.state == StudyState.RUNNING and study.pending > study.returned:
        # Any machine may begin another row.
        return None
    last: dict[str, float] = {}
    for worker in sorted(heard, key=lambda worker: worker.last_seen):
        last |= dict.fromkeys(classes(worker.versions, worker.models), worker.last_seen)
    kinds = [kind for kind in waiting if kind is not None]
    there = [kind for kind in kinds if last.get(kind, 0.0) > now - GONE_SECONDS]
    if not kinds or None in waiting or there:
        return None
    kinds.sort(key=lambda kind: (-waiting[kind], kind))
    told = [
        _told(kind, waiting[kind], last.get(kind), now, patience) for kind in kinds[:MOST_KINDS]
    ]
    return (
        f"{'; '.join(told)} (REHYB_STRANDED_SECONDS); `rehyb study rerun {study.id} --which all` "
        "begins the whole study anew at once"
    )


def _told(kind: str, count: int, last: float | None, now: float, patience: Patience) -> str:
    if last is None:
        silence, last = f"{_minutes(patience.seconds)} or longer", 0.0
    else:
        silence = _minutes(now - last)
    left = max(patience.since, last) + patience.seconds - now
    return (
        f"{_some(count, 'instance')} of begun rows can go to machines of class {kind} only, and "
        f"none of these was heard from for {silence}: their rows begin anew on any machine in "
        f"{_minutes(left)}"
    )


def _minutes(seconds: float) -> str:
    return _some(max(1, round(seconds / 60.0)), "minute")


def _some(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
