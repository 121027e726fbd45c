"""A child ends a program that takes too long, and hears its last words: it is not killed before."""

import pytest

from models.description import Kind
from models.running.place import GRACE_SECONDS, Place


@pytest.mark.parametrize(
    ("kind", "limit", "seconds"),
    [
        (Kind.COMMAND, 5.0, 5.0 + GRACE_SECONDS),
        (Kind.COMMAND, None, None),
        (Kind.PYTHON, 5.0, 5.0),
        (Kind.MJCF, 5.0, 5.0),
        (Kind.UMBRIDGE, 5.0, 5.0),
    ],
)
def test_a_child_is_killed_at_the_time_limit_unless_it_ends_what_takes_long_itself(
    kind: Kind, limit: float | None, seconds: float | None
) -> None:
    place = Place(kind=kind, digest="d", where="w", time_limit=limit)
    assert place.child_seconds == seconds
