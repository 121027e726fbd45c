"""A model that cannot be had here is one sentence, for whoever computes again and for a worker."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from models.running.places import NoModelError
from rehyb.again import Code, evaluating
from rehyb.errors import RehybError
from tests.testbed.fleet.fake_coordinator import Work


def none(version: str, _: Path) -> None:
    raise RehybError(f"there is no archive of {version}")


@pytest.mark.parametrize(
    ("code", "sentence"),
    [
        (Code(packages=("nope",)), "no package here announces the model 'nope'"),
        (Code(folders=(Path("/nowhere"),)), "there is no such file in /nowhere"),
    ],
)
def test_code_that_is_not_here_is_refused_before_anything_runs(code: Code, sentence: str) -> None:
    with pytest.raises(RehybError, match=sentence), evaluating(none, code):
        pytest.fail("nothing can be evaluated")


def test_a_model_that_cannot_be_fetched_says_so_where_it_is_asked_for() -> None:
    with (
        pytest.raises(RehybError, match="no archive of pendulum@0123"),
        evaluating(none, Code()) as evaluate,
    ):
        evaluate({"model": "pendulum@0123", "parameters": {}, "model_seed": 0})


def test_a_worker_reports_a_model_that_it_cannot_have_and_goes_on(tmp_path: Path) -> None:
    work = Work(tmp_path, [["a"], ["b"]], max_idle=None)
    agent = work.new_agent("w2", max_instances=2)

    def prepare(instance: Mapping[str, Any]) -> dict[str, Any]:
        found = dict(instance)
        if found["id"] == "a":
            raise NoModelError("pendulum arrived as another")
        return found

    agent.prepare = prepare
    agent.run()
    assert work.coordinator.results["a"]["outcome"] == "bad_model"
    assert work.coordinator.results["a"]["reason"] == "pendulum arrived as another"
    assert work.coordinator.results["b"]["outcome"] == "ok"
