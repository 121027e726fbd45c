"""A coordinator and a model of it, side by side."""

import csv
from itertools import count
from typing import Any

import sqlalchemy as sa
from fastapi.testclient import TestClient
from hypothesis.stateful import RuleBasedStateMachine, invariant
from pydantic import SecretStr

from server.app import create_app
from server.operations import check
from server.operations.fleet import results
from server.operations.study import studies
from server.records import Study
from server.settings import Settings
from server.store import create_engine
from server.store.database.engine import writing
from server.store.database.schema import metadata
from tests.testbed.clock import Clock
from tests.testbed.protocol.faults import Faults
from tests.testbed.protocol.model import Protocol
from tests.testbed.protocol.records import BUDGETS, Done

TOKEN = "protocol"
#: So long that the coordinator's own reaper, which lives in real time, never comes.
TTL = 3600.0
#: Two kinds of machines, the first with two hosts.
HOSTS = {"a": "Linux", "b": "Linux", "c": "Darwin"}


class Beside(RuleBasedStateMachine):
    """A coordinator and a model of it, and whether they agree; what they are told is a story's."""

    def __init__(self, url: str) -> None:
        super().__init__()
        engine = create_engine(url)
        with writing(engine) as connection:
            for table in reversed(metadata.sorted_tables):
                connection.execute(sa.delete(table))
        engine.dispose()
        self.url = url
        self.faults = Faults()
        self.model = Protocol(HOSTS, TTL)
        self.keys: dict[str, str] = {}
        self.names = count()
        #: Whether the database has failed in a request, and whether one is asked once more.
        self.unanswered = self.again = False
        self.wall = Clock()
        self._start()

    def _start(self) -> None:
        self.app = create_app(
            Settings(
                database_url=self.url,
                token=SecretStr(TOKEN),
                lease_seconds=TTL,
                recompute_share=0.3,
            )
        )
        self.app.state.clock = self.wall
        self.faults.watch(self.app.state.engine)
        self.client = TestClient(
            self.app,
            headers={"Authorization": f"Bearer {TOKEN}"},
            raise_server_exceptions=False,
        )
        self.client.__enter__()

    @property
    def now(self) -> float:
        return float(self.app.state.clock())

    def _ask(self, method: str, path: str, body: Any = None, **more: Any) -> Any:
        """Return an answer; None if the database failed."""
        answer = self.client.request(method, f"/v1{path}", json=body, **more)
        if answer.status_code >= 500:
            assert self.faults.struck, f"{method} {path}: {answer.text}"
            assert answer.headers["content-type"] == "application/problem+json"
            self.unanswered = True
            return None
        return answer

    # What must be true at every moment.

    def _stored(self, study: Study) -> Done:
        return {
            (one.row, one.position): (one.outcome, one.outputs["y"] if one.outputs else None)
            for one, _ in results.in_order(self.app.state.engine, study)
        }

    def _settle(self) -> None:
        """Tell the model which instances the coordinator gave up, where it may choose."""
        self.faults.disarm()
        if not any(study.may_be_given_up() for study in self.model.studies.values()):
            return
        for study in studies.every(self.app.state.engine):
            known = self.model.studies[study.id].done()
            for at, (outcome, _) in self._stored(study).items():
                if at not in known and outcome in BUDGETS:
                    self.model.given_up(study.id, at, outcome)

    @invariant()
    def is_as_the_model_says(self) -> None:
        engine = self.app.state.engine
        stored = {study.id: study for study in studies.every(engine)}
        assert [*stored] == [*self.model.studies]
        for study in self.model.studies.values():
            assert self._stored(stored[study.id]) == study.done()
            progress = self._ask("GET", f"/studies/{study.id}/progress").json()
            due = study.progress()
            assert {name: progress[name] for name in due} == due
        assert check.faults(engine) == []

    def _is_told(self) -> None:
        """Look at what those are given who download results and instances."""
        for study in self.model.studies.values():
            table = self._ask("GET", f"/studies/{study.id}/results.csv").text.splitlines()
            told = {
                (int(line["row"]), int(line["position"])): (
                    line["outcome"],
                    float(line["y"]) if line["y"] else None,
                )
                for line in csv.DictReader(table)
            }
            assert told == study.done()
            listed = self._ask("GET", f"/studies/{study.id}/instances").json()["instances"]
            assert {(one["row"], one["position"]) for one in listed} == study.slots.keys()
