"""What a coordinator answers: JSON objects, and problems (RFC 9457) as errors."""

from collections.abc import Mapping
from http import HTTPStatus
from typing import Any

import httpx2

from rehyb.errors import Conflict, Invalid, NotFound, RehybError, ServerError, Unauthorized

_ERRORS: Mapping[int, type[RehybError]] = {
    HTTPStatus.UNAUTHORIZED: Unauthorized,
    HTTPStatus.FORBIDDEN: Unauthorized,
    HTTPStatus.NOT_FOUND: NotFound,
    HTTPStatus.CONFLICT: Conflict,
    # It may succeed later, as after a failure.
    HTTPStatus.TOO_MANY_REQUESTS: ServerError,
}


def body_of(response: httpx2.Response) -> dict[str, Any]:
    """Return the JSON object of an answer; ServerError if it is none."""
    try:
        body = response.json()
    except ValueError:
        body = None
    if not isinstance(body, dict):
        raise ServerError(f"{response.request.url} did not answer with a JSON object")
    return body


def error_in(response: httpx2.Response) -> RehybError:
    """Turn a refusal into the error that a caller can tell apart, worded by the coordinator."""
    status = response.status_code
    try:
        problem = response.json()
    except ValueError:
        problem = None
    if not isinstance(problem, dict):
        problem = {}
    message = str(problem.get("detail") or problem.get("title") or HTTPStatus(status).phrase)
    if pointer := problem.get("pointer"):
        message += f" (at {pointer})"
    if errors := [_entry(error) for error in problem.get("errors") or ()]:
        message += ": " + "; ".join(errors)
    kind = _ERRORS.get(
        status, Invalid if status < HTTPStatus.INTERNAL_SERVER_ERROR else ServerError
    )
    if not problem:
        message = f"{response.request.url} answered {status} {message}"
    return kind(message, problem)


def _entry(error: object) -> str:
    if not isinstance(error, dict):
        return str(error)
    where = error.get("pointer") or error.get("loc") or ""
    what = error.get("detail") or error.get("msg") or ""
    return f"{where} {what}".strip()
