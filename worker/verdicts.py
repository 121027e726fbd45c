"""What the coordinator says of a result."""

from enum import StrEnum


class Verdict(StrEnum):
    """Verdicts of the coordinator with which a result is where it belongs."""

    ACCEPTED = "accepted"
    DUPLICATE = "duplicate"
