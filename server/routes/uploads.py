"""Files that come in a request: as its body, or as the one file of a form."""

import asyncio
from collections.abc import AsyncGenerator, AsyncIterator
from contextlib import asynccontextmanager
from http import HTTPStatus
from pathlib import Path
from typing import Any, BinaryIO

from fastapi import HTTPException, Request
from python_multipart.multipart import parse_options_header
from starlette.datastructures import FormData, UploadFile
from starlette.formparsers import MultiPartException, MultiPartParser

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
#: What is told of a form that has anything else.
_ONE_FILE = "The form must have one file, and at most one other field."
_CUT_OFF = "the form was cut off: its closing boundary is missing; send the whole of it again"


class _Form(MultiPartParser):
    """Reads a form, and knows whether its end has come."""

    ended = False

    def on_end(self) -> None:
        """Note that the closing boundary has come."""
        self.ended = True


@asynccontextmanager
async def form_of(
    request: Request, wanted: str, *, files: int, fields: int = 0
) -> AsyncIterator[FormData]:
    """Read a form with at most so many files and fields; they are gone when the block ends.

    Args:
        wanted: a sentence, told beside what is wrong.

    Raises:
        HTTPException: 400: it cannot be read, has too much, or was cut off; 415: it is no form, or
            says that its names are not in UTF-8.
    """
    _require_form(request.headers.get("content-type", ""))

    async def whole() -> AsyncGenerator[bytes, None]:
        async for chunk in request.stream():
            yield chunk
        if not parser.ended:
            # Here, since what ends the reading has its files closed.
            raise HTTPException(HTTPStatus.BAD_REQUEST, _CUT_OFF)

    parser = _Form(request.headers, whole(), max_files=files, max_fields=fields)
    try:
        form = await parser.parse()
    except MultiPartException as error:
        raise HTTPException(HTTPStatus.BAD_REQUEST, f"{error.message} {wanted}") from None
    try:
        yield form
    finally:
        await form.close()


def _require_form(kind: str) -> None:
    """Raise HTTPException unless a body is said to be a form, whose names are in UTF-8.

    The parser would read them as whatever is said, which may be no encoding of texts.
    """
    found, options = parse_options_header(kind)
    charset = options.get(b"charset", b"utf-8").decode("latin-1")
    if found != b"multipart/form-data":
        why = f"the request's Content-Type is {kind or 'not said'}: send multipart/form-data"
    elif charset.lower() not in ("utf-8", "us-ascii"):
        why = f"the form's Content-Type says charset={charset}: send its names in UTF-8"
    else:
        return
    raise HTTPException(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, why)


async def receive(request: Request, path: Path, limit: int) -> str | None:
    """Write the uploaded file to `path` as it comes and return what its sender calls it."""
    with path.open("wb") as file:
        if request.headers.get("content-type", "").lower().startswith("multipart/form-data"):
            async with form_of(request, _ONE_FILE, files=1, fields=1) as form:
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


def _copy(source: BinaryIO, target: BinaryIO) -> None:
    while chunk := source.read(PART_BYTES):
        target.write(chunk)
