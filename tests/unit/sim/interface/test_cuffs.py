"""Cuffs, straps and which parts may touch."""

import mujoco
import numpy as np
import pytest

from sim.interface.cuffs import BOX_ANGLES, cuff_box_name, place_cuffs
from sim.interface.straps import particle_name, strap_angles
from sim.parameters.conditions import conditions_of
from sim.parameters.fidelity import CAMPAIGN
from sim.robot.device import NESM
from sim.system.system import System

CUFFS = NESM.cuffs


@pytest.mark.parametrize("cuff", CUFFS, ids=lambda cuff: cuff.name)
def test_box_frames_are_right_handed(cuff: object) -> None:
    for angle in [*BOX_ANGLES, *strap_angles(CAMPAIGN)]:
        frame = cuff.box_frame(angle)  # type: ignore[attr-defined]
        assert np.linalg.det(frame) == pytest.approx(1.0)
        assert frame.T @ frame == pytest.approx(np.eye(3))


def test_every_compiled_box_faces_the_axis_of_its_cuff(nominal_system: System) -> None:
    data = mujoco.MjData(nominal_system.model)
    mujoco.mj_kinematics(nominal_system.model, data)
    for cuff in CUFFS:
        link = data.body(cuff.link)
        frame = link.xmat.reshape(3, 3)
        boxes = [(cuff_box_name(cuff, i), a) for i, a in enumerate(BOX_ANGLES)]
        boxes += [(particle_name(cuff, 0, i), a) for i, a in enumerate(strap_angles(CAMPAIGN))]
        for name, angle in boxes:
            geom = data.geom(name)
            assert geom.xmat.reshape(3, 3)[:, 1] == pytest.approx(frame @ cuff.normal(angle))
            offset = frame.T @ (geom.xpos - link.xpos) - np.array(cuff.centre)
            inner_face = offset @ cuff.normal(angle) - nominal_system.model.geom(name).size[1]
            assert inner_face == pytest.approx(cuff.radius)


def test_both_cuffs_open_medially_and_lie_along_their_limbs(nominal_system: System) -> None:
    data = mujoco.MjData(nominal_system.model)
    mujoco.mj_kinematics(nominal_system.model, data)
    for cuff in CUFFS:
        frame = data.body(cuff.link).xmat.reshape(3, 3)
        assert frame @ cuff.opening == pytest.approx([0.0, 1.0, 0.0])
        assert frame @ cuff.along == pytest.approx([1.0, 0.0, 0.0])


def test_tissue_touches_only_its_own_cuff_and_strap(nominal_system: System) -> None:
    model = nominal_system.model
    names = [
        [model.geom(g).name for g in pair]
        for pair in zip(model.pair_geom1, model.pair_geom2, strict=True)
    ]
    assert len(names) > 1000
    for pair in names:
        limbs = {"forearm" if name.startswith("forearm") else "upper_arm" for name in pair}
        assert len(limbs) == 1
    assert not model.geom_contype.any()


def test_cuffs_move_along_their_limbs() -> None:
    conditions = conditions_of({"cuff_position": -0.01, "upper_cuff_position": 0.02})
    moved = place_cuffs(CUFFS, conditions)
    for cuff, before, distance in zip(moved, CUFFS, (0.02, -0.01), strict=True):
        way = np.array(cuff.centre) - before.centre
        assert way == pytest.approx(distance * np.array(before.along))
        assert cuff.limb_place[0] == pytest.approx(before.limb_place[0] + distance)
