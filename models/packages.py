"""Models of kind `python`: objects that installed packages announce as `rehyb.models`.

Run as a program with the name of one, it prints its description: a worker's parent process loads
no stranger's code.
"""

import hashlib
import json
import sys
from collections.abc import Mapping
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol

from models.description import Description, Kind, complete
from models.entries import DescriptionError
from models.evaluation import columns

GROUP = "rehyb.models"
#: Of what an entry point names, or of an object of the class that it names.
_NEEDED = ("name", "description", "factors", "outputs", "evaluate")


class PackageError(ValueError):
    """A package announces something that is no model; the message names it."""


class PythonModel(Protocol):
    """What an entry point of the group `rehyb.models` is."""

    name: str
    description: str
    #: Tables with the fields of [[factors]] and [[outputs]] of `model.toml`.
    factors: Any
    outputs: Any

    def evaluate(self, parameters: Mapping[str, float], seed: int) -> Mapping[str, Any]:
        """Return the outputs, or raise `rehyb.ModelFailure`."""


def announced() -> Mapping[str, metadata.EntryPoint]:
    """Return the entry points of models that packages announce here, by name."""
    return {point.name: point for point in metadata.entry_points(group=GROUP)}


class PackagedModel:
    """A model that a package announces.

    Raises:
        PackageError: the entry point cannot be loaded, or is no model.
    """

    def __init__(self, point: metadata.EntryPoint) -> None:
        try:
            loaded = point.load()
            self._model: PythonModel = loaded() if isinstance(loaded, type) else loaded
            if missing := [name for name in _NEEDED if not hasattr(self._model, name)]:
                raise PackageError(f"{point.value} is no model: it has no {', '.join(missing)}")
            self.description = Description.from_json(
                {
                    "name": self._model.name,
                    "description": self._model.description,
                    "kind": str(Kind.PYTHON),
                    "factors": [_table(factor) for factor in self._model.factors],
                    "outputs": [_table(output) for output in self._model.outputs],
                    "time_limit": getattr(self._model, "time_limit", None),
                    "deterministic": getattr(self._model, "deterministic", True),
                    "code": _identity(point),
                }
            )
        except PackageError:
            raise
        except DescriptionError as error:
            raise PackageError(f"{point.value} cannot be described: {error}") from None
        except Exception as error:  # Anything may go wrong while a stranger's package is loaded.
            raise PackageError(
                f"{point.value} is no model: {type(error).__name__}: {error}"
            ) from error

    def __call__(self, parameters: Mapping[str, float], seed: int = 0) -> dict[str, float]:
        """Return the outputs at `parameters` (SI units; one left out is nominal).

        Raises:
            ValueError: a parameter is unknown or not finite.
            ModelFailure: the model's own, or "bad_answer" and "not_finite".
        """
        values = complete(self.description, parameters)
        return columns(self.description, self._model.evaluate(values, seed))


def _table(entry: Any) -> dict[str, Any]:
    """Return a factor or an output as a table, whether it is one or an object with such fields."""
    if isinstance(entry, Mapping):
        return dict(entry)
    fields = getattr(entry, "_asdict", None)
    return dict(fields()) if callable(fields) else dict(vars(entry))


def _identity(point: metadata.EntryPoint) -> str:
    """Return a digest of the distribution's name, version and files."""
    distribution = point.dist
    if distribution is None:
        raise PackageError(f"{point.value} belongs to no installed distribution")
    digest = hashlib.sha256(f"{distribution.name}\0{distribution.version}\0".encode())
    module = point.module.split(".")[0]
    files = [file for file in distribution.files or () if file.suffix != ".pyc"]
    found = {str(file): Path(str(file.locate())) for file in files if ".dist-info" not in str(file)}
    if not any(name.split("/")[0] in (module, f"{module}.py") for name in found):
        # Installed to be edited: its files are where they are written.
        found = _beside(module)
    for name in sorted(found):
        digest.update(f"{name}\0".encode() + found[name].read_bytes() + b"\0")
    return digest.hexdigest()


def _beside(module: str) -> dict[str, Path]:
    spec = find_spec(module)
    if spec is None or spec.origin is None:
        raise PackageError(f"the files of {module} cannot be found")
    origin = Path(spec.origin)
    if origin.name != "__init__.py":
        return {origin.name: origin}
    return {
        path.relative_to(origin.parent.parent).as_posix(): path
        for path in origin.parent.rglob("*")
        if path.is_file() and path.suffix != ".pyc"
    }


if __name__ == "__main__":
    try:
        print(json.dumps(PackagedModel(announced()[sys.argv[1]]).description.as_json()))
    except PackageError as error:
        sys.exit(str(error))
