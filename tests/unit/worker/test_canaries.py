"""Canaries of models: points evaluated once, beside the work."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import pytest

from models.description import Description, Kind, Output
from models.factors import Factor
from models.running.place import Place
from models.running.pool import Finished
from worker.models.canaries import Canaries, points

MODEL = Description(
    name="m",
    description="",
    kind=Kind.COMMAND,
    factors=(Factor(name="x", unit="1", low=0.0, high=1.0, nominal=0.5, description=""),),
    results=(Output(name="y", unit="1"),),
    code="1",
)
PLACE = Place(kind=Kind.COMMAND, digest=MODEL.digest, where="here")


class InstantPool:
    """A pool whose evaluations are done when they are asked for."""

    def __init__(self, answer: Callable[[Mapping[str, Any]], Mapping[str, Any]]) -> None:
        self._answer = answer
        self._done: list[Finished] = []

    @property
    def running(self) -> int:
        return len(self._done)

    def start(self, instance: Mapping[str, Any], ticket: Any) -> None:
        self._done.append(Finished(ticket=ticket, result=dict(self._answer(instance))))

    def wait(self, seconds: float) -> list[Finished]:
        done, self._done = self._done, []
        return done


def canary_of(
    answer: Callable[[Mapping[str, Any]], Mapping[str, Any]], model: Description = MODEL
) -> tuple[str | None, Canaries]:
    canaries = Canaries(pool=InstantPool(answer))  # type: ignore[arg-type]
    found = None
    for _ in range(10):
        found = canaries.of(model, PLACE)
    return found, canaries


def ok(value: float) -> dict[str, Any]:
    return {"outcome": "ok", "outputs": {"y": value}, "reason": ""}


def test_it_is_the_same_where_the_bits_are_and_another_where_one_differs() -> None:
    one, _ = canary_of(lambda asked: ok(asked["parameters"]["x"]))
    same, _ = canary_of(lambda asked: ok(asked["parameters"]["x"]))
    other, _ = canary_of(lambda asked: ok(asked["parameters"]["x"] * (1 + 2e-16) + 1e-16))
    assert one and one == same != other
    assert points(MODEL)[1] == {"x": pytest.approx(0.381966)}


@pytest.mark.parametrize("of", ["seed", "time"])
def test_a_model_that_is_not_as_deterministic_as_it_says_is_refused(of: str) -> None:
    calls = iter(range(100))

    def answer(asked: Mapping[str, Any]) -> dict[str, Any]:
        return ok(float(asked["seed"] if of == "seed" else next(calls)))

    found, canaries = canary_of(answer)
    assert found is None
    assert "other numbers at the same point" in canaries.refused[MODEL.version]
    assert canary_of(answer, replace(MODEL, deterministic=False))[0] == ""


def test_one_that_cannot_be_loaded_is_refused_and_one_that_fails_is_not() -> None:
    bad = {"outcome": "bad_model", "outputs": {}, "reason": "no such file"}
    refused = canary_of(lambda _: bad)[1].refused
    assert refused == {MODEL.version: "it cannot be loaded here: no such file"}
    assert canary_of(lambda _: {**bad, "outcome": "diverged"})[0]


def test_one_whose_server_is_away_is_taken_again_when_it_answers() -> None:
    reached = False

    def answer(_: Mapping[str, Any]) -> dict[str, Any]:
        return ok(1.0) if reached else {"outcome": "(away)", "outputs": {}, "reason": "refused"}

    found, canaries = canary_of(answer)
    assert (found, canaries.refused, canaries.away) == (
        None,
        {MODEL.version: "refused"},
        {MODEL.version},
    )
    reached = True
    canaries.find_again(MODEL.version)
    for _ in range(10):
        found = canaries.of(MODEL, PLACE)
    assert found and not canaries.refused and not canaries.away


def test_one_that_hangs_is_not_tried_again_and_again_before_work_begins() -> None:
    asked: list[Any] = []
    hung = {"outcome": "timed_out", "outputs": {}, "reason": "still running"}

    def answer(instance: Mapping[str, Any]) -> dict[str, Any]:
        asked.append(instance)
        return hung

    assert canary_of(answer)[0]
    assert len(asked) == 1


def test_it_says_whether_a_canary_is_still_to_be_found() -> None:
    canaries = Canaries(pool=InstantPool(lambda _: ok(1.0)))  # type: ignore[arg-type]
    assert not canaries.look()
    canaries.of(MODEL, PLACE)
    looks = 0
    while canaries.look():
        looks += 1
    assert 1 <= looks < 10
    assert canaries.of(MODEL, PLACE)
