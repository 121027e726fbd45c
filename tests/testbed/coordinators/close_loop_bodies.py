"""Who asks for close-loop jobs, works on them and reads them, for tests of the REST interface."""

import json
from typing import Any

from fastapi.testclient import TestClient

from analysis.closeloop.contract import REPORT_FILES

Json = dict[str, Any]

REPORT: Json = {
    "schema": 1,
    "verdict": "effect_found",
    "effects": [{"name": "coulomb_friction", "parameters": {"torque": {"value": 0.1 + 0.2}}}],
    "session": {"folder": "monday"},
}
CODE = "0123456789abcdef"


def asked(client: TestClient, session: str) -> Json:
    answer = client.post(f"/v1/sessions/{session}/close-loop")
    assert answer.status_code == 202
    job: Json = answer.json()
    assert answer.headers["location"] == f"/v1/close-loops/{job['id']}"
    return job


def leased(client: TestClient, worker: str = "w", host: str = "pc-1") -> Json | None:
    body = {"worker": {"id": worker, "host": host, "versions": {"mujoco": "4.0.1"}}}
    answer = client.post("/v1/close-loops/lease", json=body)
    assert answer.status_code in (201, 204)
    return answer.json() if answer.status_code == 201 else None


def held(client: TestClient, worker: str = "w", host: str = "pc-1") -> Json:
    lease = leased(client, worker, host)
    assert lease is not None
    return lease


def handed_in(
    client: TestClient,
    lease: Json,
    *,
    report: Any = REPORT,
    worker: str = "w",
    lacking: str = "",
    **changes: Any,
) -> Any:
    proof = {"lease": lease["lease"], "fence": lease["fence"], "worker": worker, "code": CODE}
    text = report if isinstance(report, bytes) else json.dumps(report).encode()
    contents = {"report.json": text, "report.html": b"<p>", "model_after.xml": b"<mujoco/>"}
    contents["residuals.csv"] = b"file,role\n" * 200_000
    files = {name: (name, contents[name]) for name in REPORT_FILES if name != lacking}
    path = f"/v1/close-loops/{lease['id']}/report"
    return client.post(path, params={**proof, **changes}, files=files)


def gone_wrong(client: TestClient, lease: Json, outcome: str, worker: str = "w", **say: Any) -> Any:
    body = {"lease": lease["lease"], "fence": lease["fence"], "worker": worker}
    body |= {"outcome": outcome, "reason": f"it {outcome}", **say}
    return client.post(f"/v1/close-loops/{lease['id']}/failure", json=body)


def shown(client: TestClient, job: Json) -> Json:
    answer: Json = client.get(f"/v1/close-loops/{job['id']}").json()
    return answer
