"""Who is shown the same shares one look."""

from typing import Any, cast

from server.web.page import Look, Page


def look(**choices: str) -> Look:
    return Look(engine=cast(Any, None), now=0.0, may_submit=True, choices=choices)


def test_only_what_a_page_reads_of_its_address_parts_those_who_look() -> None:
    page = Page(path="/", template="t.html", look=lambda asked: {}, choices=("find",))
    assert page.key(look(junk="1")) == page.key(look(factor="x2")) == page.key(look())
    assert page.key(look(find="a")) != page.key(look())
