"""Interpreting a session over REST: by workers with a bank, as closing the loop is."""

import json
from typing import Any

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient

from analysis.interpretation.contract import code
from server.operations import check
from tests.testbed.coordinators.rest_bodies import is_problem

Json = dict[str, Any]

BANK, OTHER = "f779fd93d326", "0123456789ab"
INTERVAL = {"median": 1.6, "interval50": [1.4, 1.8], "interval90": [1.2, 2.0], "unit": "Nm/rad"}
ANSWER: Json = {
    "stiffness": INTERVAL,
    "damping": {**INTERVAL, "unit": "Nm s/rad"},
    "if_muscles_of_bank": {"stiffness": {**INTERVAL, "interval90": [1.41, 1.82]}},
    "familiar": False,
    "why_not": "the <b>torque</b> of J4 has an offset",
    "known": [{"name": "forearm_mass", "value": 0.9, "sd": 0.1}],
    "next": [{"do": "weigh it", "minutes": 5, "half_width_after": 0.4}],
    "half_width": 0.5,
    "bank": BANK,
}
KNOWN = [{"name": "forearm_mass", "value": 0.9, "sd": 0.1}]


def asked(client: TestClient, session: str, **body: Any) -> Json:
    answer = client.post(f"/v1/sessions/{session}/interpretation", json=body)
    assert answer.status_code == 202, answer.text
    job: Json = answer.json()
    assert answer.headers["location"] == f"/v1/interpretations/{job['id']}"
    return job


def leased(client: TestClient, bank: str | None, worker: str = "w", host: str = "pc") -> Any:
    body = {"worker": {"id": worker, "host": host, "versions": {}}, "bank": bank}
    answer = client.post("/v1/close-loops/lease", json=body)
    assert answer.status_code in (201, 204)
    return answer.json() if answer.status_code == 201 else None


def handed_in(client: TestClient, lease: Json, answer: Any = ANSWER, bank: str = BANK) -> Any:
    proof = {"lease": lease["lease"], "fence": lease["fence"], "worker": "w", "code": code(bank)}
    text = answer if isinstance(answer, bytes) else json.dumps(answer).encode()
    files = {name: (name, of) for name, of in (("report.json", text), ("report.html", b"<p>"))}
    return client.post(f"/v1/close-loops/{lease['id']}/report", params=proof, files=files)


def test_an_answer_is_read_as_it_was_handed_in(
    client: TestClient, app: FastAPI, session: str
) -> None:
    job = asked(client, session, known=KNOWN, tolerance=0.5)
    assert job["state"] == "waiting" and "--bank" in job["note"]
    assert job["options"] == {"known": KNOWN, "tolerance": 0.5, "bank": None}
    lease = leased(client, BANK)
    assert (lease["id"], lease["kind"], lease["options"]) == (
        job["id"],
        "interpretation",
        job["options"],
    )
    assert handed_in(client, lease).status_code == 200
    place = f"/v1/interpretations/{job['id']}"
    shown = client.get(place).json()
    assert shown == {**ANSWER, "id": job["id"], "session_id": session, "state": "done"}
    assert json.loads(client.get(f"{place}/report.json").content) == ANSWER
    page = client.get(f"{place}/report.html")
    assert page.text == "<p>" and "sandbox" in page.headers["content-security-policy"]
    # It is no close-loop, and has no model of a robot.
    assert client.get(f"/v1/close-loops/{job['id']}").status_code == 404
    assert client.get(f"{place}/residuals.csv").status_code == 404
    assert check.faults(app.state.engine) == []


def test_nothing_needs_to_be_said_to_ask_for_an_interpretation(
    client: TestClient, session: str
) -> None:
    answer = client.post(f"/v1/sessions/{session}/interpretation")
    assert answer.status_code == 202, answer.text
    assert answer.json()["options"] == {"known": [], "tolerance": None, "bank": None}
    assert asked(client, session)["id"] == answer.json()["id"]


def test_a_worker_without_a_bank_or_with_another_gets_none(
    client: TestClient, session: str
) -> None:
    asked(client, session, bank=BANK)
    assert leased(client, None) is None
    assert leased(client, OTHER) is None
    assert leased(client, BANK)["kind"] == "interpretation"


def test_the_loop_of_the_same_session_is_a_job_beside(client: TestClient, session: str) -> None:
    first = asked(client, session)
    loop = client.post(f"/v1/sessions/{session}/close-loop").json()
    assert loop["id"] != first["id"]
    assert leased(client, None)["id"] == loop["id"]


def test_asking_the_same_again_finds_the_answer_until_the_bank_is_another(
    client: TestClient, session: str
) -> None:
    job = asked(client, session)
    assert asked(client, session)["id"] == job["id"]
    handed_in(client, leased(client, BANK))
    assert asked(client, session)["id"] == job["id"]
    assert asked(client, session, tolerance=0.4)["id"] != job["id"]
    assert asked(client, session, bank=OTHER)["id"] != job["id"]
    # The worker begins again with a bank that was extended.
    leased(client, OTHER)
    assert asked(client, session)["id"] != job["id"]


def test_a_job_that_failed_on_a_host_waits_for_another_with_a_bank_only(
    client: TestClient, session: str
) -> None:
    asked(client, session)
    lease = leased(client, BANK)
    leased(client, None, worker="v", host="other")
    body = {"lease": lease["lease"], "fence": lease["fence"], "worker": "w"}
    failure = f"/v1/close-loops/{lease['id']}/failure"
    client.post(failure, json={**body, "outcome": "crashed", "reason": "SIGSEGV"})
    # The other host has no bank: nobody else could do it.
    assert leased(client, BANK) is not None


MEANING_NOTHING: list[tuple[Json, str]] = [
    ({"known": [{"name": "forearm_mass", "value": 0.9}]}, "/known/0/sd"),
    ({"known": [{"name": "forearm_mass", "value": 0.9, "sd": 0.0}]}, "/known/0/sd"),
    ({"known": [{"name": "a\nb", "value": 0.9, "sd": 1.0}]}, "/known/0/name"),
    ({"known": KNOWN * 65}, "/known"),
    ({"tolerance": -1.0}, "/tolerance"),
    ({"bank": "../../bank.npz"}, "/bank"),
    ({"tolerence": 0.5}, "/tolerence"),
]


def test_what_means_nothing_is_refused_with_its_place(client: TestClient, session: str) -> None:
    for body, pointer in MEANING_NOTHING:
        answer = client.post(f"/v1/sessions/{session}/interpretation", json=body)
        problem = is_problem(answer, 422)
        assert pointer in json.dumps(problem)


@pytest.mark.parametrize(
    "report",
    [
        b"[1]",
        {"familiar": True},
        {"familiar": "yes", "stiffness": INTERVAL},
        {"familiar": True, "stiffness": {"median": "1.6", "interval90": [1.0, 2.0]}},
        {"familiar": True, "stiffness": {"median": 1.6, "interval90": [1.0, None]}},
    ],
)
def test_a_report_that_makes_no_sense_is_refused(
    client: TestClient, session: str, report: Any
) -> None:
    job = asked(client, session)
    assert handed_in(client, leased(client, BANK), report).status_code == 422
    assert client.get(f"/v1/interpretations/{job['id']}").json()["state"] == "waiting"


def test_pages_show_the_wearers_stiffness_and_no_markup_of_a_report(
    client: TestClient, session: str
) -> None:
    job = asked(client, session)
    handed_in(client, leased(client, BANK))
    listed = client.get("/loops").text
    assert f'href="/loops/{job["id"]}"' in listed and "unfamiliar" in listed
    page = client.get(f"/loops/{job['id']}").text
    assert "1.20 to 2.00" in page and "&lt;b&gt;torque" in page
    assert page.index("1.20 to 2.00") < page.index("1.41 to 1.82")
    assert f"/v1/interpretations/{job['id']}/report.html" in page
    assert "model_after.xml" not in page


def test_a_session_that_is_removed_takes_its_answers_with_it(
    client: TestClient, session: str
) -> None:
    job = asked(client, session)
    handed_in(client, leased(client, BANK))
    assert client.delete(f"/v1/sessions/{session}").status_code == 204
    assert client.get(f"/v1/interpretations/{job['id']}").status_code == 404
