"""A stiffness moves as far as every explanation of the trials says, and no further."""

from dataclasses import replace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest

from analysis.closeloop.contract import Verdict
from analysis.closeloop.identification.balance.model import Model, evaluate, impedances, unfitted
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.identification.explainable import explainable
from analysis.closeloop.identification.findings import Option, Outcome, Step, Trace
from analysis.closeloop.judgement import agreement
from analysis.closeloop.judgement.agreement import agreed
from analysis.closeloop.report.impedance import (
    identified_entries,
    impedance_entries,
    not_identified,
    undecided,
)
from sim.effects.catalogue import BY_NAME, VISCOELASTIC
from tests.testbed.sessions.rich import ELBOW, rich_elbow

STIFFNESS, INERTIA = 8.0, 0.05


@pytest.fixture(scope="module")
def rows() -> Rows:
    """A limb's elbow of which the declared inertia is too small."""
    elbow = rich_elbow()
    effort = np.array(elbow.inverse)
    effort[:, ELBOW] += STIFFNESS * (elbow.position[:, ELBOW] - 0.8)
    effort[:, ELBOW] += INERTIA * elbow.acceleration[:, ELBOW]
    effort[:, ELBOW] += 0.05 * np.random.default_rng(2).standard_normal(len(effort))
    loud = replace(elbow, effort=elbow.filtered(effort), cache={})
    return select_rows(loud, (0,)).reweighted({ELBOW: 0.05})


def option(declared: Model, rows: Rows, name: str) -> Option:
    effect = BY_NAME[name]
    candidate = Candidate(effect=effect, joint=ELBOW)
    theta = {"smooth": 0.02, "speed": 0.05, "power": 2.0, "distance": 1.0}
    columns = effect.columns(unfitted(rows.recording, ELBOW), theta)
    term = Term(joint=ELBOW, columns=columns, kept=(0,), effect=effect, candidate=candidate)
    model = declared.with_term(term)
    return Option(candidate=candidate, model=model, score=evaluate(model, rows), gain=1.0, z=9.0)


def traced(rows: Rows, taken: str, equal: str) -> Trace:
    """Return what tracing found where two names would explain the trials alike."""
    limb = unfitted(rows.recording, ELBOW)
    term = Term(
        joint=ELBOW, columns=VISCOELASTIC.columns(limb, {}), kept=(0, 1, 2), effect=VISCOELASTIC
    )
    declared = Model(rows.recording, terms=(term,))
    one, other = (option(declared, rows, name) for name in (taken, equal))
    before, beyond = evaluate(declared, rows), explainable(declared, rows)
    step = Step(taken=one, equals=(other,), options=(one, other), before=before.loss)
    return Trace(
        rows=rows,
        declared=declared,
        declared_score=before,
        model=one.model,
        score=one.score,
        steps=(step,),
        verdict=Verdict.EFFECT_FOUND,
        explainable_before=beyond,
        explainable_after=beyond,
    )


def test_names_that_move_a_stiffness_different_ways_repair_nothing(rows: Rows) -> None:
    found = agreed(traced(rows, "added_inertia", "torque_gain"))
    assert found.verdict == Verdict.NOT_IDENTIFIABLE
    assert [step.key[0] for step in found.steps] == ["added_inertia"]
    entries = impedance_entries(found)
    stiffness = entries["elbow"]["stiffness"]
    assert stiffness["after"] == stiffness["before"]
    said, (low, high) = stiffness["after_if"], stiffness["ci90_after"]
    assert said["added_inertia"] < stiffness["before"] < said["torque_gain"]
    assert low < said["added_inertia"] and said["torque_gain"] < high
    assert "if nothing is repaired" in undecided(entries)[0]


def test_names_that_agree_on_a_stiffness_repair_it(rows: Rows) -> None:
    found = agreed(traced(rows, "coulomb_friction", "stribeck_friction"))
    assert found.verdict == Verdict.EFFECT_FOUND and found.supposed is None


@pytest.mark.parametrize(
    ("names", "identified"),
    [(("coulomb_friction", "torque_offset"), True), (("added_inertia", "torque_gain"), False)],
)
def test_a_stiffness_that_equal_names_move_apart_is_not_identified(
    names: tuple[str, str], identified: bool, rows: Rows
) -> None:
    found = agreed(traced(rows, *names))
    nothing_hides = MagicMock(spec=Outcome, trace=found, hidden={ELBOW: ()})
    nothing_hides.identified.return_value = True
    entries = identified_entries(nothing_hides, impedance_entries(found))
    assert entries["elbow"]["stiffness"] is identified
    assert not_identified(entries) == []


def test_of_names_that_move_a_stiffness_one_way_the_one_that_moves_it_least_repairs(
    rows: Rows,
) -> None:
    far = traced(rows, "added_inertia", "payload")
    near = agreed(far)
    declared, one, other = (
        impedances(*fit)[ELBOW]["stiffness"] for fit in (*far.fits, near.fits[1])
    )
    assert one < other < declared and declared - other < 0.5 * (declared - one)
    assert near.verdict == Verdict.EFFECT_FOUND
    (step,) = near.steps
    assert step.key[0] == "payload" and step.equals[0].candidate.effect.name == "added_inertia"
    # Already the nearest, it stays.
    assert agreed(traced(rows, "payload", "added_inertia")).steps[0].key[0] == "payload"


@pytest.mark.parametrize(
    ("sure", "name"),
    [
        ({"added_inertia"}, "added_inertia"),
        ({"added_inertia", "payload"}, "payload"),
        (set(), "payload"),
    ],
)
def test_no_name_of_an_unsure_size_takes_the_place_of_a_sure_one(
    sure: set[str], name: str, rows: Rows, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside friction a gain of 1.3 was a payload of -0.5 [-1.8, 0.7] kg, and K 23 % low."""

    def of_sure_size(_m: Model, _c: np.ndarray, _f: Any, candidate: Candidate) -> bool:
        return candidate.effect.name in sure

    monkeypatch.setattr(agreement, "of_sure_size", of_sure_size)
    (step,) = agreed(traced(rows, "added_inertia", "payload")).steps
    assert step.key[0] == name


def test_of_several_effects_that_were_found_it_is_said_that_another_stands_in_place_of_one() -> (
    None
):
    """Of friction, a payload and an inertia K was another "if the effect is payload"."""
    stiffness = {"unit": "Nm/rad", "before": 5.5, "after": 5.2, "after_if": {"payload": 4.6}}
    (said,) = undecided({"elbow": {"stiffness": stiffness}})
    assert said == (
        "the stiffness of elbow is 5.2 Nm/rad with the names that it has here, but 4.6 with "
        "payload in place of one that these trials do not tell from it; its interval holds them all"
    )
