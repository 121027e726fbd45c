"""What a text should be is said in words, not in patterns."""

import re

import pytest

from server.http.texts import FILE_NAME, NO_FORMULA, PRINTABLE, wanted


@pytest.mark.parametrize(
    ("pattern", "said"),
    [
        (
            PRINTABLE,
            "must have no control characters in it, nor invisible ones, as U+200B and U+202E",
        ),
        (FILE_NAME, r"must have neither control or invisible characters nor / or \ in it"),
        (r"^[^\x00-\x08\x0b\x0c\x0e-\x1f\x7f]+$", "must have no control characters in it"),
        (r"^[^\x00-\x1f\x7f/\\]+$", r"must have neither control characters nor / or \ in it"),
        (r"^[0-9a-f]{12}$", "must match ^[0-9a-f]{12}$"),
    ],
)
def test_what_is_wanted_of_a_text_is_said_in_words(pattern: str, said: str) -> None:
    assert wanted(pattern) == said


@pytest.mark.parametrize("text", ["=1", "+1", "-1", "@a", "\ta", "a\nb", "a\x7f", ""])
def test_what_a_spreadsheet_computes_is_no_id(text: str) -> None:
    assert not re.search(NO_FORMULA, text)
    assert re.search(NO_FORMULA, "a=+-@") and "none of = + - @" in wanted(NO_FORMULA)


@pytest.mark.parametrize("pattern", [PRINTABLE, FILE_NAME, NO_FORMULA])
def test_what_nobody_sees_is_in_no_name(pattern: str) -> None:
    hidden = [0, 9, 10, 0x1B, 0x7F, 0x9B, 0xAD, 0x61C, 0x200B, 0x200E, 0x2028, 0x202E, 0x2066]
    for code in (*hidden, 0x2060, 0xFEFF):
        assert not re.search(pattern, f"a{chr(code)}b"), hex(code)
    for text in ("Größe 2", "δ=½·x", "名前", "نام", "a\u00a0b", "👍🏽"):
        assert re.search(pattern, text), text
