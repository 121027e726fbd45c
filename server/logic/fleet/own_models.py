"""Rehyb's own models, of which an older worker may lack some, or have them otherwise.

A worker names those that it has, and their versions, "name@digest". Older ones tell no versions.
"""

from collections.abc import Mapping, Sequence
from functools import cache, lru_cache

from models.built_in import built_in_models
from server.records import Introduction, Study

_TO_DO = "install the same rehyb here as on the coordinator"


@cache
def own_versions() -> Mapping[str, str]:
    """Return the versions of rehyb's own models that this coordinator knows, by name."""
    return {name: model.version for name, model in built_in_models().items()}


# A worker names the same ones at every request.
@lru_cache(maxsize=1024)
def worth_keeping(named: tuple[str, ...]) -> Sequence[str]:
    """Return which to keep of the models that a worker names: all but rehyb's own.

    Of these nothing is kept if it has all of them as the coordinator knows them, as nearly every
    worker does.
    """
    own = own_versions()
    found = [one for one in named if _name(one) in own]
    names = {one for one in found if "@" not in one}
    versions = {*found} - names
    same = names == own.keys() and versions in ({*own.values()}, set())
    others = [one for one in named if "@" in one and one not in versions]
    return others if same else [*others, *found]


def objection_to_models(study: Study, worker: Introduction) -> str | None:
    """Say in a sentence why a worker's own models of rehyb cannot do a study; None if they can."""
    return lacking(study.id, study.plan.model, worker) or _otherwise(study, worker)


def lacking(study_id: str, model: str, worker: Introduction) -> str | None:
    """Say in a sentence that a worker lacks a model of rehyb's own; None if it has it."""
    if "@" in model or model in worker.models or not _tells(worker):
        return None
    return f"study {study_id} samples {model}, which the rehyb of this worker lacks: {_TO_DO}"


def _otherwise(study: Study, worker: Introduction) -> str | None:
    """Say that a model of rehyb's own is another here, of a study that nobody has begun.

    Once begun it belongs to the code that began it. Before, a worker that lacks a factor of it
    would begin it, fail at every instance, and keep it from all others.
    """
    model = study.plan.model
    versions = {one for one in worker.models if "@" in one and _name(one) == model}
    if study.bound_to is not None or not versions or own_versions().get(model) in versions:
        return None
    return (
        f"study {study.id} samples {model}, which has other factors or outputs in the rehyb of "
        f"this worker: {_TO_DO}"
    )


def _tells(worker: Introduction) -> bool:
    """Say whether it is known which of rehyb's own models a worker has, since it lacks some."""
    return any(_name(one) in own_versions() for one in worker.models)


def _name(model: str) -> str:
    return model.partition("@")[0]
