"""Cookies: good for whom they name, for as long as they say."""

import pytest

from server.logic.signing_in import OPERATOR, Seal, comes_from_here


def test_a_cookie_names_who_signed_in_until_its_time_is_over() -> None:
    cookie = Seal("token").close("3fb1c2a4", until=100.0)
    assert Seal("token").open(cookie, now=99.0) == "3fb1c2a4"
    assert Seal("token").open(cookie, now=100.0) is None


def test_a_cookie_that_was_changed_or_is_another_coordinators_is_none() -> None:
    seal = Seal("token")
    cookie = seal.close("3fb1c2a4", until=100.0)
    mark = cookie.rpartition(".")[2]
    for other in (
        "",
        ".",
        "..",
        OPERATOR,
        f"{OPERATOR}.100.{mark}",
        f"3fb1c2a4.999.{mark}",
        cookie + "0",
        cookie[:-1],
        "ä.ö.ü",
        Seal("other").close("3fb1c2a4", until=100.0),
    ):
        assert seal.open(other, now=1.0) is None
    assert Seal("other").cookie != seal.cookie


def test_a_later_version_knows_the_browsers_that_an_earlier_one_signed_in() -> None:
    seal = Seal("token")
    assert seal.cookie == "rehyb_7585cb58"
    mark = "23a58bc62cd378819fb21189a8410bca855344b5f23e12e53c2202b23ae4a849"
    assert seal.open(f"3fb1c2a4.100.{mark}", now=99.0) == "3fb1c2a4"


def test_a_name_may_hold_dots() -> None:
    seal = Seal("token")
    assert seal.open(seal.close("a.b", until=100.0), now=1.0) == "a.b"


@pytest.mark.parametrize(
    ("headers", "here"),
    [
        ({"origin": "http://lab:8787", "host": "lab:8787"}, True),
        # A proxy speaks TLS for it.
        ({"origin": "https://lab", "host": "lab"}, True),
        ({"origin": "http://lab:9999", "host": "lab:8787"}, False),
        ({"origin": "http://elsewhere", "host": "lab:8787"}, False),
        ({"origin": "null", "host": "lab:8787"}, False),
        ({"origin": "http://[", "host": "lab:8787"}, False),
        ({"origin": "ftp://lab:8787", "host": "lab:8787"}, False),
        ({"host": "lab:8787"}, False),
        ({"origin": "http://None"}, False),
    ],
)
def test_only_a_page_of_the_same_host_and_port_is_here(headers: dict[str, str], here: bool) -> None:
    assert comes_from_here(headers) is here
