"""Studies over REST: what is taken, and how every refusal looks."""

import json
from typing import Any

import pytest
from fastapi.testclient import TestClient

from server.operations.study import studies
from sim.models import ELBOW
from tests.testbed.coordinators.rest_bodies import STUDY, Json, asking, faults_of, is_problem


def test_a_study_is_created_and_found_again(client: TestClient, clock: Any) -> None:
    response = client.post("/v1/studies", json={**STUDY, "model": "elbow", "method": "morris"})
    assert response.status_code == 201
    study = response.json()
    assert response.headers["location"] == f"/v1/studies/{study['id']}"
    assert study == {
        "id": study["id"],
        "name": "first",
        "model": "elbow",
        "method": "morris",
        "sampling": "owen_blocks",
        "rows": 2,
        "seed": 1,
        "factors": [
            {"name": f.name, "distribution": {"kind": "uniform", "low": f.low, "high": f.high}}
            for f in ELBOW.sampled
        ],
        "fixed": {f.name: f.nominal for f in ELBOW.factors if f.optional},
        "outputs": list(ELBOW.outputs),
        "curves": {},
        "groups": {},
        "state": "running",
        "instances": 14,
        "created_at": clock.now,
        "priority": 0,
        "tags": [],
        "precision": None,
        "correlations": [],
        "correlation_kind": "rank",
        "units": {f.name: f.unit for f in ELBOW.factors} | dict(ELBOW.units),
    }
    assert client.get(f"/v1/studies/{study['id']}").json() == study


def test_ranges_distributions_fixed_values_and_outputs_are_taken(client: TestClient) -> None:
    normal = {"kind": "normal", "mean": 0.0, "sd": 1.0}
    body = {
        **STUDY,
        "factors": [{"name": "x3", "distribution": normal}, {"name": "x1", "range": [0, 2.5]}],
        "fixed": {"x2": 1},
        "outputs": ["y"],
        "seed": 2**63 - 1,
        "sampling": "latin_hypercube",
    }
    study = client.post("/v1/studies", json=body).json()
    assert study["factors"] == [
        {"name": "x1", "distribution": {"kind": "uniform", "low": 0.0, "high": 2.5}},
        {"name": "x3", "distribution": normal},
    ]
    assert (study["fixed"], study["seed"]) == ({"x2": 1.0}, 2**63 - 1)


def test_a_discrete_distribution_is_taken(client: TestClient) -> None:
    discrete = {"kind": "discrete", "values": [0.0, 2.0], "probabilities": [0.25, 0.75]}
    body = {**STUDY, "factors": [{"name": "x1", "distribution": discrete}]}
    study = client.post("/v1/studies", json=body).json()
    assert study["factors"] == [{"name": "x1", "distribution": discrete}]


def test_effects_have_a_scale_per_unit_by_the_distribution_that_the_study_says(
    client: TestClient,
) -> None:
    normal = {"name": "x2", "distribution": {"kind": "normal", "mean": 0.0, "sd": 1.0}}
    body = {**STUDY, "method": "morris", "factors": [{"name": "x1", "range": [0, 2.5]}, normal]}
    study = client.post("/v1/studies", json=body).json()
    shown = client.get(f"/v1/studies/{study['id']}/indices").json()["outputs"]["y"]["factors"]
    assert set(shown["x1"]["per_unit"]) == {"mu", "mu_star", "sigma", "scale"}
    assert shown["x1"]["per_unit"]["scale"] == {"width": 2.5, "by": "range"}
    assert shown["x2"]["per_unit"]["scale"]["by"] == "quantiles"


def test_a_repeated_submission_makes_no_second_study(client: TestClient) -> None:
    headers = {"Idempotency-Key": "night run"}
    first = client.post("/v1/studies", json=STUDY, headers=headers)
    again = client.post("/v1/studies", json={**STUDY, "seed": 1}, headers=headers)
    assert (first.status_code, again.status_code) == (201, 200)
    assert again.json() == first.json()
    other = client.post("/v1/studies", json={**STUDY, "rows": 3}, headers=headers)
    assert "'night run' was used for a different study" in is_problem(other, 409)["detail"]
    assert client.post("/v1/studies", json=STUDY).status_code == 201
    assert client.post("/v1/studies", json=STUDY).status_code == 201
    assert len(client.get("/v1/studies").json()["studies"]) == 3


MALFORMED: list[tuple[Json, str]] = [
    ({"rows": "2"}, "/rows"),
    ({"rows": 2.5}, "/rows"),
    ({"rows": True}, "/rows"),
    ({"name": ""}, "/name"),
    ({"name": "two\nlines"}, "/name"),
    ({"name": "  \u3000"}, "/name"),
    ({"seed": -1}, "/seed"),
    ({"seed": 2**63}, "/seed"),
    ({"factors": [{"name": "x1", "range": [0.0]}]}, "/factors/0/range"),
    ({"factors": [{"name": "x1", "span": [0.0, 1.0]}]}, "/factors/0/span"),
    ({"fixed": {"x1": 10**400}}, "/fixed/x1"),
    ({"surprise": 1}, "/surprise"),
]


def test_a_malformed_study_is_a_problem_that_points_at_the_fault(client: TestClient) -> None:
    for changes, pointer in MALFORMED:
        refused = client.post("/v1/studies", json={**STUDY, **changes})
        assert [found for found, _ in faults_of(refused)] == [pointer]


ENTRY = "must be a finite number, a list of them, or a text"
LEASE: Json = {"worker": {"id": "w", "host": "h", "versions": {"": 1}}, "models": ["ishigami"]}
#: What is sent where, and the one fault that is told of it.
ONE_FAULT: list[tuple[str, Any, str, str]] = [
    *(
        ("/v1/studies", {"factors": [{"name": "x1", "distribution": entry}]}, pointer, ENTRY)
        for entry, pointer in [
            ({"kind": "discrete", "values": {"a": 1}}, "/factors/0/distribution/values"),
            ({"kind": "discrete", "values": ["a", 1]}, "/factors/0/distribution/values"),
            ({"kind": "uniform", "low": True, "high": 2}, "/factors/0/distribution/low"),
            ({"kind": "uniform", "low": 10**400}, "/factors/0/distribution/low"),
            ({"kind": None}, "/factors/0/distribution/kind"),
            ({"kind": "\ud800"}, "/factors/0/distribution/kind"),
        ]
    ),
    (
        "/v1/studies",
        {"groups": {"": ["x1"]}},
        "/groups/",
        "the key: String should have at least 1 character",
    ),
    (
        "/v1/studies",
        {"groups": {"\ud800": ["x1"]}},
        "/groups/\ufffd\ufffd\ufffd",
        "the key: Input should be a valid string, unable to parse raw data as a unicode string",
    ),
    ("/v1/studies", {"groups": {"[key]": 1}}, "/groups/[key]", "Input should be a valid list"),
    (
        "/v1/leases",
        {**LEASE, "max_instances": 1},
        "/worker/versions/",
        "the key: String should have at least 1 character; Input should be a valid string",
    ),
    ("/v1/studies", {"factors": ["x1"]}, "/factors/0", "must be a JSON object"),
    ("/v1/studies", {"fixed": []}, "/fixed", "must be a JSON object"),
    ("/v1/studies", [], "", "must be a JSON object"),
    ("/v1/leases", [], "", "must be a JSON object"),
    ("/v1/models", [], "", "must be a JSON object"),
    ("/v1/studies", None, "", "the body is empty; send a JSON object"),
    ("/v1/leases", None, "", "the body is empty; send a JSON object"),
    ("/v1/models", None, "", "the body is empty; send a JSON object"),
]


def test_a_fault_is_told_once_where_it_was_sent_and_in_words_of_json(client: TestClient) -> None:
    for path, sent, pointer, detail in ONE_FAULT:
        whole = isinstance(sent, dict) and path == "/v1/studies"
        body = {**STUDY, **sent} if whole else sent
        content = b"" if body is None else json.dumps(body)
        refused = client.post(path, content=content, headers={"Content-Type": "application/json"})
        assert faults_of(refused) == [(pointer, detail)], (path, sent)


def test_half_of_a_character_in_a_name_is_refused_as_it_was_written(client: TestClient) -> None:
    half = "\ud800"
    uniform = {"kind": "uniform", "low": 0, "high": 1, half: 1}
    for changes, pointer in [
        ({"fixed": {half: 1}}, f"/fixed/{half}"),
        ({"factors": [{"name": "x1", "distribution": uniform}]}, "/factors/0/distribution"),
        ({f"correlation{half}": 1}, f"/correlation{half}"),
    ]:
        refused = client.post(
            "/v1/studies",
            content=json.dumps({**STUDY, **changes}),
            headers={"Content-Type": "application/json"},
        )
        assert [found for found, _ in faults_of(refused)] == [pointer]
        assert b"\\ud800" in refused.content


def test_several_faults_are_told_each_at_its_place(client: TestClient) -> None:
    refused = client.post("/v1/studies", json={**STUDY, "rows": "2", "surprise": 1})
    assert [found for found, _ in faults_of(refused)] == ["/rows", "/surprise"]


def test_a_study_that_makes_no_sense_is_a_problem_with_a_pointer(client: TestClient) -> None:
    body = {**STUDY, "factors": [{"name": "x1", "range": [1.0, 0.0]}]}
    problem = is_problem(client.post("/v1/studies", json=body), 422)
    assert problem["pointer"] == "/factors/0/range"
    assert "low of a uniform distribution must be below high" in problem["detail"]


SAID_AS_DEPENDENCE: list[tuple[Json, str]] = [
    ({"correlation": [[1.0, 0.5], [0.5, 1.0]]}, "/correlation"),
    ({"Covariance": None}, "/Covariance"),
    ({"copula": {"kind": "gaussian"}}, "/copula"),
    (
        {"factors": [{"name": "x1"}, {"name": "x2", "depends_on": "x1"}]},
        "/factors/1/depends_on",
    ),
    (
        {"factors": [{"name": "x1", "distribution": {"kind": "normal", "correlation": 0.5}}]},
        "/factors/0/distribution/correlation",
    ),
]


def test_dependent_factors_are_refused_with_what_would_be_right(client: TestClient) -> None:
    for changes, pointer in SAID_AS_DEPENDENCE:
        problem = is_problem(client.post("/v1/studies", json={**STUDY, **changes}), 422)
        assert problem["pointer"] == pointer
        assert 'said by the study\'s correlations, as [["a", "b", 0.6]]' in problem["detail"]
        assert "by its correlation_kind, rank or linear" in problem["detail"]
        assert client.get("/v1/studies").json() == {"studies": [], "next": None}


OTHER_SHAPES = ["[]", "3", '"text"', '{"factors": {"correlation": 1}}', "null"]


def test_a_body_of_any_other_shape_is_a_problem_too(client: TestClient) -> None:
    for body in OTHER_SHAPES:
        headers = {"Content-Type": "application/json"}
        is_problem(client.post("/v1/studies", content=body, headers=headers), 422)


NOT_FINITE = ["NaN", "Infinity", "-Infinity", "1e999"]


@pytest.mark.parametrize("tag", ["lab-2,fast", "fast ", "\u3000", ","])
def test_a_tag_that_no_worker_can_have_is_refused_with_what_is_right(
    client: TestClient, tag: str
) -> None:
    response = client.post("/v1/studies", json={**STUDY, "tags": ["lab-2", tag]})
    why = (
        f"no worker can have the tag {tag!r}: it has no comma, and no blank at its ends; "
        'several are several texts, as ["lab-2", "fast"]'
    )
    assert faults_of(response) == [("/tags/1", why)]
    assert client.get("/v1/studies").json() == {"studies": [], "next": None}


def test_numbers_that_are_not_finite_are_refused(client: TestClient) -> None:
    for number in NOT_FINITE:
        text = json.dumps({**STUDY, "fixed": {"x1": 0}}).replace('"x1": 0', f'"x1": {number}')
        response = client.post(
            "/v1/studies", content=text, headers={"Content-Type": "application/json"}
        )
        assert is_problem(response, 422)["pointer"] == "/fixed/x1"


@pytest.mark.parametrize(
    ("body", "why"),
    [
        (b'{"name": ', "Expecting value at character 9"),
        (b"[" * 100_000, "it is nested too deeply"),
        (b'{"name": "\xff"}', "it is not UTF-8 from byte 10 on"),
        (b'{"rows": ' + b"9" * 5000 + b"}", "a whole number in it has more than 4300 digits"),
    ],
)
def test_a_body_that_is_not_json_is_a_problem(client: TestClient, body: bytes, why: str) -> None:
    headers = {"Content-Type": "application/json"}
    response = client.post("/v1/studies", content=body, headers=headers)
    assert faults_of(response) == [("", f"the body is not JSON: {why}")]


@pytest.mark.parametrize(
    ("what", "pointer"),
    [
        ('"rows": 2, "rows": 2000', "/rows"),
        ('"fixed": {"rows": 1, "rows": 2}', "/fixed/rows"),
        ('"factors": [{"name": "x1"}, {"rows": 1, "rows": 2}]', "/factors/1/rows"),
    ],
)
def test_a_key_that_comes_twice_is_named_and_neither_is_taken(
    client: TestClient, what: str, pointer: str
) -> None:
    text = json.dumps(STUDY).replace('"rows": 2', what)
    response = client.post(
        "/v1/studies", content=text, headers={"Content-Type": "application/json"}
    )
    why = "the key 'rows' comes twice in an object: leave out one"
    assert faults_of(response) == [(pointer, why)]


@pytest.mark.parametrize(
    ("headers", "said"),
    [
        ({}, "the request has no Content-Type"),
        ({"Content-Type": "text/plain"}, "the request's Content-Type is text/plain"),
    ],
)
def test_json_that_is_not_called_so_is_a_problem_that_says_what_to_send(
    client: TestClient, headers: Json, said: str
) -> None:
    response = client.post("/v1/studies", content=json.dumps(STUDY), headers=headers)
    assert is_problem(response, 415)["detail"] == f"{said}: send application/json"


REFUSED: list[tuple[str, str, int]] = [
    ("GET", "/v1/nothing", 404),
    ("GET", "/v1/studies/nothing", 404),
    ("GET", "/v1/studies/nothing/progress", 404),
    ("GET", "/v1/studies/nothing/indices", 404),
    ("GET", "/v1/studies/nothing/results.csv", 404),
    ("GET", "/v1/studies/nothing/results.parquet", 404),
    ("POST", "/v1/studies/nothing/cancel", 404),
    ("GET", "/v1/studies/%00", 422),
    ("DELETE", "/v1/studies", 405),
]


def test_every_refusal_is_a_problem(client: TestClient) -> None:
    for method, path, status in REFUSED:
        is_problem(client.request(method, path), status)


def test_a_failure_of_the_coordinator_is_a_problem_that_gives_nothing_away(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("secret inner workings")

    monkeypatch.setattr(studies, "listed", fail)
    assert "secret" not in is_problem(client.get("/v1/studies"), 500)["detail"]


def test_values_far_outside_the_validated_range_must_be_asked_for(client: TestClient) -> None:
    body = {**STUDY, "fixed": {"x2": 40.0}, "factors": [{"name": "x1"}, {"name": "x3"}]}
    problem = is_problem(client.post("/v1/studies", json=body), 422)
    assert problem["pointer"] == "/fixed/x2"
    assert "x2 is 40, far outside -3.14159 to 3.14159" in problem["detail"]
    taken = client.post("/v1/studies", json={**body, "outside_range": True})
    assert (taken.status_code, taken.json()["fixed"]) == (201, {"x2": 40.0})


def test_factors_that_depend_on_each_other_are_sampled_so(client: TestClient) -> None:
    correlations = [["x1", "x3", 0.6], ["x2", "x3", -0.3]]
    body = {**STUDY, "method": "shapley", "correlations": correlations}
    study = client.post("/v1/studies", json=body).json()
    assert (study["correlations"], study["correlation_kind"]) == (correlations, "rank")
    assert study["instances"] == 2 * 6
    again = client.get(f"/v1/studies/{study['id']}").json()
    assert again == study
    more = client.post(f"/v1/studies/{study['id']}/extend", json={"rows": 4}).json()
    assert more["correlations"] == correlations
    granted = client.post("/v1/leases", json=asking(max_instances=6)).json()["instances"]
    alone = client.post("/v1/studies", json={**body, "correlations": []}).json()
    assert alone["correlations"] == []
    assert [instance["position"] for instance in granted] == list(range(6))
    first = granted[0]["parameters"]
    # A point that keeps some of A's factors keeps their bits.
    assert any(granted[2]["parameters"][name] == first[name] for name in ("x1", "x2", "x3"))


NO_DEPENDENCE: list[tuple[Json, str, str]] = [
    ({"method": "saltelli"}, "/method", "with correlations the method is shapley or sample"),
    ({"correlation_kind": "kendall"}, "/correlation_kind", "expected one of rank, linear"),
    ({"correlations": [["x1", "x2"]]}, "/correlations/0", "two factors and a number"),
    ({"correlations": [["x1", "x2", "much"]]}, "/correlations/0", "two factors and a number"),
    ({"correlations": [["x1", "x9", 0.5]]}, "/correlations/0", "x9 is not sampled"),
    ({"fixed": {"x3": 0.0}}, "/correlations/0", "x3 is not sampled"),
    (
        {"correlations": [["x1", "x2", 0.9], ["x2", "x3", 0.9], ["x1", "x3", -0.9]]},
        "/correlations",
        'the nearest that can be sampled are [["x1", "x2", ',
    ),
]


def test_what_dependence_cannot_be_is_refused(client: TestClient) -> None:
    for changes, pointer, sentence in NO_DEPENDENCE:
        body = {**STUDY, "method": "shapley", "correlations": [["x1", "x3", 0.6]], **changes}
        problem = is_problem(client.post("/v1/studies", json=body), 422)
        assert problem["pointer"] == pointer
        assert sentence in problem["detail"]


def test_large_answers_are_not_gone_through_value_by_value_while_workers_wait(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = client.post("/v1/studies", json=STUDY).json()["id"]
    client.post("/v1/leases", json=asking(max_instances=2))
    # FastAPI does so in the event loop: 0.3 s for the indices of 60 outputs.
    monkeypatch.delattr("fastapi.routing.jsonable_encoder")
    for large in ("indices", "instances"):
        assert client.get(f"/v1/studies/{study}/{large}").status_code == 200
