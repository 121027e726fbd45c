"""A coordinator's database with something on every page, where every name is markup."""

import base64
import io
import json
import time
from dataclasses import dataclass
from typing import Any

from sqlalchemy.engine import Engine

from analysis.closeloop.contract import REPORT_FILES
from analysis.sensitivity.service import catch_up
from models.description import Description
from server.logic.fleet.verdicts import Report
from server.logic.study.plans import draw_up
from server.logic.study.points import instance_id, parameters
from server.operations import close_loops, models, sessions
from server.operations.close_loops import Proof
from server.operations.study import studies
from server.operations.study.result_log import StoreResultLog
from server.records import Introduction
from tests.testbed.coordinators import exchanges
from tests.testbed.coordinators.records import plan

#: Ends attributes, elements, strings of JavaScript and expressions of templates; asks for a picture
#: and sets a variable if it ever is more than text.
MARKUP = """"'></script><img src="/evil" onerror="window.evil=1">{{7*7}}&lt;b&gt;"""
#: The same where there is less room.
SHORT = "'\"><i onclick=evil()>"
#: What turns all behind it around, shows as nothing, and rings.
UNSEEN = "\u202egnp\u200b\x07"

_PIXEL = base64.b64encode(b"\x89PNG\r\n\x1a\n").decode()
_PICTURE = f'<img alt="{SHORT.replace(chr(34), "&quot;")}" src="data:image/png;base64,{_PIXEL}">'
_REPORT_HTML = _PICTURE + f'<script>window.evil=1</script>{MARKUP}<img src="/evil">'
_REPORT: dict[str, Any] = {
    "effects": [],
    "error": {MARKUP: {MARKUP: {"before": 2.0, "after": 1.0, "floor": 0.9, "unit": MARKUP}}},
    "floor": {MARKUP: {"from": MARKUP}},
    "unexplained": {},
    "impedance": {},
    "identified": {},
    "advice": [MARKUP],
    "warnings": [MARKUP],
    "diagnostics": {},
    "ladder": [],
    "session": {"folder": MARKUP},
}


@dataclass(frozen=True, kw_only=True)
class House:
    """What is where."""

    study: str
    other: str
    loop: str
    model: str

    @property
    def pages(self) -> list[str]:
        """The address of every page."""
        return [
            "/",
            "/new-study",
            f"/new-study?model={self.model}&method=saltelli",
            f"/studies/{self.study}",
            f"/studies/{self.study}/failures",
            f"/studies/{self.other}",
            f"/studies/{self.other}/failures",
            f"/studies/{self.study}/runs",
            "/compare",
            f"/compare?a={self.study}&b={self.study}",
            "/fleet",
            "/fleet?all=1",
            "/loops",
            f"/loops/{self.loop}",
            "/models",
            f"/models/{self.model}",
            "/sign-in",
        ]


def furnish(engine: Engine, *, rows: int = 16) -> House:
    """Fill a database as workers and readers would who mean no good."""
    now = time.time()
    study, _ = studies.create(
        engine,
        plan(name=MARKUP + UNSEEN, method="saltelli", rows=rows),
        key=None,
        digest="",
        now=now - 60.0,
        tags=[SHORT + UNSEEN],
    )
    versions = {"mujoco": SHORT, "canary": SHORT, "code": SHORT, "cpu": MARKUP}
    worker = {
        "worker": f"w {SHORT}",
        "host": MARKUP + UNSEEN,
        "versions": versions,
        "tags": [SHORT + UNSEEN],
    }
    granted = exchanges.grant(
        engine, models=["ishigami"], max_instances=10_000, now=now - 50.0, ttl=3600.0, **worker
    )
    assert granted is not None
    reports = []
    for row, position in granted.lease.instances:
        point = parameters(study.plan, row)[position]
        said = MARKUP + UNSEEN
        bad = point["x1"] > 2.0 and point["x2"] > 1.0
        reports.append(
            Report(
                instance=instance_id(study.id, row, position),
                outcome="diverged" if bad else "ok",
                outputs=None if bad else {"y": point["x1"] + point["x2"] ** 2},
                reason=said if bad else "",
                state={"traceback": MARKUP + UNSEEN, "warnings": [MARKUP + UNSEEN]}
                if bad
                else None,
                wall_seconds=0.1,
            )
        )
    exchanges.hand_in(engine, granted.lease, reports, now=now - 5.0)
    catch_up(StoreResultLog(engine), study.id)
    other = _of_a_model(engine, now)
    return House(study=study.id, other=other, loop=_loop(engine, now), model="markup")


def _of_a_model(engine: Engine, now: float) -> str:
    """Announce a model whose units and sentences are markup, and begin a study of it."""
    said = {
        "name": "markup",
        "description": MARKUP,
        "kind": "command",
        "factors": [
            {
                "name": n,
                "unit": SHORT,
                "low": 0.0,
                "high": 1.0,
                "nominal": 0.5,
                "description": MARKUP,
            }
            for n in ("a", "b")
        ],
        "outputs": [{"name": "y", "unit": SHORT}],
    }
    model = models.announce(engine, Description.from_json(said), by=MARKUP, now=now)
    waiting = draw_up(
        name=SHORT,
        model=model.description,
        called=model.called,
        method="morris",
        sampling="sobol",
        rows=4,
        seed=1,
        factors=None,
        fixed={},
        outputs=None,
    )
    study, _ = studies.create(engine, waiting, key=None, digest="", now=now)
    return study.id


def _loop(engine: Engine, now: float) -> str:
    content = {"model": MARKUP, "analysed_joints": [MARKUP], "trials": [{}]}
    session, _ = sessions.create(
        engine,
        io.BytesIO(b"PK"),
        name=MARKUP[:50] + UNSEEN,
        sha256="0" * 64,
        size=2,
        content=content,
        now=now,
    )
    job, _ = close_loops.create(engine, session.id, code="0" * 16, now=now)
    worker = Introduction(id="loops", host=SHORT, versions={})
    taken = close_loops.grant(engine, worker, now=now, ttl=60.0)
    assert taken is not None
    attempt = taken[0].attempts[-1]
    contents = dict.fromkeys(REPORT_FILES, b"x") | {
        "report.json": json.dumps(_REPORT).encode(),
        "report.html": _REPORT_HTML.encode(),
    }
    proof = Proof(lease=attempt.lease, fence=attempt.fence, worker="loops")
    files = {name: io.BytesIO(text) for name, text in contents.items()}
    close_loops.hand_in(engine, job.id, files, proof=proof, code="0" * 16, verdict=SHORT, now=now)
    return job.id
