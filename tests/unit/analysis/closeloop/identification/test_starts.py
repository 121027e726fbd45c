"""Effects that a search begins with: richer, simpler, damped, or the next best."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import Model, evaluate, unfitted
from analysis.closeloop.identification.candidates import options_beside
from analysis.closeloop.identification.findings import Grown, Option, Step
from analysis.closeloop.identification.growing import steps
from analysis.closeloop.identification.growing.starts import damped_starts, regrown, richer_starts
from analysis.closeloop.session.recording import Recording
from tests.testbed.sessions.rich import ELBOW, rich_elbow
from tests.testbed.sessions.rich_rows import candidate, rows_with, term, torque


@pytest.fixture(scope="module")
def elbow() -> Recording:
    return rich_elbow(14)


@pytest.mark.parametrize(("true", "damping"), [(0.02, 0.5), (0.15, 0.0)])
def test_damping_is_found_though_coulomb_friction_alone_would_turn_as_wide_as_to_do_its_work(
    elbow: Recording, monkeypatch: pytest.MonkeyPatch, true: float, damping: float
) -> None:
    """And none is found where friction does turn as wide."""
    rubs = torque(elbow, "coulomb_friction", {"smooth": true}, 0.4)
    rows = rows_with(elbow, rubs + damping * elbow.velocity[:, ELBOW])
    declared = Model(rows.recording)
    before = evaluate(declared, rows)
    wide = declared.with_term(term(rows, "coulomb_friction", {"smooth": 0.3 if damping else true}))
    score = evaluate(wide, rows)
    taken = Option(
        candidate=candidate("coulomb_friction"), model=wide, score=score, gain=1.0, z=9.0
    )
    step = Step(taken=taken, equals=(), options=(), before=before.loss)
    tried = [candidate("coulomb_friction"), candidate("viscous_friction")]
    monkeypatch.setattr(steps, "candidates", lambda _: tried)
    found = regrown(Grown(wide, score, (step,)), declared, rows, before)
    if not damping:
        assert found.steps == (step,)
        return
    assert sorted(s.key[0] for s in found.steps) == ["coulomb_friction", "viscous_friction"]
    beside = evaluate(wide.with_term(term(rows, "viscous_friction", {})), rows)
    assert found.score.loss < 0.1 * beside.loss
    assert np.sort(found.score.coefficients) == pytest.approx([0.4, 0.5], rel=0.05)
    # What is there already is not asked for again.
    assert not damped_starts(found, declared, rows, before)


@pytest.mark.parametrize("missing", [True, False])
def test_where_the_best_first_effect_leaves_much_the_next_ones_are_tried_in_its_place(
    elbow: Recording, monkeypatch: pytest.MonkeyPatch, missing: bool
) -> None:
    """A reflex and a load were stiffness that rest builds up, and neither was asked beside it."""
    load = torque(elbow, "payload", {"distance": 1.6}, 0.4)
    cube = torque(elbow, "nonlinear_stiffness", {"centre": 1.0}, 20.0)
    rows = rows_with(elbow, load + (cube if missing else 0.0))
    declared = Model(rows.recording)
    before = evaluate(declared, rows)
    tried = [candidate(name) for name in ("payload", "nonlinear_stiffness", "joint_stiffness")]
    monkeypatch.setattr(steps, "candidates", lambda _: tried)
    options = options_beside(declared, rows, before, tried)
    first = next(o for o in options if o.candidate.effect.name != "nonlinear_stiffness")
    if missing:
        first = next(o for o in options if o.candidate.effect.name == "joint_stiffness")
    step = Step(taken=first, equals=(), options=tuple(options), before=before.loss)
    found = regrown(Grown(first.model, first.score, (step,)), declared, rows, before)
    if not missing:
        assert found.steps == (step,)
        return
    assert sorted(s.key[0] for s in found.steps) == ["nonlinear_stiffness", "payload"]
    assert found.score.loss < 0.01 * first.score.loss


@pytest.mark.parametrize("power", [1.0, -1.0])
def test_a_limb_that_is_free_over_a_little_of_its_range_has_two_ends_and_is_no_wave(
    elbow: Recording, power: float
) -> None:
    """They were one wave over the range and K was twice as large: a stranger's, in 19 sessions."""
    middle, half = unfitted(elbow, ELBOW).travel
    ends = {"onset_positive": middle + 0.1 * half, "onset_negative": middle - 0.25 * half}
    widths = {"width_positive": 0.1 * half, "width_negative": 0.1 * half} if power < 0.0 else {}
    theta = {**ends, **widths, "power": power}
    rows = rows_with(elbow, torque(elbow, "end_range_both", theta, 12.0, 8.0))
    declared = Model(rows.recording)
    before = evaluate(declared, rows)
    (wave,) = options_beside(declared, rows, before, [candidate("torque_ripple")])
    step = Step(taken=wave, equals=(), options=(wave,), before=before.loss)
    (found,) = regrown(Grown(wave.model, wave.score, (step,)), declared, rows, before).steps
    assert found.key == ("end_range_both", ELBOW)
    for name, value in ends.items():
        assert found.taken.model.terms[-1].theta[name] == pytest.approx(value, abs=0.01)


@pytest.mark.parametrize("stiffness", [4.0, -4.0])
def test_ends_of_a_range_leave_no_limb_between_them_that_pushes_away_from_its_middle(
    elbow: Recording, stiffness: float
) -> None:
    """They bend there, too, then, as a cubic does: K went from 142 to 213 % off."""
    joint = unfitted(elbow, ELBOW)
    middle, half = joint.travel
    ends = {"onset_positive": middle + 0.6 * half, "onset_negative": middle - 0.6 * half}
    theta = {**ends, "width_positive": 0.2 * half, "width_negative": 0.2 * half, "power": -1.0}
    extra = torque(elbow, "end_range_both", theta, 30.0, 30.0)
    rows = rows_with(elbow, extra + stiffness * (joint.position - middle))
    limb = replace(term(rows, "viscoelastic_joint", {}), candidate=None)
    declared = Model(rows.recording).with_term(limb)
    before = evaluate(declared, rows)
    (cubic,) = options_beside(declared, rows, before, [candidate("nonlinear_stiffness")])
    step = Step(taken=cubic, equals=(), options=(cubic,), before=before.loss)
    starts = [*richer_starts(Grown(cubic.model, cubic.score, (step,)), declared, rows, before)]
    assert len(starts) == (stiffness > 0.0)


@pytest.mark.parametrize(
    ("other", "name"), [(2.0, "stretch_reflex_both"), (0.002, "stretch_reflex")]
)
def test_reflexes_of_both_sides_take_the_place_of_one_where_the_other_is_seen(
    elbow: Recording, other: float, name: str
) -> None:
    """One explained less than it has to, and five pushes were told; and one was called both where
    the other side's gain was nothing: two strangers'.
    """
    theta = {"delay": 0.04, "activation_time": 0.0, "speed": 0.15}
    rows = rows_with(elbow, torque(elbow, "stretch_reflex_both", theta, 3.0, other))
    declared = Model(rows.recording)
    before = evaluate(declared, rows)
    (one,) = options_beside(declared, rows, before, [candidate("stretch_reflex")])
    step = Step(taken=one, equals=(), options=(one,), before=before.loss)
    (found,) = regrown(Grown(one.model, one.score, (step,)), declared, rows, before).steps
    assert found.key == (name, ELBOW)
    sizes = found.taken.score.coefficients[-2:] if other > 1.0 else [3.0, 2.0]
    assert sizes == pytest.approx([3.0, 2.0], rel=0.05)
