"""Cuffs, straps and soft tissue in whole assessments."""

import mujoco
import numpy as np
import pytest

from sim.assessment.assess import Assessment, assess
from sim.assessment.donning import close_straps
from sim.assessment.validity import FAILURES
from sim.interface.contact import SLACK
from sim.system.system import System
from tests.testbed.assessments import Assess


@pytest.mark.parametrize("limb", ["upper arm", "forearm"])
def test_an_arm_whose_strap_is_cut_is_never_a_number(
    limb: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def close(system: System, data: mujoco.MjData, stiffness: np.ndarray) -> None:
        close_straps(system, data, stiffness)
        upper, fore = np.split(system.straps, 2)
        system.model.tendon_stiffness[upper if limb == "upper arm" else fore] = 0.0

    monkeypatch.setattr("sim.assessment.donning.close_straps", close)
    cut = assess({})
    assert cut.outcome == "strap_lost"
    assert cut.reason.startswith(limb)


def test_an_arm_that_lies_on_the_wall_of_its_cuff_needs_no_strap(assessed: Assess) -> None:
    """Published muscles press a short upper arm on the wall, so that its strap goes slack."""
    lying = assessed(
        {
            "upper_arm_length": 0.2811,
            "forearm_length": 0.3356,
            "upper_arm_mass": 0.717,
            "forearm_mass": 1.03,
            "upper_arm_elasticity": 646.5,
            "forearm_elasticity": 904.6,
            "muscles": 1.0,
        }
    )
    assert lying.outcome == "ok"
    assert lying.record is not None
    assert lying.record.loads.strap_tension.min() < SLACK


def test_an_arm_without_a_strap_is_never_a_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim.interface.straps.STRAP_STIFFNESS", 20.0)
    assert assess({"strap_tension": 0.1}).outcome in FAILURES


def test_looser_straps_and_softer_tissue_let_the_arm_give_way_more(
    assessed: Assess, nominal: Assessment
) -> None:
    difference = nominal.diagnostics["largest_angle_difference_deg"]
    for values in ({"strap_tension": 15.0}, {"tissue_scale": 0.2}, {"cuff_friction": 0.1}):
        loose = assessed(values)
        assert loose.diagnostics["largest_angle_difference_deg"] > difference, values
        assert loose.outputs["stiffness_error"] < nominal.outputs["stiffness_error"]


def test_a_sliding_cuff_removes_what_a_long_upper_arm_does_to_the_estimate(
    assessed: Assess,
) -> None:
    long = {"upper_arm_length": 0.3778}
    fixed, sliding = assessed(long), assessed({**long, "cuff_compliance": 0.01})
    assert fixed.outputs["stiffness_error"] < sliding.outputs["stiffness_error"] - 0.5


def test_straps_closed_elsewhere_move_to_the_start_and_leave_a_mark(
    assessed: Assess, nominal: Assessment
) -> None:
    seated = assessed({"seat_angle": -0.35})
    assert seated.outcome == "ok", seated.reason
    assert seated.record is not None and nominal.record is not None
    assert seated.record.theta[0, 3] == pytest.approx(nominal.record.theta[0, 3], abs=1e-3)
    assert seated.outputs["stiffness_error"] < nominal.outputs["stiffness_error"] - 0.05
