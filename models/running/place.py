"""What a child process does with an instance of any model."""

import time
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Self

from models.built_in import evaluate_built_in, load_built_in
from models.description import Description, Kind
from models.evaluation import Evaluation, Evaluator, ModelAway, ModelFailure
from models.folder import ModelFolder, read_folder
from models.packages import announced
from models.running.outcomes import Outcome

#: That a child gets to end a program which has taken too long.
GRACE_SECONDS = 2.0


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where a child process finds what evaluates one model."""

    kind: Kind
    #: Of the version that is meant; other code in this place is refused.
    digest: str
    #: Of `model.toml`; the name of the entry point for a Python model.
    where: str
    #: Of the server, for a model of kind `umbridge`.
    url: str = ""
    time_limit: float | None = None

    @classmethod
    def of(cls, description: Description, where: str, url: str = "") -> Self:
        """Return the place of a model."""
        return cls(
            kind=description.kind,
            digest=description.digest,
            where=where,
            url=url,
            time_limit=description.time_limit,
        )

    @property
    def child_seconds(self) -> float | None:
        """How long an evaluation may keep a child that is then killed; None: no limit of its own.

        A program is ended by the child itself before, which hears what it said last.
        """
        if self.time_limit is None or self.kind != Kind.COMMAND:
            return self.time_limit
        return self.time_limit + GRACE_SECONDS


_CLOSING = ExitStack()


def evaluate(instance: Mapping[str, Any]) -> Evaluation:
    """Evaluate an instance: {"model", "parameters"}, and "place" and "seed" if it is not ours.

    Raises:
        ModelFailure: the model has no answer.
        ModelAway: the server that evaluates it does not answer.
    """
    place: Place | None = instance.get("place")
    if place is None:
        return evaluate_built_in(
            instance["model"], instance["parameters"], instance.get("curves", ())
        )
    model = evaluator(place)
    started = time.perf_counter()
    outputs = model(instance["parameters"], instance["seed"])
    return Evaluation(outcome="ok", outputs=outputs, wall_seconds=time.perf_counter() - started)


def load(instance: Mapping[str, Any]) -> None:
    """Have what evaluates an instance's model in this process, from now on.

    Raises:
        ModelFailure: "bad_model": it cannot be loaded.
    """
    place: Place | None = instance.get("place")
    if place is None:
        load_built_in(instance["model"])
    else:
        evaluator(place)


def _remote(folder: ModelFolder, url: str) -> Evaluator:
    from models.umbridge.client import RemoteModel, Server, ServerAwayError

    try:
        return RemoteModel(folder, Server(url))
    except ServerAwayError as error:
        raise ModelAway(str(error)) from None


@cache
def evaluator(place: Place) -> Evaluator:
    """Load what evaluates a model, once a process; heavy libraries are imported here only.

    Raises:
        ModelFailure: "bad_model": it cannot be loaded.
        ModelAway: the server that evaluates it does not answer.
    """
    try:
        if place.kind == Kind.PYTHON:
            from models.packages import PackagedModel, PackageError

            model = PackagedModel(announced()[place.where])
            if model.description.digest != place.digest:
                raise PackageError(f"{place.where} has changed since this worker started")
            return model
        folder = read_folder(Path(place.where))
        if place.kind == Kind.MJCF:
            from models.mjcf.simulate import Simulation

            return Simulation(folder)
        if place.kind == Kind.COMMAND:
            from models.command import Command

            command = Command(folder)
            _CLOSING.callback(command.close)
            return command
        return _remote(folder, place.url)
    except ValueError as error:
        # ModelError and PackageError among them.
        raise ModelFailure(Outcome.BAD_MODEL, str(error)) from None
