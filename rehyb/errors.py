"""What can go wrong, as one tree; every message is a sentence for the person at the keyboard."""

# ruff: noqa: N818 - the coordinator's refusals carry the names that HTTP gives them.

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from http import HTTPStatus
from importlib.util import find_spec
from typing import Any

#: What whoever named a path did wrong: nothing of the kind is there, or nobody may have it.
WRONG_PATHS = (FileNotFoundError, IsADirectoryError, NotADirectoryError, PermissionError)


class RehybError(Exception):
    """Anything rehyb refuses or fails to do."""

    def __init__(self, message: str, problem: Mapping[str, Any] | None = None) -> None:
        super().__init__(message)
        #: The coordinator's problem document (RFC 9457); empty if it sent none.
        self.problem: Mapping[str, Any] = problem or {}


class Unreachable(RehybError):
    """No coordinator answers, or its answer was cut short."""


class WrongProtocol(Unreachable):
    """What answers is no coordinator, or shows a certificate that nobody trusts.

    It may be a web server in between, while the coordinator is away.
    """


class Unauthorized(RehybError):
    """The coordinator does not accept the token, or there is none."""


class NotFound(RehybError):
    """The coordinator has no such study or lease."""


class Conflict(RehybError):
    """The request contradicts what the coordinator already holds."""


class Invalid(RehybError):
    """The coordinator cannot use the request as it stands."""


class ServerError(RehybError):
    """The coordinator failed, or has had enough; the same request may succeed later."""

    @property
    def is_at_request(self) -> bool:
        """Whether it failed at this very request: neither its database nor a proxy is away."""
        return self.problem.get("status") == HTTPStatus.INTERNAL_SERVER_ERROR


class FleetError(RehybError):
    """A local coordinator, analysis or worker does not stay up."""


class CampaignError(RehybError):
    """A campaign cannot start or go on."""


@contextmanager
def needs_extra(what: str, extra: str) -> Iterator[None]:
    """Within the block, a module that is not installed is a sentence that says how to get it.

    Raises:
        RehybError: the optional dependencies named `extra`, which `what` needs, are missing.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise RehybError(f"{what} needs {error.name}: pip install 'rehyb[{extra}]'") from None


def check_pictures() -> None:
    """Raise RehybError unless what draws pictures and writes pages is installed."""
    if None in map(find_spec, ("matplotlib", "jinja2")):
        raise RehybError("pictures need matplotlib and jinja2: pip install 'rehyb[figures]'")


@contextmanager
def refusing(*errors: type[Exception]) -> Iterator[None]:
    """Within the block, one of `errors` is Invalid with the same sentence."""
    try:
        yield
    except errors as error:
        raise Invalid(str(error)) from None


_OF_STATUS: Mapping[int, type[RehybError]] = {
    HTTPStatus.UNAUTHORIZED: Unauthorized,
    HTTPStatus.FORBIDDEN: Unauthorized,
    HTTPStatus.NOT_FOUND: NotFound,
    HTTPStatus.CONFLICT: Conflict,
    # It may succeed later, as after a failure.
    HTTPStatus.TOO_MANY_REQUESTS: ServerError,
    HTTPStatus.REQUEST_TIMEOUT: ServerError,
}


#: Not every server keeps to those that are registered.
_PHRASES: Mapping[int, str] = {one.value: one.phrase for one in HTTPStatus}
#: What a server in between says of a request, which the coordinator would not say otherwise.
_OF_ANYBODY = (
    HTTPStatus.REQUEST_TIMEOUT,
    HTTPStatus.REQUEST_ENTITY_TOO_LARGE,
    HTTPStatus.TOO_MANY_REQUESTS,
)


def refusal(status: int, problem: object, url: str, *, location: str = "") -> RehybError:
    """Return the error that a caller can tell apart, worded by the coordinator.

    Args:
        problem: its body, a problem document (RFC 9457) if it came from a coordinator.
        location: where it sends to instead.
    """
    document: Mapping[str, Any] = problem if isinstance(problem, dict) else {}
    if not document.keys() & {"detail", "title", "status"}:
        document = {}
    message = str(document.get("detail") or document.get("title") or _PHRASES.get(status, ""))
    if pointer := document.get("pointer"):
        message += f" (at {pointer})"
    if errors := [_entry(error) for error in document.get("errors") or ()]:
        message += ": " + "; ".join(errors)
    kind = _OF_STATUS.get(
        status, Invalid if status < HTTPStatus.INTERNAL_SERVER_ERROR else ServerError
    )
    if not document:
        message = f"{url} answered {status} {message}".rstrip()
        if status < HTTPStatus.INTERNAL_SERVER_ERROR and status not in _OF_ANYBODY:
            to = f"; it sends on to {location}" if location else ""
            return WrongProtocol(f"{message}, which is no coordinator's word{to}")
    return kind(message, document)


def _entry(error: object) -> str:
    if not isinstance(error, dict):
        return str(error)
    where = error.get("pointer") or error.get("loc") or ""
    what = error.get("detail") or error.get("msg") or ""
    return f"{where} {what}".strip()
