"""Numbers are shown with the digits that their intervals allow, and no more."""

import pytest

from analysis.reports.wording import visible, with_interval


@pytest.mark.parametrize(
    ("value", "low", "high", "expected"),
    [
        (0.5763, 0.3212, 0.8512, ("0.58", "[0.32, 0.85]")),
        (-0.01441, -0.0371, 0.00731, ("-0.014", "[-0.037, 0.007]")),
        (0.1337, 0.1162, 0.1498, ("0.134", "[0.116, 0.150]")),
        (1e4, 9987.0, 10021.0, ("10000", "[9987, 10021]")),
        (1.2e-7, 1.1e-7, 1.4e-7, ("1.2e-07", "[1.1e-07, 1.4e-07]")),
        (1.2345e9, 1.1e9, 1.3e9, ("1.23e+09", "[1.1e+09, 1.3e+09]")),
        (0.109, 0.011, 499.2, ("0.11", "[0.011, 499]")),
        (1.03, 0.26, 31.0, ("1.0", "[0.26, 31]")),
        (0.0001, -0.2, 0.2, ("0.0001", "[-0.20, 0.20]")),
        (-2e-9, -0.2, 0.2, ("-2e-09", "[-0.20, 0.20]")),
        (0.0, -0.2, 0.2, ("0.00", "[-0.20, 0.20]")),
        (0.0, 0.0, 0.0, ("0", "[0, 0]")),
        (0.12345, None, None, ("0.123", "")),
    ],
)
def test_two_digits_of_the_half_width_decide(
    value: float, low: float | None, high: float | None, expected: tuple[str, str]
) -> None:
    assert with_interval(value, low, high) == expected


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("knee\u202exlsx.exe", "knee\\u202exlsx.exe"),
        ("a\u200bb\x07\x00", "a\\u200bb\\u0007\\u0000"),
        ("two lines\n\tand a tab", "two lines\n\tand a tab"),
        # Scripts and pictures are written with joiners, and right to left without any mark.
        (
            "\u0646\u0627\u0645\u0647\u200c\u0647\u0627",
            "\u0646\u0627\u0645\u0647\u200c\u0647\u0627",
        ),
    ],
)
def test_what_would_not_be_seen_is_written_out(text: str, shown: str) -> None:
    assert visible(text) == shown
