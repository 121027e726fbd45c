"""Why a study has nobody who works on it, in a sentence."""

from collections.abc import Sequence

from server.logic.fleet.hosts import objection_to_worker
from server.records import Study, Worker


def why_it_waits(study: Study, alive: Sequence[Worker]) -> str | None:
    """Return why no worker may have any of a study; None if one may.

    Args:
        alive: the workers that were heard from lately.
    """
    if not alive:
        return "no worker was heard from lately"
    model = study.plan.model
    able = [worker for worker in alive if "@" not in model or model in worker.models]
    if not able:
        return f"no worker has the model {model}"
    objections = [objection_to_worker(study, worker) for worker in able]
    refused = list(dict.fromkeys(said for said in objections if said is not None))
    return None if None in objections else "; ".join(refused[:3])
