"""The pages in a real browser, with a real coordinator, its analysis and a worker."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from axe_playwright_python.sync_playwright import Axe

from rehyb.client import Client
from rehyb.errors import Unreachable
from server.operations import tokens
from server.store import create_engine, upgrade
from tests.testbed.browser import launched, needs_browser, watched
from tests.testbed.coordinators.full_house import House, furnish
from tests.testbed.fleet.warm import WarmFleet

pytestmark = needs_browser


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WarmFleet]:
    """A coordinator, its analysis and one worker."""
    with WarmFleet(tmp_path_factory.mktemp("fleet"), workers=1) as fleet:
        yield fleet


@pytest.fixture(scope="module")
def client(fleet: WarmFleet) -> Iterator[Client]:
    with Client(fleet.url, fleet.token) as client:
        yield client


class Furnished(NamedTuple):
    """A coordinator without workers that has something on every page, called by markup."""

    client: Client
    house: House
    #: The token of somebody who may only look.
    guest: str


@pytest.fixture(scope="module")
def furnished(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Furnished]:
    """A database that was filled before its coordinator started."""
    folder = tmp_path_factory.mktemp("furnished")
    url = f"sqlite:///{folder}/rehyb.sqlite3"
    upgrade(url)
    engine = create_engine(url)
    house = furnish(engine, rows=64)
    _, secret = tokens.create(engine, name="guest", scopes=["read"], now=1.0)
    engine.dispose()
    with WarmFleet(folder, workers=0) as fleet, Client(fleet.url, fleet.token) as client:
        yield Furnished(client, house, secret)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with launched() as browser:
        yield browser


@pytest.fixture
def page(browser: Any, client: Client) -> Iterator[Any]:
    """A tab that has signed in with a one-time code; nothing may be wrong with what it shows."""
    with tab(browser, client) as page:
        yield page


@contextmanager
def tab(browser: Any, client: Client, token: str = "") -> Iterator[Any]:
    """Sign in, with a one-time code unless there is a token; the page must not complain."""
    size = {"width": 1440, "height": 900}
    context = browser.new_context(timezone_id="Asia/Kolkata", viewport=size)
    page = context.new_page()
    page.set_default_timeout(60_000)
    complaints = watched(page, client.url)
    page.goto(f"{client.url}/sign-in" if token else client.page_address())
    if token:
        page.get_by_label("Token").fill(token)
        page.keyboard.press("Enter")
    page.wait_for_url(f"{client.url}/")
    yield page
    context.close()
    # A browser says itself what it could not load: a coordinator that is away, what was refused.
    assert [said for said in complaints if not said.startswith("Failed to load resource")] == []


def answers(client: Client) -> bool:
    """Say whether the coordinator is there."""
    try:
        client.health()
    except Unreachable:
        return False
    return True


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
    # What is no priority goes away, and the true one is back.
    line.get_by_role("spinbutton").fill("5000")
    line.get_by_role("spinbutton").blur()
    assert line.get_by_role("spinbutton").input_value() == "0"
    line.get_by_role("spinbutton").fill("7")
    # "Done" may still be shown of what was asked before.
    with page.expect_response(lambda answer: answer.request.method != "GET") as answered:
        line.get_by_role("spinbutton").press("Enter")
    assert answered.value.ok
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
    # Axes follow the data.
    reach = """name => { const box = document.querySelector(`[data-figure=${name}]`);
      const axis = box._fullLayout.xaxis, [low, high] = axis.range.map(axis.r2l);
      const of = box.data.flatMap(trace => trace.x).map(axis.d2l);
      return low <= Math.min(...of) && Math.max(...of) <= high; }"""
    for name in ("bars", "convergence", "precision"):
        page.wait_for_function(reach, arg=name, timeout=5000)
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


def test_a_study_that_is_submitted_by_the_form_finishes_while_the_page_is_open(
    page: Any, client: Client
) -> None:
    page.goto(f"{client.url}/new-study?model=ishigami&method=saltelli")
    page.get_by_label("Rows", exact=True).fill("24")
    page.get_by_label("x3 to").fill("2")
    page.get_by_label("Sample x1").uncheck()
    assert page.locator("#cost").inner_text().startswith("96 runs: 24 rows of 4.")
    assert '"range":[-3.141592653589793,2]' in page.locator("#curl").text_content()
    page.get_by_label("Priority").fill("9")
    page.get_by_role("button", name="Begin the study").click()
    page.locator(".state.complete").wait_for()
    page.locator("[data-figure=bars] .plot-container").wait_for()
    study = client.study(page.url.rpartition("/")[2])
    assert [factor["name"] for factor in study["factors"]] == ["x2", "x3"]
    # What the coordinator refuses is said at the form.
    page.goto(f"{client.url}/new-study?model=ishigami")
    page.get_by_label("x1 from").fill("5000")
    page.get_by_role("button", name="Begin the study").click()
    page.locator("#refused", has_text="x1").wait_for()


def test_a_coordinator_that_is_killed_is_missed_and_caught_up_with(
    page: Any, client: Client, fleet: WarmFleet
) -> None:
    live(page)
    page.evaluate("window.same = true")
    os.kill(fleet.pids()["coordinator"], signal.SIGKILL)
    page.locator("#banner").wait_for()
    assert "does not answer" in page.locator("#banner").inner_text()
    while not answers(client):
        fleet.supervise()
        page.wait_for_timeout(300)
    client.submit({"name": "meanwhile", "model": "ishigami", "method": "morris", "rows": 4})
    page.locator("tr", has_text="meanwhile").wait_for()
    page.locator("#banner").wait_for(state="hidden")
    assert page.evaluate("window.same")


def test_a_coordinator_that_hangs_is_missed_and_a_button_says_that_nothing_came_of_it(
    page: Any, client: Client, fleet: WarmFleet
) -> None:
    study = client.submit(
        {"name": "hanging", "model": "ishigami", "method": "saltelli", "rows": 400_000}
    )
    # The page misses beats, and a button its answer, without our waiting for it.
    page.clock.install()
    page.add_init_script(
        "const wait = AbortSignal.timeout.bind(AbortSignal); AbortSignal.timeout = () => wait(50)"
    )
    page.goto(f"{client.url}/")
    live(page)
    pause = page.locator("tr", has_text="hanging").get_by_role("button", name="Pause")
    pause.wait_for()
    coordinator = fleet.pids()["coordinator"]
    os.kill(coordinator, signal.SIGSTOP)
    try:
        pause.click()
        page.locator("#told.shown", has_text="has not answered").wait_for()
        page.clock.fast_forward(15_000)
        page.locator("#banner").wait_for()
        assert page.locator("#link").inner_text() == "not connected"
    finally:
        os.kill(coordinator, signal.SIGCONT)
    page.locator("#banner").wait_for(state="hidden")
    # It would keep a core busy until the last of these tests.
    client.cancel(study["id"])


def test_a_reader_is_refused_what_no_button_offers(browser: Any, furnished: Furnished) -> None:
    client, house, guest = furnished
    with tab(browser, client, guest) as page:
        live(page)
        assert page.locator("#table button").count() == 0
        ask = "path => fetch(path, {method: 'POST'}).then(answer => answer.status)"
        for path in (f"/v1/studies/{house.study}/pause", "/v1/studies", "/v1/sessions"):
            assert page.evaluate(ask, path) == 403


#: Whether every figure that is shown has been drawn.
DRAWN = """() => [...document.querySelectorAll("[data-figure]")]
  .filter(box => box.offsetParent).every(box => box.querySelector(".plot-container"))"""


@pytest.mark.parametrize(("width", "scheme"), [(1440, "light"), (400, "dark")])
def test_every_page_is_readable_for_everybody_and_runs_nobody_s_script(
    browser: Any, furnished: Furnished, tmp_path: Path, width: int, scheme: str
) -> None:
    """Pictures of all pages are in the test's folder, to be looked at."""
    client, house, _ = furnished
    axe = Axe()
    with tab(browser, client) as page:
        page.set_viewport_size({"width": width, "height": 900})
        page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
        for number, path in enumerate(house.pages):
            page.goto(client.url + path)
            if page.locator("#live[data-stream^='/live']").count():
                live(page)
            if house.study in path and page.locator("[data-figure]").count():
                page.locator(".plot-container").first.wait_for()
                page.wait_for_function(DRAWN)
            picture = tmp_path / f"{number:02}{path.split('?')[0].replace('/', '-')}.png"
            page.screenshot(path=picture, full_page=True)
            assert page.evaluate("document.documentElement.scrollWidth") <= width, path
            assert page.evaluate("window.evil") is None, path
            found = axe.run(page, options={"resultTypes": ["violations"]}).response["violations"]
            serious = [
                (one["id"], [node["html"][:200] for node in one["nodes"][:3]])
                for one in found
                if one["impact"] in ("serious", "critical")
            ]
            assert serious == [], path


def test_a_one_time_address_works_in_a_tab_that_is_at_the_door_already(
    browser: Any, furnished: Furnished
) -> None:
    client, _, _ = furnished
    context = browser.new_context()
    page = context.new_page()
    page.goto(f"{client.url}/sign-in")
    page.goto(client.page_address())
    page.wait_for_url(f"{client.url}/")
    context.close()


def test_nothing_runs_out_of_its_card(browser: Any, furnished: Furnished) -> None:
    client, house, _ = furnished
    fits = "card => card.scrollWidth <= card.clientWidth"
    with tab(browser, client) as page:
        page.set_viewport_size({"width": 400, "height": 900})
        page.goto(f"{client.url}/models")
        assert page.locator("#upload").evaluate(fits)
        page.goto(f"{client.url}/studies/{house.study}/failures")
        card = page.locator("section.card").first
        card.evaluate("card => card.querySelector('p').append('w'.repeat(300))")
        assert card.evaluate(fits)


def test_failures_are_run_again_by_cause(browser: Any, furnished: Furnished) -> None:
    client, house, _ = furnished
    with tab(browser, client) as page:
        page.goto(f"{client.url}/studies/{house.study}/failures")
        page.locator("[data-figure=failures] .plot-container").wait_for()
        count = client.progress(house.study)["failures"]["diverged"]
        assert count > 0
        page.get_by_role("button", name="Run these again").click()
        page.get_by_role("button", name="Do it").click()
        page.get_by_text("Nothing has failed").wait_for()
        progress = client.progress(house.study)
        assert progress["failed"] == 0 and progress["pending"] == count


def test_a_session_that_cannot_be_used_is_refused_with_its_reason(
    browser: Any, furnished: Furnished
) -> None:
    client, _, _ = furnished
    with tab(browser, client) as page:
        page.goto(f"{client.url}/loops")
        file = {"name": "monday.zip", "mimeType": "application/zip", "buffer": b"no zip file"}
        page.locator("#file").set_input_files(file)
        page.locator("#answer", has_text="zip").wait_for()
        assert page.locator("tr", has_text="monday").count() == 0
