"""Two effects at a joint: both are named, and nothing that only corrects the first."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from analysis.closeloop.identification.balance import luck
from analysis.closeloop.identification.balance.model import Model, evaluate
from analysis.closeloop.identification.balance.regression import Rows, compare
from analysis.closeloop.identification.balance.terms import Candidate
from analysis.closeloop.identification.candidates import options_beside
from analysis.closeloop.identification.findings import Grown, Option, Step
from analysis.closeloop.identification.forms import only_form
from analysis.closeloop.identification.growing import steps
from analysis.closeloop.identification.growing.freed import freed, held
from analysis.closeloop.identification.growing.steps import _retested, grow
from analysis.closeloop.identification.selection import choose
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.rich import ELBOW, rich_elbow
from tests.testbed.sessions.rich_rows import candidate, rows_with, term, torque


@pytest.fixture(scope="module")
def elbow() -> Recording:
    return rich_elbow(14)


def names(rows: Rows, *tried: str) -> list[str]:
    model = Model(rows.recording)
    score = evaluate(model, rows)
    wanted = [candidate(name) for name in tried]
    grown, _ = grow(Grown(model, score), rows, score, lambda _: None, wanted)
    return sorted(step.key[0] for step in grown.steps)


def test_a_load_moves_to_its_place_when_the_other_effect_is_found(elbow: Recording) -> None:
    """Alone it hangs where it does some of what the spring does, and inertia seems to lack."""
    load = torque(elbow, "payload", {"distance": 1.6}, 0.4)
    spring = torque(elbow, "nonlinear_stiffness", {"centre": 1.0}, 20.0)
    rows = rows_with(elbow, load + spring)
    found = names(rows, "added_inertia", "payload", "nonlinear_stiffness")
    assert found == ["nonlinear_stiffness", "payload"]


def test_a_load_beside_the_line_to_its_link_s_centre_is_one_effect(elbow: Recording) -> None:
    """It was called gravity along another way and a gain, and K was 11 % off beside them."""
    load = torque(elbow, "payload", {"distance": 1.6, "aside": 0.5}, 0.4)
    rows = rows_with(elbow, load)
    assert names(rows, "gravity_torque", "torque_gain", "added_inertia", "payload") == ["payload"]


def test_friction_of_a_form_that_a_load_lacked_takes_another_beside_it(elbow: Recording) -> None:
    """It was dropped, since the load may have another, and none came: a stranger's limb with both
    was unexplained.
    """
    names_of = ("hysteresis", "payload")
    rubs = torque(elbow, "coulomb_friction", {"smooth": 0.004}, 0.5)
    rows = rows_with(elbow, rubs + torque(elbow, "payload", {"distance": 1.6}, 0.4))
    before = evaluate(Model(rows.recording), rows)
    thetas = {"hysteresis": {"distance": 0.004, "exponent": 1.0}, "payload": {"distance": 1.6}}
    model = Model(rows.recording, terms=tuple(term(rows, name, thetas[name]) for name in names_of))
    score = evaluate(model, rows)
    found = []
    for name in names_of:
        gain, error = compare(before.losses, score.losses)
        own = candidate(name)
        taken = Option(candidate=own, model=model, score=score, gain=gain, z=gain / error)
        found.append(Step(taken=taken, equals=(), options=(taken,), before=before.loss))
    tried = [candidate(name) for name in (*names_of, "coulomb_friction")]
    again = _retested(Grown(model, score, tuple(found)), rows, before, tried, set())
    assert {step.key[0] for step in again.steps} == {"coulomb_friction", "payload"}


def test_what_is_free_while_another_is_tried_is_held_again(elbow: Recording) -> None:
    load = torque(elbow, "payload", {"distance": 1.6}, 0.4)
    rows = rows_with(elbow, load)
    model = Model(rows.recording, terms=(term(rows, "payload", {"distance": 1.2}),))
    score = evaluate(model, rows)
    loose = freed(model, score.coefficients, rows)
    # Mass and place are all that such a load has: the slope over its place makes up for it.
    assert evaluate(loose, rows).sse < 0.05 * score.sse
    assert held(loose, model) == model


def test_a_small_second_effect_has_to_be_more_than_the_form_of_the_first(
    elbow: Recording,
) -> None:
    """The true spring is a little other than the cubic; a ripple would correct it."""
    angle = elbow.position[:, ELBOW]
    spring = 40.0 * (angle - 1.0) ** 3
    bent = spring * (1.0 + 0.1 * angle)
    late = elbow.shifted(spring[:, None], 0.01)[:, 0]
    for effort, name, wanted in ((bent, "torque_ripple", True), (late, "viscous_friction", False)):
        rows = rows_with(elbow, effort)
        model = Model(rows.recording, terms=(term(rows, "nonlinear_stiffness", {"centre": 1.0}),))
        theta = {"order": 6.0} if name == "torque_ripple" else {}
        beside = model.with_term(term(rows, name, theta))
        assert evaluate(beside, rows).loss < evaluate(model, rows).loss
        assert only_form(candidate(name), beside, model, rows) is wanted


def test_no_effect_is_added_that_needs_another_to_be_what_it_cannot_be(
    elbow: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As an inertia beside which a spring would have another resonance than the one it rings at."""
    load = torque(elbow, "payload", {"distance": 1.6}, 0.4)
    rows = rows_with(elbow, load + torque(elbow, "nonlinear_stiffness", {"centre": 1.0}, 20.0))

    def bent(model: Model, _: Any, one: Any) -> str:
        return "resonance" if len(model.effects) > 1 and one.effect.name == "payload" else ""

    assert len(names(rows, "payload", "nonlinear_stiffness")) == 2
    monkeypatch.setattr(steps, "beyond_physics", bent)
    assert names(rows, "payload", "nonlinear_stiffness") == ["nonlinear_stiffness"]


def test_what_its_own_law_tells_twice_is_kept_though_it_fills_few_seconds(
    elbow: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Play went again that was taken by when it comes, and left half of the loss there was."""
    load = torque(elbow, "payload", {"distance": 1.6}, 0.4)
    rows = rows_with(elbow, load + torque(elbow, "nonlinear_stiffness", {"centre": 1.0}, 20.0))
    monkeypatch.setattr(steps, "more_than_luck", lambda *_: False)
    assert len(names(rows, "payload", "nonlinear_stiffness")) == 1
    monkeypatch.setattr(steps, "told_twice", lambda *_: True)
    assert len(names(rows, "payload", "nonlinear_stiffness")) == 2


def test_no_effect_is_added_that_only_its_slopes_make_room_for(
    elbow: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To first order both do all; here no values of their parameters do what the slopes say."""
    load = torque(elbow, "payload", {"distance": 1.6}, 0.4)
    rows = rows_with(elbow, load + torque(elbow, "nonlinear_stiffness", {"centre": 1.0}, 20.0))
    assert len(names(rows, "payload", "nonlinear_stiffness")) == 2

    def astray(model: Model, rows: Rows, last: Candidate) -> tuple[Model, Any]:
        backwards = tuple(
            t if t.candidate == last else replace(t, columns={ELBOW: t.columns[ELBOW][::-1]})
            for t in model.terms
        )
        return replace(model, terms=backwards), None

    monkeypatch.setattr(steps, "settled_beside", astray)
    assert names(rows, "payload", "nonlinear_stiffness") == ["nonlinear_stiffness"]


@pytest.mark.parametrize("matters", [True, False])
def test_two_effects_that_hide_each_other_are_found_together(
    elbow: Recording, monkeypatch: pytest.MonkeyPatch, *, matters: bool
) -> None:
    """Neither alone is more than luck; both together take everything, if that is anything."""
    rows = rows_with(elbow, torque(elbow, "added_inertia", {}, 0.1) + 0.5 * elbow.velocity[:, 1])
    real = steps.choose

    def shy(options: Any, model: Model, *rest: Any, **more: Any) -> Any:
        return real(options, model, *rest, **more) if model.effects else None

    monkeypatch.setattr(steps, "choose", shy)
    if not matters:
        monkeypatch.setattr(luck, "MIN_TORQUE", 2.0)
        monkeypatch.setattr(luck, "takes_much", lambda *_: False)
    both = ["added_inertia", "viscous_friction"]
    assert names(rows, *both, "drift") == (both if matters else [])


def test_a_second_effect_is_asked_for_again_settled_beside_the_first(
    elbow: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To first order it may not be more than luck; chosen together with the first, it is."""
    rows = rows_with(elbow, torque(elbow, "added_inertia", {}, 0.1) + 0.5 * elbow.velocity[:, 1])
    real, asked = steps.choose, []

    def late(options: Any, model: Model, *rest: Any, **more: Any) -> Any:
        asked.append(len(model.effects))
        first_order = bool(model.effects) and asked.count(1) == 1
        return None if first_order else real(options, model, *rest, **more)

    monkeypatch.setattr(steps, "choose", late)
    assert names(rows, "added_inertia", "viscous_friction") == ["added_inertia", "viscous_friction"]


def test_a_spring_that_yields_is_not_asked_for_beside_one_that_hardens(elbow: Recording) -> None:
    """With both of them a stranger's two ends of range had K = -9 (-99 to 81)."""
    sizes = {
        "nonlinear_stiffness": {"centre": 1.0},
        "softening_stiffness": {"centre": 1.0, "width": 0.2, "power": 0.0},
    }
    both = sum(torque(elbow, name, theta, 10.0) for name, theta in sizes.items())
    rows = rows_with(elbow, both)
    asked = [candidate(name) for name in sizes]

    def offered(model: Model) -> set[str]:
        options = options_beside(model, rows, evaluate(model, rows), asked)
        return {option.candidate.effect.name for option in options}

    bare = Model(rows.recording)
    assert offered(bare) == set(sizes)
    for name, theta in sizes.items():
        assert not offered(bare.with_term(term(rows, name, theta)))


def test_friction_found_later_may_explain_what_was_found_before(
    elbow: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = rows_with(elbow, torque(elbow, "added_inertia", {}, 0.1) + 0.5 * elbow.velocity[:, 1])
    tried = ("added_inertia", "viscous_friction")
    assert names(rows, *tried) == [*tried]
    monkeypatch.setattr(
        steps, "only_presliding", lambda own, *rest: own.effect.name == "added_inertia"
    )
    assert names(rows, *tried) == ["viscous_friction"]


def test_one_direction_s_friction_is_symmetric_where_the_difference_is_not_determined(
    elbow: Recording,
) -> None:
    """The best difference would make friction drive in one direction, which none does."""
    sign = np.tanh(elbow.velocity[:, ELBOW] / (0.06 * elbow.top_speed[ELBOW]))
    speed = np.abs(elbow.velocity[:, ELBOW])
    rows = rows_with(elbow, 0.4 * sign + 0.45 * np.abs(sign) + 0.3 * speed)
    offset = replace(term(rows, "torque_offset", {}), candidate=None)
    model = Model(rows.recording, terms=(offset,))
    score = evaluate(model, rows)
    (option,) = options_beside(model, rows, score, [candidate("asymmetric_friction")])
    assert option.model.terms[1].kept == (0, 2, 3)


@pytest.mark.parametrize(("mean", "offered"), [(0.9, True), (0.0, False)])
def test_friction_is_offered_though_a_limb_takes_in_the_damping_that_it_dissipates_by(
    elbow: Recording, mean: float, offered: bool
) -> None:
    """What is left of it drives one way; where the limb has no damping, the friction would."""
    velocity = elbow.velocity[:, ELBOW]
    sign = np.tanh(velocity / (0.02 * elbow.top_speed[ELBOW]))
    rows = rows_with(elbow, 0.2 * sign - 0.8 * np.abs(velocity) + mean * velocity)
    limb = replace(term(rows, "viscoelastic_joint", {}), candidate=None)
    model = Model(rows.recording, terms=(limb,))
    score = evaluate(model, rows)
    options = options_beside(model, rows, score, [candidate("asymmetric_friction")])
    assert [option.gain > 0.95 * score.loss for option in options] == [True] * offered


@pytest.mark.parametrize("there", [("coulomb_friction",), ("coulomb_friction", "viscous_friction")])
def test_friction_and_damping_of_each_direction_s_own_are_one_effect(
    elbow: Recording, there: tuple[str, ...]
) -> None:
    """Damping that was not found yet, or stands already, is the mean of both directions'."""
    velocity = elbow.velocity[:, ELBOW]
    sign = np.tanh(velocity / (0.02 * elbow.top_speed[ELBOW]))
    damping = 0.3 * velocity + 0.2 * np.abs(velocity)
    rows = rows_with(elbow, 0.4 * sign + 0.1 * np.abs(sign) + damping)
    model = Model(rows.recording, terms=tuple(term(rows, name, {"smooth": 0.02}) for name in there))
    score = evaluate(model, rows)
    (option,) = options_beside(model, rows, score, [candidate("asymmetric_friction")])
    assert option.replaced == {(name, ELBOW) for name in there}
    assert option.gain > 0.95 * score.loss


def taken_of_alike(fits: dict[str, float], unlikely: str = "") -> str:
    """Return which of two names is taken that predict alike, and leave so much where they fit.

    Args:
        fits: sums of squares by name.
        unlikely: which says what whoever set the joint up would have seen.
    """
    losses = np.linspace(0.9, 1.1, 40)
    options: Any = [
        SimpleNamespace(
            candidate=Candidate(effect=BY_NAME[name], joint=0),
            model=None,
            score=SimpleNamespace(losses=losses, sse=sse),
            gain=1000.0,
            refused="",
            replaced=frozenset(),
        )
        for name, sse in fits.items()
    ]
    current: Any = SimpleNamespace(losses=26 * losses, loss=26 * losses.sum())
    rows: Any = SimpleNamespace(
        effort_power=lambda joint: 1.0,
        smoothing_power=lambda joint: 1.0,
        joints=(0,),
        joint_of_block=np.zeros(40, dtype=int),
        fold_of_block=np.arange(40) % 4,
    )
    model: Any = None
    room = "analysis.closeloop.identification.selection"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(f"{room}.only_presliding", lambda *_: False)
        patch.setattr(f"{room}.carries_more", lambda *_: False)
        patch.setattr(f"{room}._unlikely", lambda o: o.candidate.effect.name == unlikely)
        step = choose(options, model, current, rows, 1.0, 0.0)
    assert step is not None
    return step.taken.candidate.effect.name


def test_of_forms_that_predict_alike_the_one_that_fits_is_taken() -> None:
    """The curve has to extrapolate to a group that goes further; it fits twice as well."""
    load, position = "load_dependent_friction", "position_dependent_friction"
    assert taken_of_alike({load: 80.0, position: 40.0}) == position
    assert taken_of_alike({load: 80.0, position: 78.0}) == load


def test_of_names_that_predict_alike_an_unlikely_one_comes_last_though_it_fits() -> None:
    fits = {"gravity_torque": 40.0, "nonlinear_stiffness": 80.0}
    assert taken_of_alike(fits) == "gravity_torque"
    assert taken_of_alike(fits, unlikely="gravity_torque") == "nonlinear_stiffness"


def test_of_effects_that_fit_alike_the_one_is_taken_beside_which_all_fits_best(
    elbow: Recording,
) -> None:
    """Friction was settled without a load that is missing: a gain of the torque fitted as well."""
    friction = torque(elbow, "coulomb_friction", {"smooth": 0.02}, 2.0)
    rows = rows_with(elbow, friction + torque(elbow, "payload", {"distance": 1.6}, 0.4))
    model = Model(rows.recording, terms=(term(rows, "coulomb_friction", {"smooth": 0.4}),))
    score = evaluate(model, rows)
    options = options_beside(model, rows, score, [candidate("payload"), candidate("torque_gain")])
    load, gain = sorted(options, key=lambda option: option.candidate.key)
    alike = Step(taken=gain, equals=(load,), options=tuple(options), before=score.loss)
    step = steps._settled(alike, model, score, rows, 0.0, 0.0)
    assert step.key[0] == "payload"
    turning = next(t.theta for t in step.taken.model.terms if t.candidate is None or t.rubs)
    assert turning["smooth"] < 0.1
