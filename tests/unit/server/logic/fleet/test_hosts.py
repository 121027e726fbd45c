"""Which machines may work on one study, and which on one row of it."""

from collections.abc import Callable, Mapping
from typing import Any

import pytest

from server.logic.fleet.hosts import classes, host_class, identity, objection_to_worker
from server.records import Introduction, Plan, Study
from server.states import StudyState

VERSIONS = {
    "code": "c1",
    "mujoco": "4.0.1",
    "numpy": "2.3",
    "platform": "linux",
    "cpu": "x",
    "canary": "9f",
    "python": "3.11",
}


def begun(plan: Callable[..., Plan], **changes: Any) -> Study:
    return Study(id="s", plan=plan(), state=StudyState.RUNNING, created_at=0.0, **changes)


def asks(versions: Mapping[str, str] = VERSIONS, *tags: str) -> Introduction:
    return Introduction(id="w", host="h", versions=versions, tags=tags)


def test_a_study_is_bound_to_the_code_and_mujoco_and_to_nothing_else() -> None:
    assert identity(VERSIONS) == {"code": "c1", "mujoco": "4.0.1"}
    assert identity({"code": "c1", "python": "3.11"}) == {"code": "c1"}


@pytest.mark.parametrize("name", ["code", "mujoco", "numpy", "platform", "cpu", "canary"])
def test_machines_that_may_compute_other_bits_are_of_another_class(name: str) -> None:
    assert host_class({**VERSIONS, name: "other"}) != host_class(VERSIONS)
    assert host_class({key: VERSIONS[key] for key in VERSIONS if key != name}) != host_class(
        VERSIONS
    )


def test_what_does_not_change_bits_does_not_change_the_class() -> None:
    named = host_class(VERSIONS)
    assert named == host_class({**dict(reversed(VERSIONS.items())), "python": "3.12"})
    assert len(named) == 16 and int(named, 16) >= 0


def test_the_name_of_a_class_stays_as_it_is_stored() -> None:
    assert host_class({"code": "c1", "mujoco": "4.0.1"}) == "4d7fe71bd70d6144"


def test_any_worker_may_begin_a_study(plan: Callable[..., Plan]) -> None:
    assert objection_to_worker(begun(plan), asks()) is None
    assert objection_to_worker(begun(plan, identity=identity(VERSIONS)), asks()) is None


def test_other_code_may_not_go_on_with_it_and_is_told_what_to_do(
    plan: Callable[..., Plan],
) -> None:
    study = begun(plan, identity={"code": "c0", "mujoco": "4.0.1"}, leased=1)
    assert objection_to_worker(study, asks({"code": "c1"})) == (
        "study s was begun with code c0, mujoco 4.0.1, but this worker has code c1, mujoco "
        "unknown: install the same rehyb and MuJoCo here, or begin the study anew with "
        "`rehyb study rerun s --which all`"
    )


def test_a_study_with_tags_is_for_workers_that_have_them_all(plan: Callable[..., Plan]) -> None:
    study = begun(plan, tags=("big", "quiet", "lab"))
    assert objection_to_worker(study, asks(VERSIONS, "big", "lab", "quiet", "other")) is None
    assert objection_to_worker(study, asks(VERSIONS, "quiet")) == (
        "study s is for workers tagged big, lab (rehyb-worker --tags)"
    )


def test_a_model_s_canary_is_part_of_the_class_and_a_worker_has_one_for_each_of_its_models() -> (
    None
):
    bare, own = host_class(VERSIONS), host_class(VERSIONS, "7c")
    assert host_class({"code": "c1"}, "7c") == "f25b41151860b0ca"
    assert own != bare and host_class(VERSIONS, "7d") not in (own, bare)
    assert classes(VERSIONS, {"pendulum@1": "7c", "noisy@1": ""}) == {bare, own}
    assert classes(VERSIONS, {}) == {bare}
