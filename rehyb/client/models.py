"""What a client can ask a coordinator about models."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from models.description import Description
from rehyb.client.connection import Connection, Json, for_reading, path_of

#: What a coordinator tells of a model beside its description.
_BESIDE = ("own", "announced_by", "announced_at")


def description_of(model: Json) -> Description:
    """Return the description of a model as a coordinator shows it."""
    return Description.from_json({k: v for k, v in model.items() if k not in _BESIDE}, kept=True)


class Models(Connection):
    """Models: rehyb's own, uploaded ones, and those that workers announce."""

    def models(self, *, wanted: bool = False) -> list[Json]:
        """Return the newest version of every model; if `wanted`, what open studies sample."""
        path = "/v1/models?wanted=true" if wanted else "/v1/models"
        models: list[Json] = self._json("GET", path)["models"]
        return models

    def model(self, name: str) -> Json:
        """Return one model, "name" (its newest version) or "name@digest"; NotFound without it."""
        return self._json("GET", path_of("models", name))

    def add_model(self, archive: Path | str) -> Json:
        """Upload a zipped model of kind `mjcf` and return it as the coordinator understood it.

        Raises:
            Invalid: it cannot be used; the message names the file and what is wrong.
        """
        headers = {"Content-Type": "application/zip"}
        with for_reading(archive) as file:
            return self._post("/v1/models", content=file, params={}, headers=headers)

    def announce_model(self, description: Mapping[str, Any], worker: str = "") -> Json:
        """Announce a model whose code is with workers, by its description.

        Args:
            description: as `Client.model` returns it.
            worker: id of the worker that has it, if one announces it.
        """
        return self._json("POST", "/v1/models", description, {"X-Rehyb-Worker": worker})

    def model_archive(self, version: str, path: Path | str) -> None:
        """Write the zip file of an uploaded model, "name@digest", to `path`."""
        self._download(path_of("models", version, "archive"), path)
