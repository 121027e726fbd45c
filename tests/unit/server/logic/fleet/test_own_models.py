"""Workers that lack a model of rehyb's own, or have another version of it."""

from collections.abc import Sequence
from typing import Any

import pytest

from server.logic.fleet.hosts import objection_to_worker
from server.logic.fleet.own_models import own_versions, worth_keeping
from server.records import Introduction, Study
from server.states import StudyState
from tests.testbed.coordinators.records import plan

NAMES, VERSIONS = (*own_versions(),), (*own_versions().values(),)
OLDER = tuple(name for name in NAMES if name != "elbow_passive")


def study(model: str, **changes: Any) -> Study:
    made = Study(id="s", plan=plan(), state=StudyState.RUNNING, created_at=0.0, **changes)
    made.plan.__dict__["model"] = model
    return made


def objection(model: str, named: Sequence[str], **changes: Any) -> str | None:
    models = dict.fromkeys(worth_keeping(tuple(named)), "")
    worker = Introduction(id="w", host="h", versions={"code": "a"}, models=models)
    return objection_to_worker(study(model, **changes), worker)


@pytest.mark.parametrize("named", [NAMES, (*NAMES, *VERSIONS), ()])
def test_of_a_worker_with_all_that_the_coordinator_has_or_that_says_nothing_nothing_is_kept(
    named: tuple[str, ...],
) -> None:
    assert worth_keeping((*named, "pendulum@1")) == ["pendulum@1"]
    assert objection("elbow_passive", named) is None


def test_a_worker_that_lacks_a_model_is_told_which_and_may_have_the_others() -> None:
    lacks = (
        "study s samples elbow_passive, which the rehyb of this worker lacks: install the same "
        "rehyb here as on the coordinator"
    )
    for versions in ((), VERSIONS[:4]):
        assert objection("elbow_passive", (*OLDER, *versions)) == lacks
    assert objection("elbow", OLDER) is None
    assert objection("pendulum@1", (*OLDER, "pendulum@1")) is None


def test_a_worker_whose_model_lacks_a_factor_begins_no_study_of_it_and_may_go_on_with_others() -> (
    None
):
    mine = own_versions() | {"elbow_effects": "elbow_effects@0000"}
    named = (*mine, *mine.values())
    said = str(objection("elbow_effects", named))
    assert "elbow_effects, which has other factors or outputs in the rehyb of this worker:" in said
    assert objection("elbow_effects", named, identity={"code": "a"}, leased=1) is None
    assert objection("elbow", named) is None
