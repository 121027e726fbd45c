"""Efforts of a whole arm in another unit are one gain, and no links of another mass."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.arms.gains import (
    gain_of_all,
    gain_or_payload,
    untold_gain,
)
from analysis.closeloop.identification.balance.model import Model, evaluate, unfitted
from analysis.closeloop.identification.balance.regression import compare, select_rows
from analysis.closeloop.identification.balance.terms import Candidate
from analysis.closeloop.identification.candidates import tried_alone
from analysis.closeloop.identification.findings import Option
from analysis.closeloop.identification.nameable import beyond_physics
from sim.effects.catalogue import BY_NAME, LINK_INERTIA
from tests.testbed.sessions.coupled import measured, moving, traced


@pytest.mark.parametrize("factor", [1.5, 0.4, 0.2])
def test_one_factor_of_all_efforts_is_a_gain_of_every_joint(factor: float) -> None:
    arm = moving()
    torque = arm.rigid + 0.3 * np.sign(arm.velocity) + 0.2 * arm.velocity
    recording = measured(arm, torque / factor)
    found = traced(recording)
    assert {("torque_gain", joint) for joint in range(3)} <= set(found)
    assert LINK_INERTIA not in {name for name, _ in found}
    model, rows = next(iter(found.values())).taken.model, select_rows(recording, (0,))
    score = evaluate(model, rows)
    coefficients = score.coefficients
    assert gain_of_all(model, coefficients, rows) == pytest.approx(factor, rel=0.02)
    (said,) = untold_gain(model, coefficients, rows)
    assert f"{1.0 / factor:.2f} times their declared mass" in said
    # However far from one: then no limit keeps its value from the report.
    own = [candidate for candidate in model.effects if candidate.effect.name == "torque_gain"]
    assert [beyond_physics(model, score, candidate) for candidate in own] == ["", "", ""]


def test_a_gain_of_one_joint_is_none_of_all() -> None:
    arm = moving()
    torque = arm.rigid + 0.3 * np.sign(arm.velocity)
    recording = measured(arm, torque * np.array([1.0, 0.7, 1.0]))
    found = traced(recording)
    assert ("torque_gain", 1) in found
    model, rows = next(iter(found.values())).taken.model, select_rows(recording, (0,))
    assert gain_of_all(model, evaluate(model, rows).coefficients, rows) is None


@pytest.mark.parametrize(
    ("factor", "distance", "twins"),
    [(1.5, None, ["torque_gain"]), (5.0, None, ["torque_gain"]), (1.0, 0.6, [])],
)
def test_a_payload_that_a_gain_would_do_for_says_so(
    factor: float, distance: float | None, twins: list[str]
) -> None:
    """At the centre of percussion a mass is a gain; far beyond it has more inertia."""
    both = moving()
    arm = replace(both, joints=(1,), effort=np.zeros_like(both.effort), cache={})
    rest, here = Model(arm), Candidate(effect=BY_NAME["payload"], joint=1)
    torque = factor * arm.inverse
    if distance is not None:
        more = here.effect.columns(unfitted(arm, 1), {"distance": distance})[1]
        torque = arm.inverse + 0.2 * np.where(np.arange(3) == 1, more, 0.0)
    recording = measured(arm, torque)
    rows, rest = select_rows(recording, (0,)), replace(rest, recording=recording)
    found = tried_alone(rest, rows, here)
    assert found is not None
    gain, error = compare(evaluate(rest, rows).losses, found[1].losses)
    option = Option(candidate=here, model=found[0], score=found[1], gain=gain, z=gain / error)
    assert [o.candidate.effect.name for o in gain_or_payload(option, rest, rows)] == twins
