"""Times, counts and shares read as a person would write them."""

import pytest

from server.web.words import count, duration, moment, percent, rate


@pytest.mark.parametrize(
    ("seconds", "said"),
    [
        (None, "–"),
        (0.0, "0 s"),
        (0.42, "0.4 s"),
        (59.7, "1 min"),
        (125.0, "2 min 5 s"),
        (3600.0, "1 h"),
        (90_000.0, "1 d 1 h"),
    ],
)
def test_a_duration_has_its_two_largest_units(seconds: float | None, said: str) -> None:
    assert duration(seconds) == said


def test_a_time_is_exact_for_the_browser_and_readable_without() -> None:
    assert moment(0.0) == ('<time datetime="1970-01-01T00:00:00+00:00">1970-01-01 00:00 UTC</time>')
    assert moment(None) == "–"


def test_a_rate_has_the_unit_in_which_it_is_more_than_one() -> None:
    assert [rate(x) for x in (12.34, 0.5, 0.001, 0.0)] == ["12.3 / s", "30 / min", "3.6 / h", "–"]


def test_a_share_that_is_not_nothing_is_not_called_so() -> None:
    assert [percent(x) for x in (0.0, 1e-6, 0.1234, 1.0)] == ["0 %", "< 0.1 %", "12.3 %", "100 %"]
    assert count(1234567) == "1,234,567"
