"""Which models this worker has, and how a child process evaluates each of them.

What is code runs here only because the worker's owner named it: folders (`--models`), packages
(`--allow`), servers (`--umbridge`). A model of kind `mjcf` is data, and is fetched when a study
wants it.
"""

import json
import logging
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any

from models.description import Description, Kind
from models.evaluation import Evaluation, Evaluator, ModelFailure
from models.folder import (
    MODEL_FILE,
    ModelError,
    ModelFolder,
    copied,
    read_folder,
    unpacked_into,
)
from models.packages import announced
from rehyb.client import Client
from rehyb.errors import RehybError
from sim.models import MODELS
from worker.outcomes import Outcome

log = logging.getLogger(__name__)

#: Seconds between two looks at which uploaded models are wanted.
LOOK_SECONDS = 2.0


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


def folders_in(paths: Sequence[Path]) -> Iterator[ModelFolder]:
    """Read every model's folder among `paths` and directly in them.

    Raises:
        ModelError: one of them cannot be used, or there is none in a path.
    """
    for path in paths:
        found = (
            [path]
            if (path / MODEL_FILE).is_file()
            else sorted(inner for inner in path.glob("*") if (inner / MODEL_FILE).is_file())
        )
        if not found:
            raise ModelError(f"there is no such file in {path}, nor in a folder in it")
        for folder in found:
            yield read_folder(folder)


@dataclass(kw_only=True)
class WorkerModels:
    """The models that this worker's children can evaluate, by name and digest."""

    client: Client
    #: Where fetched models are kept.
    cache: Path
    #: Of models that are not rehyb's own: what to announce, and where they are.
    announced: dict[str, Description] = field(default_factory=dict)
    places: dict[str, Place] = field(default_factory=dict)
    _wanted: tuple[str, ...] = ()
    _look_at: float = 0.0

    def have(
        self, folders: Sequence[Path], packages: Sequence[str], servers: Sequence[str]
    ) -> None:
        """Have the models that the worker's owner named.

        Args:
            folders: with a `model.toml`, or with such folders in them.
            packages: names of models that packages announce as `rehyb.models`.
            servers: URLs that speak UM-Bridge; the first that has a model of kind `umbridge`
                evaluates it.

        Raises:
            RehybError: one of them cannot be used.
        """
        try:
            for folder in folders_in(folders):
                url = (
                    _server_of(folder, servers) if folder.description.kind == Kind.UMBRIDGE else ""
                )
                self._add(folder.description, str(self._kept(folder)), url)
        except ModelError as error:
            raise RehybError(str(error)) from None
        for name in packages:
            description = described(name)
            if description.name != name:
                raise RehybError(f"the package announces {name} and calls it {description.name}")
            self._add(description, name)

    def _add(self, description: Description, where: str, url: str = "") -> None:
        if description.name in MODELS:
            raise RehybError(f"{description.name} is a model of rehyb's own: choose another name")
        version = description.version
        self.announced[version] = description
        self.places[version] = Place(
            kind=description.kind,
            digest=description.digest,
            where=where,
            url=url,
            time_limit=description.time_limit,
        )

    def _kept(self, folder: ModelFolder) -> Path:
        """Return a copy of a model's folder, which stays as it is however its owner goes on."""
        target = self.cache / folder.description.digest
        if not target.is_dir():
            self.cache.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(dir=self.cache, prefix="copying-") as scratch:
                self._moved(copied(folder, Path(scratch) / "model").path, target)
        return target

    def _moved(self, fresh: Path, target: Path) -> None:
        try:
            fresh.replace(target)
        except OSError:
            # Another worker on this machine was faster.
            if not target.is_dir():
                raise

    def announce(self, worker: str) -> None:
        """Tell the coordinator of the models whose code is here, with `worker`.

        Raises:
            RehybError: it does not take one of them.
        """
        for version, description in self.announced.items():
            self.client.announce_model(description.as_json(), worker)
            log.info("has the model %s", version)

    def names(self, now: float) -> tuple[str, ...]:
        """Return what to ask work for; now and then, look which uploaded models are wanted."""
        if now >= self._look_at:
            self._look_at = now + LOOK_SECONDS
            self._wanted = tuple(
                f"{model['name']}@{model['digest']}"
                for model in self.client.models(wanted=True)
                if model["kind"] == Kind.MJCF
            )
        return (*MODELS, *self.announced, *self._wanted)

    def prepared(self, instance: Mapping[str, Any]) -> dict[str, Any]:
        """Return an instance with all that a child needs; fetches its model if need be.

        Raises:
            RehybError: the model cannot be had.
        """
        version = instance["model"]
        if version in MODELS:
            return dict(instance)
        place = self.places.get(version)
        if place is None:
            place = self.places[version] = self._fetched(version)
        return {
            **instance,
            "place": place,
            "time_limit": place.time_limit,
            "seed": seed_of(instance["id"]),
        }

    def _fetched(self, version: str) -> Place:
        """Return where an uploaded model is, after fetching it once for all workers here."""
        digest = version.partition("@")[2]
        target = self.cache / digest
        if not target.is_dir():
            self.cache.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(dir=self.cache, prefix="fetching-") as scratch:
                archive, fresh = Path(scratch) / "model.zip", Path(scratch) / "model"
                self.client.model_archive(version, archive)
                fresh.mkdir()
                try:
                    found = read_folder(unpacked_into(archive, fresh))
                except ModelError as error:
                    raise RehybError(f"{version} cannot be used: {error}") from None
                if found.description.digest != digest:
                    raise RehybError(f"{version} arrived as {found.description.version}")
                self._moved(found.path, target)
        description = read_folder(target).description
        return Place(
            kind=Kind.MJCF, digest=digest, where=str(target), time_limit=description.time_limit
        )


def described(name: str) -> Description:
    """Return the description of a Python model, which a process of its own loads.

    Raises:
        RehybError: no package announces it here, or it is no model.
    """
    known = announced()
    if name not in known:
        raise RehybError(
            f"no package here announces the model {name!r}; there are {', '.join(known) or 'none'}"
        )
    ran = subprocess.run(
        [sys.executable, "-m", "models.packages", name],
        capture_output=True,
        text=True,
        check=False,
    )
    if ran.returncode != 0:
        lines = ran.stderr.strip().splitlines() or [f"exit status {ran.returncode}"]
        raise RehybError(lines[-1])
    return Description.from_json(json.loads(ran.stdout))


def _server_of(folder: ModelFolder, servers: Sequence[str]) -> str:
    """Return the URL of the first server that has the model of a folder."""
    from models.umbridge.client import RemoteModel, Server

    wrong = "name its server with --umbridge URL"
    for url in servers:
        try:
            server = Server(url)
            RemoteModel(folder, server).close()
        except ModelError as error:
            wrong = str(error)
        else:
            return url
    raise ModelError(f"{folder.description.name} has no server: {wrong}")


def seed_of(instance_id: str) -> int:
    """Return an instance's seed: another for each, and the same wherever it is computed."""
    return int.from_bytes(sha256(instance_id.encode()).digest()[:4], "big")


#: What this child process has loaded, by where it is.
_LOADED: dict[Place, Evaluator] = {}
_CLOSING = ExitStack()


def evaluate(instance: Mapping[str, Any]) -> Evaluation:
    """Evaluate a prepared instance: what a child process does with it.

    Raises:
        ModelFailure: the model has no answer.
    """
    place: Place | None = instance.get("place")
    if place is None:
        from sim.evaluation import evaluate as evaluate_ours

        return evaluate_ours(instance["model"], instance["parameters"])
    if place not in _LOADED:
        _LOADED[place] = evaluator(place)
    started = time.perf_counter()
    outputs = _LOADED[place](instance["parameters"], instance["seed"])
    return Evaluation(outcome="ok", outputs=outputs, wall_seconds=time.perf_counter() - started)


def evaluator(place: Place) -> Evaluator:
    """Load what evaluates a model; heavy libraries are imported here only.

    Raises:
        ModelFailure: "bad_model": it cannot be loaded.
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
        from models.umbridge.client import RemoteModel, Server

        return RemoteModel(folder, Server(place.url))
    except ValueError as error:
        # ModelError and PackageError among them.
        raise ModelFailure(Outcome.BAD_MODEL, str(error)) from None
