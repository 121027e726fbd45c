"""Which models a worker asks work for, and how many."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from models.description import Kind
from models.running.place import Place
from models.running.places import Places
from rehyb.errors import Invalid, Unreachable
from server.routes.fleet.leases import WorkerBody
from sim.models import MODELS
from tests.unit.worker.test_canaries import MODEL
from worker.models.canaries import Canaries
from worker.models.offered import MOST_MODELS, MOST_REFUSED, MOST_SAID, OTHER_VERSION, WorkerModels

#: What says that it is not deterministic has its canary at once.
NAMED = [replace(MODEL, name=f"m{i}", deterministic=False) for i in range(MOST_MODELS)]


class Open:
    """A coordinator with open studies of more uploaded models than any worker may have."""

    def __init__(self) -> None:
        self.announced: list[str] = []
        self.away = 0

    def announce_model(self, description: dict[str, Any], worker: str) -> None:
        if self.away:
            self.away -= 1
            raise Unreachable("it is not there yet")
        self.announced.append(f"{description['name']} of {worker}")

    def models(self, wanted: bool) -> list[dict[str, Any]]:
        return [
            replace(one, kind=Kind.MJCF).as_json() | {"digest": f"{i:064x}"}
            for i, one in enumerate(NAMED)
        ]


def offering(named: int) -> WorkerModels:
    places = Places(fetch=lambda version, path: None, cache=Path())
    for one in NAMED[:named]:
        places.descriptions[one.version] = one
        places.places[one.version] = Place(kind=Kind.COMMAND, digest=one.digest, where="here")
    canaries = Canaries(pool=None)  # type: ignore[arg-type]
    there: Any = Open()
    own = [model.version for model in MODELS.values()]
    return WorkerModels(client=there, worker="w", places=places, canaries=canaries, own=own)


def test_more_models_than_a_coordinator_takes_of_a_worker_are_refused_before_any_is_asked_for() -> (
    None
):
    most = MOST_MODELS - 2 * len(MODELS)
    with pytest.raises(Invalid) as refused:
        offering(most + 1)
    assert str(refused.value) == (
        f"--models and --allow name {most + 1} models, and one worker takes {most} beside rehyb's "
        "own: start another worker for the rest"
    )
    assert len(offering(most).offered(0.0)) == MOST_MODELS


def test_rehybs_own_models_are_told_of_by_name_and_by_version() -> None:
    offered = offering(0).offered(0.0)
    assert all(one.name in offered and one.version in offered for one in MODELS.values())


def test_open_studies_models_fill_what_the_owners_leave_and_no_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Places, "place", lambda self, version: None)
    monkeypatch.setattr(
        "worker.models.offered.description_of", lambda model: NAMED[int(model["name"][1:])]
    )
    offered = offering(30).offered(0.0)
    assert len(offered) == MOST_MODELS


def test_a_coordinator_is_told_of_models_whose_code_is_here_before_work_and_until_it_has_heard(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Open, "models", lambda self, wanted: [])
    offering_one = offering(1)
    there: Any = offering_one.client
    there.away = 1
    with pytest.raises(Unreachable):
        offering_one.offered(0.0)
    for now in (1.0, 2.0):
        assert NAMED[0].version in offering_one.offered(now)
    assert there.announced == [f"{NAMED[0].name} of w"]


def test_a_worker_says_once_of_which_open_studies_it_takes_nothing_and_why(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", logger="worker.models")
    digests = iter("abcdefgh")
    wanted = [
        replace(NAMED[0], kind=Kind.COMMAND).as_json() | {"digest": NAMED[0].digest},
        *(
            replace(NAMED[number], kind=kind).as_json() | {"digest": next(digests)}
            for number, kind in ((0, Kind.COMMAND), (1, Kind.PYTHON), (2, Kind.UMBRIDGE))
        ),
    ]
    monkeypatch.setattr(Open, "models", lambda self, wanted_ones=True, **_: wanted)
    worker = offering(1)
    for now in (0.0, 10.0):
        worker.offered(now)
    not_here = "its code is not here; whoever has it names it with"
    assert caplog.messages == [
        f"does not take m0@a: {OTHER_VERSION}",
        f"takes nothing of studies of m1@b: {not_here} --allow NAME",
        f"takes nothing of studies of m2@c: {not_here} --models DIR --umbridge URL",
    ]
    assert worker.refused() == {"m0@a": OTHER_VERSION}


def test_the_reason_of_a_refusal_is_told_as_one_short_line() -> None:
    worker = offering(0)
    for number in range(MOST_MODELS + 5):
        worker.canaries.refuse(f"m{number}@a", "no\x1b[31m such\nfile" * 100)
    told = worker.refused()
    assert {len(why) for why in told.values()} == {MOST_SAID}
    assert all(why.isprintable() for why in told.values())


def test_models_are_taken_again_whose_server_answers_which_is_asked_once_for_all_of_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    offered = offering(3)
    asked: list[str] = []

    def answers(url: str) -> bool:
        asked.append(url)
        return url == "http://back"

    monkeypatch.setattr("models.umbridge.client.answers", answers)
    places, canaries = offered.places.places, offered.canaries
    for one, url in zip(NAMED[:3], ("http://back", "http://back", "http://off"), strict=True):
        places[one.version] = replace(places[one.version], url=url)
        canaries.lose(one.version, "refused")
    offered.offered(0.0)
    assert sorted(asked) == ["http://back", "http://off"]
    assert canaries.away == {NAMED[2].version}
    named = {one.version for one in NAMED[:3]}
    assert named & set(canaries.refused) == canaries.away


def test_of_many_refusals_those_are_told_for_which_studies_wait(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """And the latest: so many that a coordinator takes them."""
    wanted = replace(NAMED[0], kind=Kind.COMMAND).as_json() | {"digest": "a"}
    monkeypatch.setattr(Open, "models", lambda self, wanted_ones=True, **_: [wanted])
    worker = offering(1)
    worker.offered(0.0)
    for number in range(1, MOST_REFUSED + 5):
        worker.canaries.refuse(f"m{number}@a", "no")
    told = worker.refused()
    assert list(told) == [*(f"m{n}@a" for n in range(6, MOST_REFUSED + 5)), "m0@a"]
    body = {"id": "w", "host": "h", "refused": {**told, "m0@a": "x" * MOST_SAID}}
    assert WorkerBody(**body).refused["m0@a"] == "x" * MOST_SAID
    with pytest.raises(ValidationError):
        WorkerBody(**body | {"refused": told | {"m1@a": "no"}})
