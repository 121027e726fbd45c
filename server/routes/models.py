"""Models: upload one, announce one, see what there is."""

import asyncio
from http import HTTPStatus
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

from fastapi import APIRouter, HTTPException, Query, Request, Response
from fastapi.responses import StreamingResponse
from sqlalchemy.engine import Engine

from models.description import Description
from models.entries import DescriptionError
from server.http.encodings import is_json
from server.logic.tokens import may
from server.operations import models
from server.records import ModelVersion
from server.routes.common import Configured, Id, Now, Route, Store, attachment, read_object
from server.routes.uploads import ZIP_OR_FORM, receive
from server.sandbox import check

router = APIRouter(prefix="/v1/models", tags=["models"], route_class=Route)

_DESCRIPTION = {
    "schema": {
        "type": "object",
        "properties": {
            "name": {"type": "string"},
            "kind": {"enum": ["python", "command", "umbridge"]},
            "factors": {"type": "array", "items": {"type": "object"}},
            "outputs": {"type": "array", "items": {"type": "object"}},
        },
        "required": ["name", "kind", "factors", "outputs"],
        "examples": [
            {
                "name": "pendulum",
                "kind": "command",
                "factors": [
                    {"name": "length", "unit": "m", "low": 0.2, "high": 0.4, "nominal": 0.3}
                ],
                "outputs": [{"name": "period", "unit": "s"}],
            }
        ],
    }
}


@router.post(
    "",
    status_code=201,
    openapi_extra={
        "requestBody": {
            "required": True,
            "content": {"application/json": _DESCRIPTION, **ZIP_OR_FORM},
        }
    },
)
async def add(
    request: Request, response: Response, store: Store, settings: Configured, now: Now
) -> dict[str, Any]:
    """Upload a model of kind `mjcf` as a zip file, or announce another by its description (JSON).

    The same version again is the one already there (200). What cannot be used is refused (422)
    with a sentence, and nothing of it is kept.
    """
    if is_json(request.headers.get("content-type", "")):
        description = _described(await request.body())
        by = request.headers.get("x-rehyb-worker", "")[:128]
        announced = await asyncio.to_thread(models.announce, store, description, by=by, now=now)
        return shown(announced)
    if not may(request.scope["rehyb.scopes"], ("submit",)):
        # Every worker would fetch it; what workers announce stays with them.
        raise HTTPException(
            HTTPStatus.FORBIDDEN, "to upload a model needs a token with the scope submit"
        )
    with TemporaryDirectory(prefix="rehyb-upload-") as scratch:
        file = Path(scratch) / "model.zip"
        await receive(request, file, settings.session_bytes)
        async with request.app.state.looks:
            understood = await check("models.check", file)
        model, new = await asyncio.to_thread(
            _keep, store, file, Description.from_json(understood), now
        )
    response.headers["Location"] = f"/v1/models/{model.version}"
    response.status_code = 201 if new else 200
    return shown(model)


@router.get("")
def every(store: Store, wanted: Annotated[bool, Query(examples=[False])] = False) -> dict[str, Any]:
    """List the newest version of every model; with `wanted`, what open studies sample."""
    found = models.wanted(store) if wanted else models.every(store)
    return {"models": [shown(model) for model in found]}


@router.get("/{name}")
def show(name: Id, store: Store) -> dict[str, Any]:
    """Show a model: "name" for its newest version, or "name@digest"."""
    return shown(models.get(store, name))


@router.get("/{name}/archive")
def archive(name: Id, store: Store) -> StreamingResponse:
    """Return the zip file of an uploaded model."""
    model = models.get(store, name)
    return attachment(models.archive(store, model), model.size, f"{model.name}.zip")


def shown(model: ModelVersion) -> dict[str, Any]:
    """Return a model as readers see it."""
    return {
        **model.description.as_json(),
        "own": model.own,
        "announced_by": model.announced_by,
        "announced_at": model.announced_at,
    }


def _described(body: bytes) -> Description:
    try:
        return Description.from_json(read_object(body))
    except DescriptionError as error:
        raise HTTPException(HTTPStatus.UNPROCESSABLE_ENTITY, str(error)) from None


def _keep(
    store: Engine, path: Path, description: Description, now: float
) -> tuple[ModelVersion, bool]:
    with path.open("rb") as file:
        return models.upload(store, description, file, size=path.stat().st_size, now=now)
