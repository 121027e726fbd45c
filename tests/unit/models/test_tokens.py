"""One rule of what a token may be."""

import pytest

from models.tokens import usable


@pytest.mark.parametrize("blank", ["\n", "\r\n", " ", "\t"])
def test_a_token_from_a_file_loses_what_is_blank_around_it(blank: str) -> None:
    assert usable(f"{blank}secret+/=-_.~{blank}") == "secret+/=-_.~"
    assert usable(blank) == ""


@pytest.mark.parametrize("token", ["hush hush", "hush\nhush", "h\xfcsh", "hush\udcff", "hu\x00sh"])
def test_a_token_that_no_request_can_bear_is_refused_without_being_shown(token: str) -> None:
    with pytest.raises(ValueError, match="take letters, digits and punctuation") as refused:
        usable(token)
    assert "h" + token[1:3] not in str(refused.value) and len(str(refused.value).splitlines()) == 1
