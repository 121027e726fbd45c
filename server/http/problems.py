"""Every refusal as an RFC 9457 problem: one body shape for 4xx and 5xx alike."""

import json
import logging
import sys
from collections.abc import Mapping, Sequence
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from sqlalchemy.exc import DBAPIError
from sqlalchemy.exc import TimeoutError as NoConnectionError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.routing import Match, Route

from server.errors import (
    BadFileError,
    ConflictError,
    CoordinatorError,
    InvalidStudyError,
    NotFoundError,
)
from server.http.bodies import body_of_route, known_keys
from server.http.texts import wanted
from server.store.database.presence import why_away

log = logging.getLogger(__name__)

#: After so many seconds to ask again while the database is away.
AGAIN = {"Retry-After": "2"}

#: Faults of one request that are told.
MOST_TOLD = 100

#: Characters of a path that are told.
MOST_OF_A_PATH = 200

_STATUS: Mapping[type[CoordinatorError], HTTPStatus] = {
    NotFoundError: HTTPStatus.NOT_FOUND,
    ConflictError: HTTPStatus.CONFLICT,
    InvalidStudyError: HTTPStatus.UNPROCESSABLE_ENTITY,
    BadFileError: HTTPStatus.UNPROCESSABLE_ENTITY,
}


class _Problem(JSONResponse):
    media_type = "application/problem+json"

    def render(self, content: Any) -> bytes:
        # What was sent may hold half of a character, and is named as it was written.
        text = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
        return text.encode(errors="backslashreplace")


def problem(
    status: int,
    detail: str,
    *,
    headers: Mapping[str, str] | None = None,
    members: Mapping[str, Any] | None = None,
) -> JSONResponse:
    """Return a problem response.

    `members` are further ones of the body, such as `pointer`.
    """
    return _Problem(body_of(status, detail, members or {}), status, headers=dict(headers or {}))


def body_of(status: int, detail: str, members: Mapping[str, Any]) -> dict[str, Any]:
    """Return a problem as JSON; arguments as in `problem`."""
    return {
        # RFC 9457, 4.2.1: there is nothing to know beyond what the status says.
        "type": "about:blank",
        "title": HTTPStatus(status).phrase,
        "status": int(status),
        "detail": detail,
        **members,
    }


def install(app: FastAPI) -> None:
    """Make `app` answer every error with a problem."""

    @app.exception_handler(CoordinatorError)
    def refused(_request: Request, error: CoordinatorError) -> JSONResponse:
        members: Mapping[str, Any] = {}
        if isinstance(error, InvalidStudyError):
            members = {"pointer": error.pointer}
        elif isinstance(error, BadFileError):
            members = error.to_json()
        # What is none of these is the coordinator's failure.
        kinds = (status for kind, status in _STATUS.items() if isinstance(error, kind))
        status = next(kinds, HTTPStatus.INTERNAL_SERVER_ERROR)
        return problem(status, str(error), members=members)

    @app.exception_handler(RequestValidationError)
    def invalid(request: Request, error: RequestValidationError) -> JSONResponse:
        if isinstance(error.body, bytes):
            # What is not said to be JSON is not read as JSON.
            kind = request.headers.get("content-type")
            said = f"'s Content-Type is {kind}" if kind else " has no Content-Type"
            why = f"the request{said}: send application/json"
            return problem(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, why)
        found = error.errors()
        told = _faults(found[:MOST_TOLD], body_of_route(request.scope.get("route")))
        return _not_taken(told, more=len(found) - MOST_TOLD)

    @app.exception_handler(HTTPException)
    def http(request: Request, error: HTTPException) -> JSONResponse:
        if isinstance(error.__cause__, RecursionError | ValueError):
            # FastAPI read a body and does not say what was wrong.
            return _not_taken([_entry("", f"the body is not JSON: {_flaw(error.__cause__)}")])
        headers, detail = dict(error.headers or {}), str(error.detail)
        path = request.url.path[:MOST_OF_A_PATH]
        if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
            headers["Allow"] = ", ".join(_allowed(request))
            detail = f"{path} takes {headers['Allow']}, not {request.method}"
        elif detail == HTTPStatus.NOT_FOUND.phrase:
            # No route has said what there is not.
            detail = f"there is nothing at {path}; GET /openapi.json tells what there is"
        return problem(error.status_code, detail, headers=headers)

    @app.exception_handler(ClientDisconnect)
    def left(_request: Request, _error: Exception) -> JSONResponse:
        # Nobody hears it, but who leaves in the middle, or was sent away since it was too slow, is
        # no failure of the coordinator's.
        return problem(HTTPStatus.BAD_REQUEST, "the body was cut short")

    @app.exception_handler(DBAPIError)
    @app.exception_handler(NoConnectionError)
    def stuck(_request: Request, error: Exception) -> JSONResponse:
        return unless_away(error)

    @app.exception_handler(Exception)
    def failed(request: Request, _error: Exception) -> JSONResponse:
        log.error("%s %s failed", request.method, request.url.path)
        return problem(
            HTTPStatus.INTERNAL_SERVER_ERROR,
            "the coordinator failed to answer; its log says why",
        )


def _allowed(request: Request) -> list[str]:
    """Return the methods of all routes that a path fits: each by itself tells its own only."""
    fitting = (
        route
        for route in request.app.router.routes
        if isinstance(route, Route) and route.matches(request.scope)[0] is not Match.NONE
    )
    methods = {method for route in fitting for method in route.methods or ()}
    # See `server.http.heads`.
    return sorted(methods | ({"HEAD"} if "GET" in methods else set()))


def unless_away(error: Exception) -> JSONResponse:
    """Return what is answered while the database is away; raise any other error again."""
    if why_away(error) is None:
        raise error
    return problem(
        HTTPStatus.SERVICE_UNAVAILABLE,
        "the database is away or its disk is full: ask again",
        headers=AGAIN,
    )


def _not_taken(errors: Sequence[Mapping[str, str]], more: int = 0) -> JSONResponse:
    if len(errors) == 1:
        # As of InvalidStudyError: what is at one place is told in one way, whoever found it.
        (one,) = errors
        return problem(
            HTTPStatus.UNPROCESSABLE_ENTITY, one["detail"], members={"pointer": one["pointer"]}
        )
    return problem(
        HTTPStatus.UNPROCESSABLE_ENTITY,
        "the request is not what this route takes"
        + (f": the first {MOST_TOLD} faults, and there are {more} more" if more > 0 else ""),
        members={"errors": errors},
    )


def _entry(pointer: str, detail: str) -> dict[str, str]:
    return {"pointer": pointer, "detail": detail}


def _flaw(error: RecursionError | ValueError) -> str:
    """Say why Python does not read a text as JSON, though JSON's grammar may allow it."""
    if isinstance(error, RecursionError):
        return "it is nested too deeply"
    if isinstance(error, UnicodeDecodeError):
        return f"it is not UTF-8 from byte {error.start} on"
    return f"a whole number in it has more than {sys.get_int_max_str_digits()} digits"


def _faults(errors: Sequence[Mapping[str, Any]], body: Any) -> list[dict[str, str]]:
    """Return validation errors as entries of `errors`, of each place one.

    `body`: the type of the body that was wanted; None: of none.
    """
    told: dict[str, list[str]] = {}
    for item in errors:
        pointer, detail = _fault(item)
        if item["type"] == "extra_forbidden" and (known := known_keys(body, item["loc"][1:-1])):
            detail = f"is not known here: there are {', '.join(known)}"
        if detail not in (there := told.setdefault(pointer, [])):
            there.append(detail)
    return [_entry(pointer, "; ".join(details)) for pointer, details in told.items()]


#: What pydantic calls a value that is no JSON object, in words about Python.
_NO_OBJECT = ("dict_type", "model_attributes_type", "model_type")


def _fault(item: Mapping[str, Any]) -> tuple[str, str]:
    """Return where one validation error is, and what to say of it."""
    kind, place, detail = item["type"], tuple(item["loc"]), item["msg"]
    if kind == "json_invalid":
        where = "".join(f" at character {part}" for part in place[1:])
        return "", f"the body is not JSON: {item['ctx']['error']}{where}"
    if kind == "missing" and place == ("body",):
        return "", "the body is empty; send a JSON object"
    if kind in _NO_OBJECT:
        detail = "must be a JSON object"
    if kind == "string_pattern_mismatch":
        detail = wanted(item["ctx"]["pattern"])
    # Of a key pydantic writes this behind it, which the request does not have; a key that is called
    # so differs by what is at fault, unless that is half of a character.
    if place[-1] == "[key]" and (item.get("input") == place[-2] or kind == "string_unicode"):
        place, detail = place[:-1], f"the key: {detail}"
    return _pointer(place), detail


def _pointer(location: Sequence[str | int]) -> str:
    """Return a validation error's location as a JSON pointer into the body, or a parameter's name.

    The first part says where the value came from: "body", "path", "header" or "query".
    """
    source, *inside = (str(part).replace("~", "~0").replace("/", "~1") for part in location)
    return "".join(f"/{part}" for part in (inside if source == "body" else [source, *inside]))
