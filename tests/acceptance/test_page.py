"""The pages in a real browser, with a real coordinator, its analysis and a worker."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from rehyb.client import Client
from rehyb.fleet import LocalFleet
from tests.testbed.browser import launched, needs_browser, watched

pytestmark = needs_browser


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LocalFleet]:
    """A coordinator, its analysis and one worker."""
    with LocalFleet(tmp_path_factory.mktemp("fleet"), workers=1) as fleet:
        yield fleet


@pytest.fixture(scope="module")
def client(fleet: LocalFleet) -> Iterator[Client]:
    with Client(fleet.url, fleet.token) as client:
        yield client


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with launched() as browser:
        yield browser


@pytest.fixture
def page(browser: Any, client: Client) -> Iterator[Any]:
    """A tab that has signed in with a one-time code; nothing may be wrong with what it shows."""
    context = browser.new_context(
        timezone_id="Asia/Kolkata", viewport={"width": 1440, "height": 900}
    )
    page = context.new_page()
    page.set_default_timeout(60_000)
    complaints = watched(page, client.url)
    page.goto(client.page_address())
    page.wait_for_url(f"{client.url}/")
    yield page
    context.close()
    assert complaints == []


def live(page: Any) -> None:
    """Wait until the page is up to date."""
    page.locator("#link.on").wait_for()


def test_a_study_that_is_submitted_appears_and_is_paused_resumed_and_cancelled(
    page: Any, client: Client
) -> None:
    live(page)
    assert page.locator("h2", has_text="No study yet").is_visible()
    study = client.submit(
        {"name": "masses", "model": "ishigami", "method": "saltelli", "rows": 400_000}
    )
    line = page.locator("tr", has_text="masses")
    line.locator(".state.running").wait_for()
    # In the reader's own zone.
    assert "GMT+5:30" in line.locator("time").first.get_attribute("title")
    line.get_by_role("button", name="Pause").click()
    line.locator(".state.paused").wait_for()
    assert client.study(study["id"])["state"] == "paused"
    line.get_by_role("button", name="Resume").click()
    line.locator(".state.running").wait_for()
    line.get_by_role("spinbutton").fill("7")
    line.get_by_role("spinbutton").press("Enter")
    page.locator("#told.shown", has_text="Done").wait_for()
    assert client.study(study["id"])["priority"] == 7
    # What cannot be undone is asked first, and "no" is what the keyboard chooses.
    line.get_by_role("button", name="Cancel").click()
    page.keyboard.press("Enter")
    assert client.study(study["id"])["state"] == "running"
    line.get_by_role("button", name="Cancel").click()
    page.get_by_role("button", name="Do it").click()
    line.locator(".state.cancelled").wait_for()


def test_indices_move_while_a_study_runs_and_a_link_keeps_what_was_chosen(
    page: Any, client: Client, tmp_path: Path
) -> None:
    study = client.submit(
        {"name": "moving", "model": "ishigami", "method": "saltelli", "rows": 16, "priority": 9}
    )
    page.goto(f"{client.url}/studies/{study['id']}?factor=x2")
    page.locator("[data-figure=bars] .plot-container").wait_for()
    page.locator(".state.complete").wait_for()
    shown = "document.querySelector('[data-figure=bars]').data[0].x"
    first = page.evaluate(shown)
    page.evaluate("window.same = true")
    client.extend(study["id"], 256)
    page.wait_for_function(f"x => {shown}[0] !== x", arg=first[0])
    page.locator("#indices td", has_text="256").first.wait_for()
    final = client.indices(study["id"])["outputs"]["y"]["factors"]
    page.wait_for_function(f"x => {shown}.includes(x)", arg=final["x1"]["first_order"]["value"])
    assert page.evaluate("window.same")
    # What the pointer touches decides whose runs are shown; the link had chosen another.
    assert page.locator("#factor").input_value() == "x2"
    page.locator("#factor").select_option("x3")
    assert page.url.endswith("?factor=x3")
    for kind, content in (("svg", b"<svg"), ("png", b"\x89PNG"), ("csv", b"factor,")):
        with page.expect_download() as download:
            page.locator(f"#figure-bars [data-keep={kind}]").click()
        file = tmp_path / download.value.suggested_filename
        download.value.save_as(file)
        assert file.read_bytes().startswith(content) and file.suffix == f".{kind}"
