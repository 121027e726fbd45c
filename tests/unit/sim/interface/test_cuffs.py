"""Cuffs, straps and which parts may touch."""

import mujoco
import numpy as np
import pytest

from sim.body.skeleton import ELBOW_RANGE
from sim.body.soft_tissue import soft_tissues
from sim.interface.cuffs import BOX_ANGLES, cuff_box_name, place_cuffs
from sim.interface.seat import seated_elbow_angle
from sim.interface.straps import particle_name, strap_angles
from sim.parameters.conditions import conditions_of
from sim.parameters.fidelity import CAMPAIGN
from sim.parameters.wearer import NOMINAL_WEARER, wearer_of
from sim.robot.device import NESM
from sim.system.build import build_system
from sim.system.start import reset_to_start
from sim.system.system import System

START = NESM.start("elbow").angles
CUFFS = NESM.cuffs


@pytest.fixture(scope="module")
def system() -> System:
    return build_system(NOMINAL_WEARER)


@pytest.mark.parametrize("cuff", CUFFS, ids=lambda cuff: cuff.name)
def test_box_frames_are_right_handed(cuff: object) -> None:
    for angle in [*BOX_ANGLES, *strap_angles(CAMPAIGN)]:
        frame = cuff.box_frame(angle)  # type: ignore[attr-defined]
        assert np.linalg.det(frame) == pytest.approx(1.0)
        assert frame.T @ frame == pytest.approx(np.eye(3))


def test_every_compiled_box_faces_the_axis_of_its_cuff(system: System) -> None:
    data = mujoco.MjData(system.model)
    mujoco.mj_kinematics(system.model, data)
    for cuff in CUFFS:
        link = data.body(cuff.link)
        frame = link.xmat.reshape(3, 3)
        boxes = [(cuff_box_name(cuff, i), a) for i, a in enumerate(BOX_ANGLES)]
        boxes += [(particle_name(cuff, 0, i), a) for i, a in enumerate(strap_angles(CAMPAIGN))]
        for name, angle in boxes:
            geom = data.geom(name)
            assert geom.xmat.reshape(3, 3)[:, 1] == pytest.approx(frame @ cuff.normal(angle))
            offset = frame.T @ (geom.xpos - link.xpos) - np.array(cuff.centre)
            inner_face = offset @ cuff.normal(angle) - system.model.geom(name).size[1]
            assert inner_face == pytest.approx(cuff.radius)


def test_both_cuffs_open_medially_and_lie_along_their_limbs(system: System) -> None:
    data = mujoco.MjData(system.model)
    mujoco.mj_kinematics(system.model, data)
    for cuff in CUFFS:
        frame = data.body(cuff.link).xmat.reshape(3, 3)
        assert frame @ cuff.opening == pytest.approx([0.0, 1.0, 0.0])
        assert frame @ cuff.along == pytest.approx([1.0, 0.0, 0.0])


def test_tissue_touches_only_its_own_cuff_and_strap(system: System) -> None:
    model = system.model
    names = [
        [model.geom(g).name for g in pair]
        for pair in zip(model.pair_geom1, model.pair_geom2, strict=True)
    ]
    assert len(names) > 1000
    for pair in names:
        limbs = {"forearm" if name.startswith("forearm") else "upper_arm" for name in pair}
        assert len(limbs) == 1
    assert not model.geom_contype.any()


def test_the_arm_sits_in_both_cuffs_at_the_start(system: System) -> None:
    data = reset_to_start(system)
    mujoco.mj_forward(system.model, data)
    assert data.qpos[system.exo_qpos] == pytest.approx(START)
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


def test_cuffs_move_along_their_limbs() -> None:
    conditions = conditions_of({"cuff_position": -0.01, "upper_cuff_position": 0.02})
    moved = place_cuffs(CUFFS, conditions)
    for cuff, before, distance in zip(moved, CUFFS, (0.02, -0.01), strict=True):
        way = np.array(cuff.centre) - before.centre
        assert way == pytest.approx(distance * np.array(before.along))
        assert cuff.limb_place[0] == pytest.approx(before.limb_place[0] + distance)
