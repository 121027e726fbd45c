"""What a group of workers may have of the work that waits: whoever starts more asks for them.

Workers of a group have ids that begin with its name and an @, which is in no name of a group or of
a host (`worker.machine`). They are taken to be alike, so that the latest of them tell what the next
one could do.
"""

from collections.abc import Mapping, Sequence

from server.logic.fleet.hosts import classes, objection_to_worker
from server.logic.fleet.unserved import why_refused
from server.records import Study, Worker, record
from server.states import StudyState

#: So many of a group's latest workers tell what it can do: its machines may differ.
LATEST = 10
#: Seconds after which somebody may have mended what no worker of a group could do.
LOOK_AGAIN_SECONDS = 900.0
#: Reasons that are told at most, those of studies with the most instances first.
MOST_REASONS = 3


def beginning(group: str) -> str:
    """Return how the ids of a group's workers begin."""
    return f"{group}@"


@record
class Waiting:
    """What waits of one study."""

    study: Study
    #: Instances that could be handed out.
    count: int
    #: Those of them that can go to one kind of machine only, by kind; None: to any.
    by_class: Mapping[str | None, int]
    #: Whether its model's code is at the coordinator, or one of the group said to have it: a worker
    #: asks for its work only once it has tried the model, and is not to be sent away before.
    to_be_had: bool


@record
class Share:
    """What a group may have of what waits."""

    waiting: int
    #: Instances for which another kind of worker must come.
    unfit: int = 0
    #: Why, in a sentence; empty: there are none.
    why: str = ""


def to_hand_out(study: Study) -> int:
    """Return how many instances of a study could be handed out now."""
    if study.state == StudyState.RUNNING:
        return study.pending
    return study.returned if study.state == StudyState.DRAINING else 0


def share(found: Sequence[Waiting], latest: Sequence[Worker], *, now: float) -> Share:
    """Return what a group may have of what waits.

    If nobody has looked for long, one instance of what is unfit counts as waiting: so one worker
    comes and shows whether that has changed.

    Args:
        found: what waits.
        latest: of the group, who was heard from last; none: nobody knows what it can do.
        now: seconds, UTC epoch.
    """
    whole = sum(one.count for one in found)
    if not latest:
        return Share(waiting=whole)
    judged = [(one, *_unfit(one, latest)) for one in found]
    unfit = sum(count for _, count, _ in judged)
    reasons = [why for _, count, why in sorted(judged, key=lambda one: -one[1]) if count]
    looked = max(worker.last_seen for worker in latest)
    again = 1 if unfit and now >= looked + LOOK_AGAIN_SECONDS else 0
    why = "; ".join(list(dict.fromkeys(reasons))[:MOST_REASONS])
    return Share(waiting=whole - unfit + again, unfit=unfit, why=why)


def _unfit(one: Waiting, latest: Sequence[Worker]) -> tuple[int, str]:
    """Return how many instances of a study nobody of a group may have, and why."""
    study, model = one.study, one.study.plan.model
    able = [
        worker
        for worker in latest
        if "@" not in model
        or model in worker.models
        or (one.to_be_had and model not in worker.refused)
    ]
    if not able:
        refused = why_refused(model, latest)
        said = refused or "whose code none of these workers has (rehyb-worker --models or --allow)"
        return one.count, f"study {study.id} samples {model}{': ' if refused else ', '}{said}"
    objections = [objection_to_worker(study, worker) for worker in able]
    if None not in objections:
        return one.count, str(objections[0])
    kinds = set().union(*(classes(worker.versions, worker.models) for worker in able))
    strange = [count for kind, count in one.by_class.items() if kind not in (None, *kinds)]
    return sum(strange), f"begun rows of study {study.id} can go to another kind of machine only"
