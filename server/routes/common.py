"""What the routes share: where they find the store and the time, and how strictly they read."""

import json
import re
from codecs import BOM_UTF8
from collections.abc import Iterator, Mapping
from contextlib import suppress
from http import HTTPStatus
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from fastapi import Depends, Header, Path, Query, Request, Response, params
from fastapi.dependencies.utils import get_flat_params
from fastapi.exceptions import RequestValidationError
from fastapi.responses import StreamingResponse
from fastapi.routing import APIRoute
from pydantic import BaseModel, ConfigDict, StringConstraints, TypeAdapter, ValidationError
from pydantic_core import to_json
from sqlalchemy.engine import Engine
from starlette.datastructures import QueryParams
from starlette.types import Message, Receive, Scope, Send

from server.http.encodings import is_json
from server.http.texts import NO_FORMULA, PRINTABLE
from server.logic.conditional_requests import is_known
from server.logic.fleet.unserved import Patience
from server.logic.json_values import place_of_key_twice
from server.metrics import Metrics
from server.settings import Settings
from server.threads import in_thread


class Body(BaseModel):
    """A request body: nothing unknown, nothing converted, no NaN and no infinity."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    @classmethod
    def mended(cls, content: Any) -> Any:
        """Return what was sent with halves of characters, so that they spoil no more than need be.

        Args:
            content: as `json.loads` gives it; nothing is known of its shape.
        """
        return content


def example(**content: Any) -> ConfigDict:
    """Return a body's configuration with an example of it, which the documentation shows."""
    return ConfigDict(json_schema_extra={"examples": [content]})


# Async though they wait for nothing: what is not is called in another thread, which costs more than
# all that these do.
def _of_app(name: str) -> Any:
    """Return what depends on something that the application has."""

    async def found(request: Request) -> Any:
        return getattr(request.app.state, name)

    return Depends(found)


async def _moment(request: Request) -> Any:
    """Return when a request is served."""
    return request.app.state.clock()


async def _read(request: Request, kind: type[Body]) -> Body:
    """Return a request's body; RequestValidationError if it is no JSON of this kind."""
    body = await request.body()
    if not is_json(request.headers.get("content-type", "")):
        raise RequestValidationError([], body=body)
    try:
        parsed = _parsed(body.removeprefix(BOM_UTF8), kind)
    except ValidationError as error:
        raise _refusal(error, body) from None
    _check_keys(body)
    return parsed


#: Bytes of a body that takes the event loop longer to read than to have a thread do it.
LONG_BYTES = 100_000
#: Whatever is in it.
_OBJECT = TypeAdapter(dict[str, Any])


def read_object(body: bytes) -> dict[str, Any]:
    """Return a body that is a JSON object; RequestValidationError if it is none.

    For what somebody else judges: nothing is known of what is in it.
    """
    try:
        return _OBJECT.validate_json(body.removeprefix(BOM_UTF8))
    except ValidationError as error:
        raise _refusal(error, body) from None


def _refusal(error: ValidationError, body: bytes) -> RequestValidationError:
    """Return an error as FastAPI would raise it of the same body."""
    if not body:
        return RequestValidationError([{"type": "missing", "loc": ("body",), "msg": ""}])
    found = error.errors(include_url=False)
    return RequestValidationError([{**fault, "loc": ("body", *fault["loc"])} for fault in found])


def _parsed(body: bytes, kind: type[Body]) -> Body:
    """Return a body of this kind; ValidationError if it is none.

    Half of a character, which JSON can write and Unicode does not have, is refused where a text is
    asked for. Where anything may stand, whoever judges that must look.
    """
    try:
        return kind.model_validate_json(body)
    except ValidationError:
        if not _HALF.search(body):
            raise
        try:
            content = json.loads(body)
        except (ValueError, RecursionError):
            content = None
        if content is None:
            raise
        return kind.model_validate(kind.mended(content))


async def no_key_twice(request: Request) -> None:
    """Raise RequestValidationError if an object of a body has a key twice: which one was meant?"""
    body = await request.body()
    # Others are answered meanwhile; to ask a thread takes longer than to read a usual body.
    if len(body) > LONG_BYTES:
        await in_thread(_check_keys, body)
    else:
        _check_keys(body)


def _check_keys(body: bytes) -> None:
    twice = False

    def noted(pairs: list[tuple[str, Any]]) -> None:
        nonlocal twice
        # Workers post thousands a second: which key it is, and where, takes longer to find.
        twice = twice or len(dict(pairs)) < len(pairs)

    place: list[str | int] = []
    # What is no JSON is said where it is read.
    with suppress(ValueError, RecursionError):
        json.loads(body, object_pairs_hook=noted)
        place = place_of_key_twice(body) if twice else []
    if place:
        why = f"the key {str(place[-1])[:80]!r} comes twice in an object: leave out one"
        raise RequestValidationError([{"type": "key_twice", "loc": ("body", *place), "msg": why}])


#: How JSON writes halves of characters: each may be one, or one of the two of a whole character.
_HALF = re.compile(rb"\\u[dD][89a-fA-F]")


class Route(APIRoute):
    """A route of the interface: it refuses an unknown query, and a body if it takes none.

    To ignore what is written wrongly, or in the wrong place, would be to answer another question.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        known = get_flat_params(self.dependant)
        queries = [one for one in known if isinstance(one.field_info, params.Query)]
        self._known = [one.alias for one in queries]
        self._once = {one.alias for one in queries if not _is_list(one.field_info.annotation)}
        described = "requestBody" in (self.openapi_extra or {})
        self._takes_body = self.body_field is not None or described

    async def handle(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request (ASGI)."""
        # Not of pages, which are in no schema: links from elsewhere add names of their own.
        if self.include_in_schema and scope["method"] in (self.methods or ()):
            if scope["query_string"]:
                self._refuse_unknown(QueryParams(scope["query_string"]))
            if not self._takes_body and _may_have_body(scope):
                receive = await self._without_body(receive)
        await super().handle(scope, receive, send)

    def _refuse_unknown(self, query: QueryParams) -> None:
        why = f"no such query parameter: this route knows {', '.join(self._known) or 'none'}"
        wrong = {name: why for name in query if name not in self._known}
        for name in self._once:
            if len(query.getlist(name)) > 1:
                wrong[name] = "comes twice, and is one value: leave out one"
        if wrong:
            raise RequestValidationError(
                [{"type": "unknown", "loc": ("query", n), "msg": why} for n, why in wrong.items()]
            )

    async def _without_body(self, receive: Receive) -> Receive:
        """Return what brings the same again; RequestValidationError if that says anything."""
        body = await Request({"type": "http"}, receive).body()
        if b"".join(body.split()) not in _NOTHING:
            instead = f"; say in the query: {', '.join(self._known)}" if self._known else ""
            why = f"this route takes no body{instead}"
            raise RequestValidationError([{"type": "unknown", "loc": ("body",), "msg": why}])
        read: list[Message] = [{"type": "http.request", "body": body}]

        async def again() -> Message:
            return read.pop() if read else await receive()

        return again


def _is_list(kind: Any) -> bool:
    """Say whether a type is a list, or may be one."""
    return get_origin(kind) is list or any(_is_list(part) for part in get_args(kind))


#: Bodies that say nothing, as some clients send them with every request.
_NOTHING = (b"", b"{}", b"null")


def _may_have_body(scope: Scope) -> bool:
    """Say whether to look for a body; a reader, who asks most, has none without saying so."""
    if scope["method"] != "GET":
        return True
    return any(name in (b"content-length", b"transfer-encoding") for name, _ in scope["headers"])


class Direct(Route):
    """A route that workers ask all the time: its endpoint takes `body` and `request` only.

    It is described as any other, but called without FastAPI's search for what it depends on, and
    its body is read without a detour by plain values: that takes longer than all else.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        kind, endpoint = get_type_hints(self.endpoint)["body"], self.endpoint

        async def answer(scope: Scope, receive: Receive, send: Send) -> None:
            request = Request(scope, receive)
            response: Response = await endpoint(await _read(request, kind), request)
            await response(scope, receive, send)

        self.app = answer


def as_json(
    content: Mapping[str, Any],
    status: int = HTTPStatus.OK,
    headers: Mapping[str, str] | None = None,
) -> Response:
    """Return an answer of plain values as it is: FastAPI would look through every one of them."""
    body = to_json(content, inf_nan_mode="null")
    return Response(body, status, headers, media_type="application/json")


def attachment(
    parts: Iterator[bytes], size: int, filename: str, media_type: str = "application/zip"
) -> StreamingResponse:
    """Return a file of `size` bytes to be saved, a part at a time."""
    return StreamingResponse(
        parts,
        media_type=media_type,
        headers={
            "Content-Length": str(size),
            "Content-Disposition": f'attachment; filename="{filename}"',
            "X-Content-Type-Options": "nosniff",
        },
    )


def not_modified(tag: str, if_none_match: str | None) -> Response | None:
    """Return 304 for a reader that has seen what `tag` stands for; None for any other."""
    return Response(None, 304, {"ETag": tag}) if is_known(tag, if_none_match) else None


Store = Annotated[Engine, _of_app("engine")]
Configured = Annotated[Settings, _of_app("settings")]
RowPatience = Annotated[Patience, _of_app("patience")]
Measures = Annotated[Metrics, _of_app("metrics")]
Now = Annotated[float, Depends(_moment)]

#: A name somebody gave to something: one line, no control characters.
Name = Annotated[str, StringConstraints(min_length=1, max_length=128, pattern=PRINTABLE)]
#: A worker's id, which stands in tables of results.
WorkerId = Annotated[str, StringConstraints(min_length=1, max_length=128, pattern=NO_FORMULA)]
#: What `rehyb bank show` calls a bank.
BankId = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{12}$")]
#: Identifiers in a path.
Id = Annotated[str, Path(max_length=128, pattern=PRINTABLE, examples=["3fb1c2a4d5e6"])]
LeaseId = Annotated[
    str, Path(max_length=128, pattern=PRINTABLE, examples=["0f8e4ab7c5d94e2b8a1d6c3f7e9b2a10"])
]
#: Entries of one page of a list.
Limit = Annotated[int, Query(ge=1, le=1000, examples=[100])]
#: The ETag of what a reader has seen already.
IfNoneMatch = Annotated[str | None, Header(examples=['W/"5f2b1c9d8e7a6b5c4d3e"'])]
#: A whole number that a database can hold.
MAX_INTEGER = 2**63 - 1
