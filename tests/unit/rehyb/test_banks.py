"""Which study a bank's recordings come from."""

from typing import Any

import pytest

from rehyb import banks
from sim import evaluation

BODY = {"name": "bank", "seed": 1, "method": "sample", "model": "m", "rows": 8}
MINE, OTHER = {"code": "a", "mujoco": "4"}, {"code": "b", "mujoco": "4"}


class Coordinator:
    """As much of a client as the search for a study sees."""

    def __init__(self, *begun_with: Any, **changed: Any) -> None:
        self.begun_with = begun_with
        self.changed = changed

    def studies(self) -> list[dict[str, Any]]:
        return [
            {**BODY, "state": "running", "id": str(i), **self.changed}
            for i in range(len(self.begun_with))
        ]

    def instance(self, study: str, row: int, position: int) -> dict[str, Any]:
        return {"identity": self.begun_with[int(study)]}

    def submit(self, body: dict[str, Any]) -> dict[str, Any]:
        return {**body, "id": "new"}

    def extend(self, study: str, rows: int) -> dict[str, Any]:
        return {"id": study, "rows": rows}


@pytest.fixture(autouse=True)
def mine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(evaluation, "identity", lambda: MINE)


def chosen(coordinator: Coordinator) -> Any:
    return banks._study(coordinator, BODY)  # type: ignore[arg-type]


def test_a_study_that_this_code_began_or_nobody_yet_goes_on() -> None:
    assert chosen(Coordinator(MINE))["id"] == "0"
    assert chosen(Coordinator(None))["id"] == "0"
    assert chosen(Coordinator(MINE, rows=4)) == {"id": "0", "rows": 8}


def test_a_study_that_other_code_began_is_left_alone_after_an_upgrade() -> None:
    assert chosen(Coordinator(OTHER))["id"] == "new"
    assert chosen(Coordinator(OTHER, MINE))["id"] == "1"


def test_a_cancelled_study_and_one_of_another_model_are_left_alone() -> None:
    assert chosen(Coordinator(MINE, state="cancelled"))["id"] == "new"
    assert chosen(Coordinator(MINE, model="other"))["id"] == "new"
