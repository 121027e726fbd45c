"""Which machines may work on one study, and which on one row of it.

MuJoCo promises the same bits for the same version on the same architecture only, and sensitivity
indices are differences within a row. So a study belongs to the code that began it, and a row to
one class of machines.
"""

import hashlib
import json
from collections.abc import Mapping
from functools import lru_cache

from server.logic.fleet.own_models import objection_to_models
from server.records import Introduction, Study

#: What must be equal on all machines of a study: another of these is another model.
IDENTITY = ("code", "mujoco")
#: What must be equal within a row. The canary is a digest of one nominal evaluation, so that
#: machines whose bits differ are told apart even where all versions agree.
HOST_CLASS = (*IDENTITY, "numpy", "platform", "cpu", "canary")
#: A worker without work asks at least twice within it (see `idling`): one that is silent for so
#: long is gone.
GONE_SECONDS = 60.0


def identity(versions: Mapping[str, str]) -> dict[str, str]:
    """Return the part of a worker's versions that a study is bound to."""
    return {name: versions[name] for name in IDENTITY if name in versions}


def host_class(versions: Mapping[str, str], canary: str = "") -> str:
    """Name the class of machines that a worker belongs to, 16 hexadecimal digits.

    `canary`: what it computes at a few points of the model in question; empty for rehyb's own,
    whose canary is among the versions, and for a model that is not deterministic.
    """
    known = [(name, versions[name]) for name in HOST_CLASS if name in versions]
    return _class_of((*known, *([("model", canary)] if canary else ())))


def classes(versions: Mapping[str, str], models: Mapping[str, str]) -> set[str]:
    """Return every class that a worker belongs to: one for each canary of its models."""
    return {host_class(versions, canary) for canary in {"", *models.values()}}


@lru_cache(maxsize=1024)
def _class_of(known: tuple[tuple[str, str], ...]) -> str:
    return hashlib.sha256(json.dumps(dict(known), sort_keys=True).encode()).hexdigest()[:16]


def objection_to_worker(study: Study, worker: Introduction) -> str | None:
    """Say in a sentence why a worker may not have instances of a study; None if it may."""
    if missing := [tag for tag in study.tags if tag not in worker.tags]:
        return f"study {study.id} is for workers tagged {', '.join(missing)} (rehyb-worker --tags)"
    if objection := objection_to_models(study, worker):
        return objection
    theirs = identity(worker.versions)
    if study.bound_to is None or study.bound_to == theirs:
        return None
    return (
        f"study {study.id} was begun with {_in_words(study.bound_to)}, but this worker has "
        f"{_in_words(theirs)}: install the same rehyb and MuJoCo here, or begin the study anew "
        f"with `rehyb study rerun {study.id} --which all`"
    )


def _in_words(found: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {found.get(name, 'unknown')}" for name in IDENTITY)
