"""What can go wrong, as one tree; every message is a sentence for the person at the keyboard."""

# ruff: noqa: N818 - the coordinator's refusals carry the names that HTTP gives them.

from collections.abc import Mapping
from typing import Any


class RehybError(Exception):
    """Anything rehyb refuses or fails to do."""

    def __init__(self, message: str, problem: Mapping[str, Any] | None = None) -> None:
        super().__init__(message)
        #: The coordinator's problem document (RFC 9457); empty if it sent none.
        self.problem: Mapping[str, Any] = problem or {}


class Unreachable(RehybError):
    """No coordinator answers, or its answer was cut short."""


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


class FleetError(RehybError):
    """A local coordinator, analysis or worker does not stay up."""


class CampaignError(RehybError):
    """A campaign cannot start or go on."""
