"""Counts in sentences."""

from intake.words import counted


def test_one_of_a_thing_is_no_plural() -> None:
    """Of one sample a log was said to have "1 samples" (a stranger's)."""
    told = [counted(number, "sample was", "samples were") for number in (0, 1, 3)]
    assert told == ["0 samples were", "1 sample was", "3 samples were"]
