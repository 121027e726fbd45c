"""The fidelity without contact: smooth, fast, and close to contact."""

from dataclasses import replace
from itertools import product

import mujoco
import numpy as np
import pytest

from sim.assessment.assess import assess
from sim.assessment.protocol import run_protocol
from sim.evaluation import evaluate
from sim.models import ASSESSMENTS, MODELS
from sim.parameters.fidelity import BUSHING
from sim.parameters.wearer import NOMINAL_WEARER, TABLE_1
from sim.system.build import build_system
from sim.system.start import reset_to_start
from tests.testbed.assessments import Assess


def at(unit: float | np.ndarray) -> dict[str, float]:
    points = np.broadcast_to(np.asarray(unit, dtype=float), len(TABLE_1))
    return {
        f.name: float(f.low + (f.high - f.low) * x) for f, x in zip(TABLE_1, points, strict=True)
    }


def test_the_nominal_wearer_is_as_stiff_as_with_contact(assessed: Assess) -> None:
    without, contact = assessed({}, fidelity="bushing"), assessed({})
    assert without.outcome == "ok"
    for name, tolerance in (("stiffness_estimate", 0.8), ("stiffness_true", 0.6)):
        assert without.outputs[name] == pytest.approx(contact.outputs[name], abs=tolerance)
    assert without.outputs["peak_contact_force"] == pytest.approx(
        contact.outputs["peak_contact_force"], rel=0.25
    )


def test_it_ranks_wearers_nearly_as_contact_does(assessed: Assess) -> None:
    rng = np.random.default_rng(5)
    points = [at(rng.random(len(TABLE_1))) for _ in range(16)]
    ranks = [
        np.argsort(
            np.argsort([assessed(p, fidelity=f).outputs["stiffness_estimate"] for p in points])
        )
        for f in ("bushing", "screening")
    ]
    assert np.corrcoef(ranks)[0, 1] > 0.8


def test_the_response_is_smooth(assessed: Assess) -> None:
    """A thousandth of the range moves the estimate by a thousandth of what the range does."""
    lengths = np.linspace(0.33, 0.3301, 5)
    estimates = [
        assessed({"upper_arm_length": x}, fidelity="bushing").outputs["stiffness_estimate"]
        for x in lengths
    ]
    assert np.abs(np.diff(estimates, 2)).max() < 1e-4
    assert np.abs(np.diff(estimates)).max() < 0.01


def test_the_arm_begins_at_rest() -> None:
    """Newton's method finds the same start as waiting in the locked robot for a long time."""
    system = build_system(NOMINAL_WEARER, fidelity=BUSHING)
    record = run_protocol(system, reset_to_start(system))
    data = reset_to_start(system)
    data.act[system.model.actuator_actadr[system.contracted]] = system.activation
    data.ctrl[system.contraction_inputs] = system.activation
    for _ in range(1500):
        data.qpos[system.exo_qpos], data.qvel[system.exo_dof] = system.start, 0.0
        mujoco.mj_step(system.model, data)
    assert record.q[0] == pytest.approx(data.qpos[system.human_qpos], abs=1e-5)
    assert record.theta[0] == pytest.approx(system.start, abs=1e-12)
    # The controllers carry the arm from the first step on.
    assert np.abs(record.q_velocity[1]).max() < 0.01


def test_halving_the_step_hardly_matters() -> None:
    coarse = assess({}, fidelity="bushing").outputs
    fine = assess({}, fidelity=replace(BUSHING, step=0.005)).outputs
    assert coarse["stiffness_estimate"] == pytest.approx(fine["stiffness_estimate"], abs=0.2)
    assert coarse["stiffness_error"] == pytest.approx(fine["stiffness_error"], abs=0.2)


def test_no_corner_of_table_1_diverges(assessed: Assess) -> None:
    outcomes = [
        assessed(at(np.array(corner)), fidelity="bushing").outcome
        for corner in product((0.0, 1.0), repeat=len(TABLE_1))
    ]
    assert outcomes.count("ok") >= 56
    assert "diverged" not in outcomes


def test_a_forearm_that_has_slid_out_of_its_bushing_is_no_number(assessed: Assess) -> None:
    slid = assessed({"upper_arm_length": 0.40}, fidelity="bushing")
    assert slid.outcome == "slipped"
    assert slid.reason.startswith("forearm: it slid to 1.1")
    soft = assessed({"forearm_elasticity": 1.0}, fidelity="bushing")
    assert soft.outcome == "bottomed_out"


def test_what_only_contact_has_is_refused_in_a_sentence() -> None:
    with pytest.raises(ValueError, match="the bushing has no contact"):
        assess({"cuff_friction": 0.1}, fidelity="bushing")
    assert "cuff_friction" not in {factor.name for factor in MODELS["elbow_bushing"].factors}


@pytest.mark.parametrize("model", sorted(ASSESSMENTS))
def test_every_assessment_can_be_evaluated_by_its_name(
    model: str, assessed: Assess, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Three names are of one simulation each, and other tests have looked at some.
    monkeypatch.setattr("sim.assessment.assess.assess", assessed)
    evaluation = evaluate(model, {"forearm_mass": 1.0} if "bushing" in model else {})
    assert evaluation.outcome == "ok"
    assert set(evaluation.outputs) == set(MODELS[model].outputs)
