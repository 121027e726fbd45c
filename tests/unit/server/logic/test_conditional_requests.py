"""What a reader has seen already."""

import pytest

from server.logic.conditional_requests import is_known, tag


def test_tags_are_equal_exactly_where_all_parts_are() -> None:
    assert tag("s", 1, [2.0, None]) == tag("s", 1, [2.0, None])
    tags = {tag("s", 1), tag("s", 2), tag("t", 1), tag("s"), tag(["s", 1]), tag("s", 1, weak=True)}
    assert len(tags) == 6


def test_a_tag_is_quoted_as_http_has_it_and_weak_where_said() -> None:
    strong, weak = tag("s"), tag("s", weak=True)
    assert strong[0] == strong[-1] == '"' and strong[1:-1].isalnum() and len(strong) == 22
    assert weak == f"W/{strong}"


@pytest.mark.parametrize(
    ("header", "known"),
    [
        (None, False),
        ("", False),
        ('"a"', True),
        ('W/"a"', True),
        ('"b", W/"a" , "c"', True),
        ('"b","c"', False),
        ('"b",W/"a","c"', True),
        ("*", True),
        ('"ab"', False),
    ],
)
def test_a_tag_is_known_if_the_header_names_it_weak_or_strong(
    header: str | None, known: bool
) -> None:
    assert is_known('"a"', header) is known
    assert is_known('W/"a"', header) is known
