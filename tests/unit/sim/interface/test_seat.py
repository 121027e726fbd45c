"""How the arm lies in the exoskeleton when its straps are closed."""

import mujoco
import numpy as np
import pytest

from sim.body.skeleton import ELBOW_RANGE
from sim.body.soft_tissue import soft_tissues
from sim.interface.seat import seated_elbow_angle
from sim.parameters.conditions import conditions_of
from sim.parameters.wearer import NOMINAL_WEARER, wearer_of
from sim.robot.device import NESM
from sim.system.build import build_system
from sim.system.start import reset_to_start
from sim.system.system import System

START = NESM.start("elbow").angles
CUFFS = NESM.cuffs


def test_the_arm_sits_in_both_cuffs_at_the_start(nominal_system: System) -> None:
    data = reset_to_start(nominal_system)
    mujoco.mj_forward(nominal_system.model, data)
    assert data.qpos[nominal_system.exo_qpos] == pytest.approx(START)
    forearm = CUFFS[1]
    link, ulna = data.body(forearm.link), data.body("ulna")
    centre = link.xpos + link.xmat.reshape(3, 3) @ forearm.centre
    local = ulna.xmat.reshape(3, 3).T @ (centre - ulna.xpos)
    assert local[2] == pytest.approx(0.015, abs=1e-9)


@pytest.mark.parametrize("upper", [0.2728, 0.3337, 0.3778])
@pytest.mark.parametrize("fore", [0.2827, 0.3455])
def test_the_seat_is_within_the_elbows_range_all_over_table_1(upper: float, fore: float) -> None:
    wearer = wearer_of({"upper_arm_length": upper, "forearm_length": fore})
    angle = seated_elbow_angle(wearer, soft_tissues(wearer)[1], CUFFS[1], START[3])
    assert ELBOW_RANGE[0] < angle < ELBOW_RANGE[1]
    assert abs(angle - START[3]) < np.radians(25.0)


@pytest.mark.parametrize("seat", [-0.35, 0.1])
def test_the_straps_may_be_closed_at_another_elbow_angle(seat: float) -> None:
    """There, too, the forearm's axis passes through the centre of its cuff."""
    system = build_system(NOMINAL_WEARER, conditions_of({"seat_angle": seat}))
    data = reset_to_start(system)
    mujoco.mj_forward(system.model, data)
    assert data.qpos[system.exo_qpos[3]] == pytest.approx(START[3] + seat)
    link, ulna = data.body(CUFFS[1].link), data.body("ulna")
    centre = link.xpos + link.xmat.reshape(3, 3) @ CUFFS[1].centre
    local = ulna.xmat.reshape(3, 3).T @ (centre - ulna.xpos)
    assert local[2] == pytest.approx(0.015, abs=1e-9)
