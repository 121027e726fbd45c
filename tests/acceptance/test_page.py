"""The pages in a real browser, with a real coordinator, its analysis and a worker."""

from collections.abc import Iterator
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
    page.set_default_timeout(20_000)
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
