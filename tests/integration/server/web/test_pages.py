"""Every page of a coordinator whose users and workers call things by markup."""

import html
import json
import re
from html.parser import HTMLParser

import pytest
import sqlalchemy as sa
from fastapi import FastAPI
from fastapi.testclient import TestClient

from analysis.reports.wording import visible
from analysis.sensitivity.service import catch_up
from server.operations import tokens, watching
from server.operations.study import studies
from server.operations.study.result_log import StoreResultLog
from server.store.database.engine import reading, writing
from server.store.database.schema import results
from server.store.fleet import results as store_results
from server.web.new_study import LEAST_SECONDS
from server.web.page import Look
from server.web.pages import PAGES
from tests.testbed.coordinators.full_house import MARKUP, SHORT, UNSEEN, House, furnish

BROWSER = {"Accept": "text/html"}


@pytest.fixture
def house(app: FastAPI, client: TestClient) -> House:
    """A database with something on every page."""
    return furnish(app.state.engine)


class Elements(HTMLParser):
    """What a browser would make of a page."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.wrong: list[str] = []
        self.text = ""
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        for name, value in attrs:
            self.text += f" {value}"
            if name.startswith("on") or (name in ("src", "href") and "evil" in (value or "")):
                self.wrong.append(f"<{tag} {name}={value}>")

    def handle_data(self, data: str) -> None:
        self.text += data


def test_names_tags_reasons_and_columns_are_text_on_every_page(
    client: TestClient, house: House
) -> None:
    seen = ""
    for path in house.pages:
        answer = client.get(path, headers=BROWSER)
        assert answer.status_code == 200, path
        found = Elements(answer.text)
        assert found.wrong == [], path
        # Its megabytes are read when the rest has been painted (figures.js).
        assert "plotly.min.js" not in answer.text
        assert "i" not in found.tags, path
        seen += found.text
        assert not set(UNSEEN) & set(answer.text) - set("gnp"), path
    assert MARKUP in seen and SHORT in seen and visible(UNSEEN) in seen


def test_what_a_page_is_sent_later_is_text_too(
    app: FastAPI, client: TestClient, house: House
) -> None:
    names = {"study_id": house.study, "loop_id": house.loop, "name": house.model}
    look = Look(
        engine=app.state.engine,
        now=app.state.clock(),
        may_submit=True,
        names=names,
        state=app.state,
    )
    parts = [part for page in PAGES for part in page.parts(look).items()]
    assert len(parts) > 10
    for name, part in parts:
        if name.startswith("figure:"):
            # plotly reads a few tags in texts.
            assert "<i" not in json.dumps(part) and "<img" not in json.dumps(part)
        else:
            assert Elements(part).wrong == []
        assert not set(UNSEEN) & set(json.dumps(part, ensure_ascii=False)) - set("gnp")


def test_a_reader_sees_all_pages_and_no_order_on_any(
    app: FastAPI, client: TestClient, house: House
) -> None:
    _, secret = tokens.create(app.state.engine, name="guest", scopes=["read"], now=1.0)
    client.headers["Authorization"] = f"Bearer {secret}"
    for path in house.pages:
        html = client.get(path, headers=BROWSER).text
        for order in ("data-path", "upload.js", "new_study.js", 'id="submit"'):
            assert order not in html, (path, order)


def test_what_is_not_there_is_said_on_a_page(client: TestClient) -> None:
    for path in ("/studies/none", "/loops/none", "/models/none", "/new-study?model=none"):
        answer = client.get(path, headers=BROWSER)
        assert answer.status_code == 404 and "there is no" in answer.text, path


def test_an_empty_coordinator_says_on_every_page_what_to_do_next(client: TestClient) -> None:
    for path, said in (
        ("/", "rehyb study submit"),
        ("/fleet", "rehyb-worker"),
        ("/loops", "rehyb close-loop"),
    ):
        assert said in client.get(path, headers=BROWSER).text


@pytest.mark.parametrize(
    "choices", ["?state=none&sort=none&find=%00", "?find=ishigami&state=complete&sort=failed"]
)
def test_any_choice_is_answered(client: TestClient, house: House, choices: str) -> None:
    assert client.get(f"/{choices}", headers=BROWSER).status_code == 200


def test_runs_are_a_bounded_sample_and_failures_lie_where_they_happened(
    client: TestClient, house: House
) -> None:
    runs = client.get(f"/studies/{house.study}/sample?factor=x1&other=x1").json()
    assert runs["rows"] == runs["of"] == 16 and (runs["factor"], runs["other"]) == ("x1", "x1")
    assert runs["table"]["head"] == ["row", "outcome", "x1", "x2", "x3", "y"]
    failed = [line for line in runs["table"]["rows"] if line[1] != "ok"]
    assert failed and all(x1 > 2.0 and y is None for _, _, x1, _, _, y in failed)
    glowing = runs["figures"]["scatter"]["data"][-1]
    assert glowing["x"] == pytest.approx([line[2] for line in failed], rel=1e-5)
    good = runs["figures"]["pair"]["data"][0]
    assert len(good["x"]) == len(good["hovertext"]) == 16 - len(failed)


def test_any_factor_that_is_asked_for_is_answered(client: TestClient, house: House) -> None:
    for query in ("?factor=none&other=%00", "?factor=x3", "?output=y&other=x1"):
        runs = client.get(f"/studies/{house.study}/sample{query}").json()
        assert {runs["factor"], runs["other"]} <= {"x1", "x2", "x3"}
        assert runs["factor"] != runs["other"], query
    assert client.get(f"/studies/{house.study}/sample?output=w").status_code == 404


@pytest.mark.parametrize("method", ["morris", "saltelli_second_order"])
def test_a_study_of_curves_alone_has_a_page_before_and_after_results(
    app: FastAPI, client: TestClient, method: str
) -> None:
    asked = {"name": "c", "model": "elbow", "method": method, "rows": 2}
    factors = [{"name": name} for name in ("forearm_mass", "forearm_length")]
    study = client.post(
        "/v1/studies", json=asked | {"outputs": ["torque_over_phase"], "factors": factors}
    ).json()
    page = f"/studies/{study['id']}"
    assert "torque over phase" in client.get(page, headers=BROWSER).text
    worker = {"id": "w", "host": "h", "versions": {"mujoco": "4.0.1"}}
    ask = {"worker": worker, "models": ["elbow"], "max_instances": 12}
    lease = client.post("/v1/leases", json=ask).json()
    results = [
        {
            "instance": one["id"],
            "outcome": "ok",
            "outputs": {
                "torque_over_phase": [one["parameters"]["forearm_mass"] * i for i in range(101)]
            },
        }
        for one in lease["instances"]
    ]
    proof = {"lease": lease["id"], "fence": lease["fence"], "worker": "w", "results": results}
    assert client.post("/v1/results", json=proof).status_code == 200
    catch_up(StoreResultLog(app.state.engine), study["id"])
    for path in (page, f"{page}?output=torque_over_phase", "/", f"{page}/sample"):
        assert client.get(path, headers=BROWSER).status_code == 200, path


def test_the_form_counts_on_no_run_that_takes_less_than_it_costs_to_hand_it_out(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("server.web.new_study.watching.mean_seconds", lambda *_: 1e-6)
    found = client.get("/new-study?model=ishigami", headers=BROWSER).text
    said = re.search(r'"seconds": ([^,]+),', html.unescape(found))
    assert said is not None and float(said[1]) == LEAST_SECONDS


def test_the_form_goes_by_how_fast_results_came_and_not_by_how_long_one_took(
    app: FastAPI, client: TestClient, house: House
) -> None:
    """A worker with eight processes brings eight in the time that one takes."""
    with writing(app.state.engine) as connection:
        # Two workers, each with ten results a second, of which each took 0.1 s: all said so.
        connection.execute(
            sa.update(results)
            .where(results.c.study_id == house.study)
            .values(received_at=1000.0 + 0.05 * results.c.seq)
        )
    found = html.unescape(client.get("/new-study?model=ishigami", headers=BROWSER).text)
    said = re.search(r'"seconds": ([^,]+),', found)
    assert said is not None and float(said[1]) == pytest.approx(0.05)


def test_failed_and_good_runs_are_drawn_from_the_same_part_of_the_study(
    app: FastAPI, client: TestClient, house: House
) -> None:
    study = studies.get(app.state.engine, house.study)
    failed = watching.latest_failed(app.state.engine, study, limit=500)
    assert len(failed) == study.failures["diverged"]
    assert [one["seq"] for one in failed] == sorted((o["seq"] for o in failed), reverse=True)
    since = study.result_count // 2
    good = watching.good_among(app.state.engine, study, since=since, limit=8)
    assert 0 < len(good) <= 8
    with reading(app.state.engine) as connection:
        log = store_results.logged(connection, study.id, after=0, limit=1000)
    at = {(row, position): (seq, outcome) for seq, row, position, outcome, _ in log}
    assert all(at[place][0] >= since and at[place][1] == "ok" for place in good)
    # Any position of a row, as those that failed.
    assert len({position for _, position in good}) > 1


def test_failures_are_found_by_their_index(app: FastAPI, client: TestClient, house: House) -> None:
    asked: list[tuple[str, object]] = []
    sa.event.listen(
        app.state.engine,
        "before_cursor_execute",
        lambda _c, _u, statement, values, *_: asked.append((statement, values)),
    )
    study = studies.get(app.state.engine, house.study)
    watching.latest_failed(app.state.engine, study, limit=5)
    statement, values = next(one for one in asked if "JOIN workers" in one[0])
    lite = app.state.engine.dialect.name == "sqlite"
    with reading(app.state.engine) as connection:
        if not lite:
            # So few rows are read faster without any index.
            for other in ("seqscan", "bitmapscan", "sort"):
                connection.exec_driver_sql(f"SET LOCAL enable_{other} = off")
        explain = "EXPLAIN QUERY PLAN " if lite else "EXPLAIN "
        plan = str(connection.exec_driver_sql(explain + statement, values).fetchall())
    assert "results_failed" in plan, plan


def test_two_studies_are_compared_factor_by_factor(
    app: FastAPI, client: TestClient, house: House
) -> None:
    same = client.get(f"/compare?a={house.study}&b={house.study}", headers=BROWSER).text
    assert same.count("<td>overlap</td>") >= 2 and "<td>apart</td>" not in same
    assert "differs" not in same
    asked = {"name": "other seed", "model": "ishigami", "method": "saltelli", "rows": 4}
    fixed = {"fixed": {"x3": 0.5}, "factors": [{"name": "x1"}, {"name": "x2"}]}
    other = client.post("/v1/studies", json=asked | fixed | {"seed": 9}).json()["id"]
    found = Elements(client.get(f"/compare?a={house.study}&b={other}", headers=BROWSER).text)
    assert "only one samples it" in found.text and "fixed at 0.5" in found.text
    assert "differs" in found.text
    # The latest of the same model is what is beside it at first.
    assert f"/studies/{other}" in client.get(f"/compare?a={house.study}", headers=BROWSER).text


def test_what_may_come_of_a_discrete_factor_is_compared_too(
    client: TestClient, house: House
) -> None:
    drawn = {"kind": "discrete", "values": [-1, 0, 2], "probabilities": [0.25, 0.5, 0.25]}
    asked = {"name": "discrete", "model": "ishigami", "method": "saltelli", "rows": 4}
    asked["factors"] = [{"name": "x1", "distribution": drawn}, {"name": "x2"}]
    other = client.post("/v1/studies", json=asked).json()["id"]
    found = Elements(client.get(f"/compare?a={house.study}&b={other}", headers=BROWSER).text)
    assert "discrete: values -1 0 2, probabilities 0.25 0.5 0.25" in found.text


def test_studies_of_different_things_are_not_drawn_as_if_they_were_one(
    client: TestClient, house: House
) -> None:
    asked = {"name": "m", "model": "ishigami", "method": "morris", "rows": 2}
    morris = client.post("/v1/studies", json=asked).json()["id"]
    page = client.get(f"/compare?a={house.study}&b={morris}", headers=BROWSER).text
    assert "are different things" in Elements(page).text
    page = client.get(f"/compare?a={house.study}&b={house.other}", headers=BROWSER).text
    assert "are different things" in page
    assert client.get("/compare?a=none&b=none", headers=BROWSER).status_code == 404


def test_one_study_alone_has_nothing_beside_it(client: TestClient) -> None:
    assert "not two studies yet" in client.get("/compare", headers=BROWSER).text


def test_runs_are_paged_through_by_state_and_from_any_row(client: TestClient, house: House) -> None:
    page = f"/studies/{house.study}/runs"

    def rows(query: str) -> list[str]:
        text = client.get(page + query, headers=BROWSER).text
        return re.findall(r'<tr data-key="([^"]+)"', text)

    first = rows("")
    assert len(first) == 50 and first[:2] == ["0-0", "0-1"]
    text = client.get(page, headers=BROWSER).text
    onward = re.search(r'runs(\?state=&amp;output=y&amp;after=[\d:]+)"', text)
    assert onward is not None
    second = rows(html.unescape(onward[1]))
    assert second and not set(first) & set(second) and len(first + second) == 80
    assert rows("?row=3")[0] == "3-0"
    failed = client.get(page + "?state=failed", headers=BROWSER).text
    assert "diverged" in failed and len(rows("?state=failed")) < 50
    for query in ("?state=none&row=-1&after=x", "?after=99999999999999999999:1", "?row=9e9"):
        assert client.get(page + query, headers=BROWSER).status_code == 200, query
    assert client.get(page + "?output=w", headers=BROWSER).status_code == 404
