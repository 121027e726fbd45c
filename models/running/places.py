"""Which models can be evaluated on this machine, and where a child process finds each."""

import json
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from models.built_in import built_in_models
from models.description import Description, Kind
from models.folder import MODEL_FILE, ModelError, ModelFolder, copied, read_folder, unpacked_into
from models.packages import announced
from models.processes import python
from models.running.place import Place

#: Faulty models of a folder that a sentence has room for.
MOST_FAULTS = 5


class NoModelError(Exception):
    """A model cannot be had on this machine; the message says why."""


def folders_in(paths: Sequence[Path]) -> Iterator[Path]:
    """Return every folder of a model among `paths` and directly in them.

    Raises:
        ModelError: there is none in a path.
    """
    for path in paths:
        found = (
            [path]
            if (path / MODEL_FILE).is_file()
            else sorted(inner for inner in path.glob("*") if (inner / MODEL_FILE).is_file())
        )
        if not found:
            raise ModelError(f"there is no such file in {path}, nor in a folder in it")
        yield from found


@dataclass(kw_only=True)
class Places:
    """The models that child processes here can evaluate, by name and digest."""

    #: Writes the zip file of an uploaded model, "name@digest", to a path.
    fetch: Callable[[str, Path], None]
    #: Where models are kept.
    cache: Path
    #: Of models that are not rehyb's own: what they are, and where.
    descriptions: dict[str, Description] = field(default_factory=dict)
    places: dict[str, Place] = field(default_factory=dict)

    def have(
        self,
        folders: Sequence[Path],
        packages: Sequence[str],
        servers: Sequence[str],
        left_out: Callable[[str], None] | None = None,
    ) -> None:
        """Have the models that this machine's owner named.

        Args:
            folders: with a `model.toml`, or with such folders in them.
            packages: names of models that packages announce as `rehyb.models`.
            servers: URLs that speak UM-Bridge; the first that has a model of kind `umbridge`
                evaluates it.
            left_out: is told of each folder that cannot be used, as long as another can.

        Raises:
            NoModelError: one of them cannot be used, or none of the folders; an address is none.
        """
        faults: list[str] = []
        try:
            _check_addresses(servers)
            found = list(folders_in(folders))
        except ModelError as error:
            raise NoModelError(str(error)) from None
        for folder in found:
            try:
                self._have(folder, servers)
            except NoModelError as error:
                faults.append(str(error))
        if faults and (left_out is None or len(faults) == len(found)):
            raise NoModelError(_listed(faults))
        for fault in faults:
            assert left_out is not None
            left_out(fault)
        for name in packages:
            description = described(name)
            if description.name != name:
                raise NoModelError(f"the package announces {name} and calls it {description.name}")
            self._add(description, name)

    def prepared(self, instance: Mapping[str, Any]) -> dict[str, Any]:
        """Return a leased instance with all that a child needs; fetches its model if need be.

        Raises:
            NoModelError: the model cannot be had.
        """
        version = instance["model"]
        if version in built_in_models():
            return dict(instance)
        place = self.place(version)
        return {
            **instance,
            "place": place,
            "time_limit": place.child_seconds,
            "seed": instance["model_seed"],
        }

    def place(self, version: str) -> Place:
        """Return where a model is, which is fetched if need be.

        Raises:
            NoModelError: it cannot be had.
        """
        if version not in self.places:
            self._fetched(version)
        return self.places[version]

    def _have(self, path: Path, servers: Sequence[str]) -> None:
        """Have the model in a folder, of many; NoModelError names it."""
        try:
            folder = read_folder(path)
            url = _server_of(folder, servers) if folder.description.kind == Kind.UMBRIDGE else ""
            self._add(folder.description, str(self._kept(folder)), url)
        except ModelError as error:
            raise NoModelError(f"{path / error.file}: {error.detail}") from None
        except NoModelError as error:
            raise NoModelError(f"{path / MODEL_FILE}: {error}") from None

    def _add(self, description: Description, where: str, url: str = "") -> None:
        if description.name in built_in_models():
            raise NoModelError(f"{description.name} is a model of rehyb's own: choose another name")
        version = description.version
        self.descriptions[version] = description
        self.places[version] = Place.of(description, where, url)

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

    def _fetched(self, version: str) -> None:
        """Have an uploaded model, after fetching it once for all workers here."""
        digest = version.partition("@")[2]
        target = self.cache / digest
        if not target.is_dir():
            self.cache.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(dir=self.cache, prefix="fetching-") as scratch:
                archive, fresh = Path(scratch) / "model.zip", Path(scratch) / "model"
                self.fetch(version, archive)
                fresh.mkdir()
                try:
                    found = read_folder(unpacked_into(archive, fresh))
                except ModelError as error:
                    raise NoModelError(f"{version} cannot be used: {error}") from None
                if found.description.digest != digest or found.description.kind != Kind.MJCF:
                    raise NoModelError(f"{version} arrived as {found.description.version}")
                self._moved(found.path, target)
        self._add(read_folder(target).description, str(target))


def _listed(faults: Sequence[str]) -> str:
    """Return faults as one sentence: the first `MOST_FAULTS` in full, the others by their number.

    Who mends the only one that is named would start again for each of the others.
    """
    more = len(faults) - MOST_FAULTS
    return "; ".join(faults[:MOST_FAULTS]) + (f"; and {more} more" if more > 0 else "")


def described(name: str) -> Description:
    """Return the description of a Python model, which a process of its own loads.

    Raises:
        NoModelError: no package announces it here, or it is no model.
    """
    known = announced()
    if name not in known:
        raise NoModelError(
            f"no package here announces the model {name!r}; there are {', '.join(known) or 'none'}"
        )
    ran = subprocess.run(
        python("-m", "models.packages", name),
        capture_output=True,
        text=True,
        check=False,
    )
    if ran.returncode != 0:
        lines = ran.stderr.strip().splitlines() or [f"exit status {ran.returncode}"]
        raise NoModelError(lines[-1])
    return Description.from_json(json.loads(ran.stdout))


def _check_addresses(servers: Sequence[str]) -> None:
    if servers:
        from models.umbridge.client import check_address

        for url in servers:
            check_address(url)


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
