"""A trace leads from a study's submission to its results, through any coordinators."""

import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from threading import Event
from typing import Any

import pytest
from fastapi.testclient import TestClient
from opentelemetry.sdk.trace import ReadableSpan
from opentelemetry.sdk.trace.export import SpanExportResult
from opentelemetry.sdk.trace.export.in_memory_span_exporter import InMemorySpanExporter
from opentelemetry.trace import format_span_id
from pydantic import SecretStr

import server.app
from server import tracing
from server.app import create_app
from server.settings import Settings
from tests.testbed.coordinators.rest_bodies import STUDY, asking, posting, result

TOKEN = "correct-horse"
ENDPOINT = "OTEL_EXPORTER_OTLP_ENDPOINT"


@pytest.fixture
def exporter(monkeypatch: pytest.MonkeyPatch) -> InMemorySpanExporter:
    """Takes what would be sent."""
    found = InMemorySpanExporter()
    real = tracing.provider
    monkeypatch.setattr(tracing, "provider", lambda: real(found))
    return found


@pytest.fixture
def start(upgraded_file: Path, tmp_path: Path) -> Iterator[Callable[[], TestClient]]:
    """Starts a coordinator on the one database."""
    file = shutil.copyfile(upgraded_file, tmp_path / "rehyb.sqlite3")
    settings = Settings(database_url=f"sqlite:///{file}", token=SecretStr(TOKEN))
    with ExitStack() as running:

        def started() -> TestClient:
            client = TestClient(create_app(settings))
            client.headers["Authorization"] = f"Bearer {TOKEN}"
            return running.enter_context(client)

        yield started


def work(*coordinators: TestClient) -> tuple[str, dict[str, Any]]:
    """Submit to the first coordinator, lease from the last, and post to the first again."""
    study = coordinators[0].post("/v1/studies", json=STUDY).json()["id"]
    lease = coordinators[-1].post("/v1/leases", json=asking(max_instances=3)).json()
    results = [result(instance) for instance in lease["instances"]]
    refused = {**results[0], "instance": f"{study}:99:0"}
    body = posting(lease, [*results, refused], next=asking(max_instances=3))
    assert coordinators[0].post("/v1/results", json=body).status_code == 409
    return study, lease


def sent(exporter: InMemorySpanExporter, *coordinators: TestClient) -> list[ReadableSpan]:
    for one in coordinators:
        one.app.state.traces.provider.force_flush()  # type: ignore[attr-defined]
    return [*exporter.get_finished_spans()]


def test_a_trace_leads_from_a_submission_through_two_coordinators_to_the_results(
    start: Callable[[], TestClient],
    exporter: InMemorySpanExporter,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv(ENDPOINT, "http://127.0.0.1:9")
    one, other = start(), start()
    study, lease = work(one, other)
    spans = sent(exporter, one, other)
    own = [span for span in spans if span.instrumentation_scope.name == "rehyb"]
    assert [span.name for span in own].count("lease") == 2
    assert len({span.context.trace_id for span in own}) == 1
    assert {span.attributes["rehyb.study"] for span in own} == {study}
    of_lease = [span for span in own if span.attributes.get("rehyb.lease") in (None, lease["id"])]
    by_name = {span.name: span for span in of_lease}
    assert by_name.keys() == {"submit", "lease", "run", "complete"}
    above = {
        name: span.parent and format_span_id(span.parent.span_id) for name, span in by_name.items()
    }
    ids = {name: format_span_id(span.context.span_id) for name, span in by_name.items()}
    assert above == {
        "submit": None,
        "lease": ids["submit"],
        "run": ids["lease"],
        "complete": ids["run"],
    }
    assert by_name["complete"].attributes["rehyb.results"] == 3
    # Each names the request that it was a part of.
    requests = {span.context.span_id for span in spans if span.name == "POST /v1/results"}
    assert {link.context.span_id for link in by_name["complete"].links} <= requests
    assert all(span.start_time <= span.end_time for span in spans)


def test_what_is_not_sampled_is_not_sampled_anywhere(
    start: Callable[[], TestClient],
    exporter: InMemorySpanExporter,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv(ENDPOINT, "http://127.0.0.1:9")
    monkeypatch.setenv("OTEL_TRACES_SAMPLER", "parentbased_traceidratio")
    monkeypatch.setenv("OTEL_TRACES_SAMPLER_ARG", "0.0")
    coordinator = start()
    work(coordinator)
    assert sent(exporter, coordinator) == []


@pytest.mark.parametrize(
    "said",
    [
        {},
        {ENDPOINT: "http://127.0.0.1:9", "OTEL_SDK_DISABLED": "true"},
        {ENDPOINT: "collector:4318"},
    ],
)
def test_nothing_is_traced_unless_the_environment_says_where_to(
    said: dict[str, str], start: Callable[[], TestClient], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in server.app.TRACES_TO:
        monkeypatch.delenv(name, raising=False)
    for name, value in said.items():
        monkeypatch.setenv(name, value)
    coordinator = start()
    assert coordinator.app.state.traces is None  # type: ignore[attr-defined]
    work(coordinator)


def test_an_address_without_its_scheme_is_said_once(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv(ENDPOINT, "collector:4318")
    assert server.app._traces() is None
    assert "must begin with http:// or https://" in caplog.text


def test_a_collector_that_takes_nothing_keeps_no_coordinator_from_ending(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    taken = Event()

    class Hanging(InMemorySpanExporter):
        def export(self, spans: Sequence[ReadableSpan]) -> SpanExportResult:
            taken.wait(30.0)
            return SpanExportResult.FAILURE

    monkeypatch.setattr(tracing, "CLOSE_SECONDS", 0.05)
    traces = tracing.Traces(tracing.provider(Hanging()))
    traces.completed("s", "l", "w", 1)
    began = time.monotonic()
    traces.close()
    taken.set()
    assert time.monotonic() - began < 10.0
    assert "nobody takes the last traces" in caplog.text


def test_a_lease_of_another_age_and_a_lease_of_tomorrow_are_no_trouble() -> None:
    came = 5_000_000
    assert tracing._granted("no number", came) == tracing._granted("f" * 32, came) == came
    assert tracing._granted(f"{7:016x}", came) == 7000
