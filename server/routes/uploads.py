"""Files that come in a request: as its body, or as the one file of a form."""

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from http import HTTPStatus
from pathlib import Path
from typing import Any, BinaryIO

from fastapi import HTTPException, Request
from starlette.datastructures import FormData, UploadFile
from starlette.exceptions import HTTPException as FormError

from server.http.guards import upload_too_large
from server.store.database.parts import PART_BYTES

_ZIP = {"schema": {"type": "string", "format": "binary", "examples": ["a zip file"]}}
#: What a route says of a body that is a form with one file.
FORM: dict[str, Any] = {
    "schema": {
        "type": "object",
        "properties": {"file": {"type": "string", "format": "binary"}},
        "required": ["file"],
    }
}
#: What a route that takes a zip file says of its body.
ZIP_OR_FORM: dict[str, Any] = {"application/zip": _ZIP, "multipart/form-data": FORM}


@contextmanager
def naming_wanted(wanted: str) -> Iterator[None]:
    """Within the block, a form that cannot be read, or has too much, is told what is wanted.

    Raises:
        HTTPException: 400, with what is wrong and `wanted`, a sentence.
    """
    try:
        yield
    except FormError as error:
        if error.status_code != HTTPStatus.BAD_REQUEST:
            raise
        raise HTTPException(HTTPStatus.BAD_REQUEST, f"{error.detail} {wanted}") from None


async def receive(request: Request, path: Path, limit: int) -> str | None:
    """Write the uploaded file to `path` as it comes and return what its sender calls it."""
    with path.open("wb") as file:
        if request.headers.get("content-type", "").startswith("multipart/form-data"):
            async with _one_file(request) as form:
                upload = next((p for p in form.values() if isinstance(p, UploadFile)), None)
                if upload is None:
                    raise HTTPException(
                        HTTPStatus.UNPROCESSABLE_ENTITY,
                        "the form has no file: send the zip file as one",
                    )
                if (upload.size or 0) > limit:
                    raise HTTPException(
                        HTTPStatus.REQUEST_ENTITY_TOO_LARGE, upload_too_large(limit)
                    )
                await asyncio.to_thread(_copy, upload.file, file)
                return upload.filename
        size = 0
        async for chunk in request.stream():
            size += len(chunk)
            if size > limit:
                raise HTTPException(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, upload_too_large(limit))
            await asyncio.to_thread(file.write, chunk)
    return None


@asynccontextmanager
async def _one_file(request: Request) -> AsyncIterator[FormData]:
    with naming_wanted("The form must have one file, and at most one other field."):
        async with request.form(max_files=1, max_fields=1) as form:
            yield form


def _copy(source: BinaryIO, target: BinaryIO) -> None:
    while chunk := source.read(PART_BYTES):
        target.write(chunk)
