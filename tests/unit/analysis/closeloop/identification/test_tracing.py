"""What nothing stands of is looked for once more, without what fell."""

from collections.abc import Callable, Collection, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from analysis.closeloop.contract import Verdict
from analysis.closeloop.identification import tracing
from analysis.closeloop.identification.balance.model import Model, evaluate
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from analysis.closeloop.identification.balance.terms import Candidate
from analysis.closeloop.identification.explainable import explainable
from analysis.closeloop.identification.findings import Grown, Option, Step, Trace
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME, LINK_INERTIA
from tests.testbed.sessions.rich import ELBOW

FALLS, STANDS = "time_delay", "stretch_reflex"


@pytest.fixture
def rows(recording: Recording) -> Rows:
    return select_rows(recording, (0,))


def grown(recording: Recording, rows: Rows, names: Sequence[str]) -> Grown:
    """Return a bare model that effects are said to have been added to."""
    model = Model(recording)
    score = evaluate(model, rows)
    steps = []
    for name in names:
        candidate = Candidate(effect=BY_NAME[name], joint=ELBOW)
        taken = Option(candidate=candidate, model=model, score=score, gain=1.0, z=9.0)
        steps.append(Step(taken=taken, equals=(), options=(), before=score.loss))
    return Grown(model, score, tuple(steps))


@pytest.mark.parametrize("first", [[FALLS], [FALLS, STANDS]], ids=["nothing", "something"])
def test_only_where_nothing_stands_is_all_grown_again_without_what_fell(
    first: list[str], recording: Recording, rows: Rows, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An end of range stood for a cuff's spring beside it, and fell: K was 12 % low."""
    asked: list[set[tuple[str, int]]] = []

    def grow(_b: Grown, _r: Rows, _s: Any, _p: Any, tried: Collection[Candidate]) -> Any:
        asked.append({candidate.key for candidate in tried})
        return grown(recording, rows, [STANDS]), None

    def held(found: Grown, _declared: Model, _rows: Rows) -> tuple[Grown, tuple[str, ...]]:
        left = tuple(step for step in found.steps if step.key[0] != FALLS)
        return Grown(found.model, found.score, left), tuple(
            "gone" for _ in found.steps[len(left) :]
        )

    monkeypatch.setattr(tracing, "grow", grow)
    monkeypatch.setattr(tracing, "_held", held)
    before = grown(recording, rows, first)
    found, notes = tracing._stands(before, before.model, rows, lambda _: None)
    assert [step.key for step in found.steps] == [(STANDS, ELBOW)]
    assert notes == ("gone",)
    assert len(asked) == (first == [FALLS])
    for tried in asked:
        assert (FALLS, ELBOW) not in tried and (STANDS, ELBOW) in tried
    assert np.isfinite(found.score.loss)


@pytest.mark.parametrize("fails", [None, "not_worse", "determined"])
def test_a_name_has_to_stand_with_the_rests_fitted_too(
    recording: Recording, rows: Rows, monkeypatch: pytest.MonkeyPatch, fails: str | None
) -> None:
    """A sensor whose zero was set anew before each trial had relaxing tissue, and K below none.

    A robot's wrong zero was -0.5 rad, with an interval from -1.7 to 0.7 once its rests were fitted.
    """
    begun = grown(recording, rows, [STANDS])
    beyond = explainable(begun.model, rows)
    found = Trace(
        rows=rows,
        declared=begun.model,
        declared_score=begun.score,
        model=begun.model,
        score=begun.score,
        steps=begun.steps,
        verdict=Verdict.EFFECT_FOUND,
        explainable_before=beyond,
        explainable_after=beyond,
    )

    def judge(name: str) -> Callable[..., tuple[Grown, tuple[str, ...]]]:
        fallen = Grown(begun.model, begun.score), (f"{name} says so",)
        return lambda given, *_: fallen if name == fails else (given, ())

    for name in ("not_worse", "determined"):
        monkeypatch.setattr(tracing, name, judge(name))
    again = tracing._with_rests(found)
    assert again.verdict == (Verdict.UNEXPLAINED if fails else Verdict.EFFECT_FOUND)
    assert again.steps == (() if fails else begun.steps)
    assert again.notes == ((f"fitted to the rests, too, {fails} says so",) if fails else ())


@pytest.mark.parametrize("stand", [True, False])
def test_what_was_found_beside_links_that_fall_is_looked_for_without_them(
    stand: bool, recording: Recording, rows: Rows, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of an iiwa a gain, a coupling and a ripple stayed beside links that no trial held up."""
    for name in ("with_settled_excess", "in_plainest_form", "with_told_places", "with_tilt"):
        monkeypatch.setattr(tracing, name, lambda found, *_: found)
    for name in ("with_breakaway", "held_in_octaves", "determined", "sized"):
        monkeypatch.setattr(tracing, name, lambda found, *_, **__: (found, ()))
    monkeypatch.setattr(tracing, "with_peak_at_turns", lambda found, own, _: (found, own, ()))
    monkeypatch.setattr(tracing, "weighed", lambda _declared, own: own)

    bare = grown(recording, rows, [])

    def traced(_d: Model, _r: Rows, _p: Any, *, links_free: bool) -> Grown:
        names = [LINK_INERTIA, "cross_joint_coupling"] * links_free
        steps: Any = tuple(SimpleNamespace(key=(name, ELBOW)) for name in names)
        return Grown(bare.model, bare.score, steps)

    def not_worse(found: Grown, *_: Any) -> tuple[Grown, tuple[str, ...]]:
        left = tuple(step for step in found.steps if stand or step.key[0] != LINK_INERTIA)
        return Grown(found.model, found.score, left), ()

    monkeypatch.setattr(tracing, "traced_robot", traced)
    monkeypatch.setattr(tracing, "not_worse", not_worse)
    found, _, _ = tracing._robot_grown(Model(recording), rows, lambda _: None)
    names = [step.key[0] for step in found.steps]
    assert names == ([LINK_INERTIA, "cross_joint_coupling"] if stand else [])
