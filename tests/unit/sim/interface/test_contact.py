"""What the engine measures is what the contacts and the bodies say."""

import mujoco
import numpy as np
import pytest

from sim.body.soft_tissue import BONE_CLEARANCE
from sim.system.start import reset_to_start
from sim.system.system import System


@pytest.fixture(scope="module")
def loaded(nominal_system: System) -> tuple[System, mujoco.MjData]:
    system = nominal_system
    data = reset_to_start(system)
    data.ctrl[system.contraction_inputs] = 0.4
    mujoco.mj_step(system.model, data, 20)
    mujoco.mj_forward(system.model, data)
    return system, data


def test_the_forces_on_each_limb_are_those_of_its_contacts(
    loaded: tuple[System, mujoco.MjData],
) -> None:
    system, data = loaded
    model, wrench = system.model, np.empty(6)
    resultant, normal = {"upper_arm": np.zeros(3), "forearm": np.zeros(3)}, 0.0
    assert data.ncon > 20
    for number in range(data.ncon):
        contact = data.contact[number]
        mujoco.mj_contactForce(model, data, number, wrench)
        names = [model.geom(geom).name for geom in contact.geom]
        limb = next(name for name in names if "_tissue_" in name).split("_tissue_")[0]
        sign = 1.0 if "_tissue_" in names[1] else -1.0
        resultant[limb] += sign * contact.frame.reshape(3, 3).T @ wrench[:3]
        normal += wrench[0]
    loads = system.interface.loads(model, data.sensordata[None])
    expected = [np.linalg.norm(resultant[name]) for name in ("upper_arm", "forearm")]
    assert loads.contact_force[0] == pytest.approx(expected, rel=1e-9)
    assert loads.normal_force[0] == pytest.approx(normal, rel=1e-9)
    assert min(expected) > 1.0


def test_a_cuffs_place_is_seen_from_its_bone(loaded: tuple[System, mujoco.MjData]) -> None:
    system, data = loaded
    loads = system.interface.loads(system.model, data.sensordata[None])
    limbs = zip(system.interface.cuffs, system.interface.tissues, strict=True)
    for i, (cuff, tissue) in enumerate(limbs):
        link, bone = data.body(cuff.link), data.body(tissue.bone)
        distance = []
        for share in (0.0, -1.0, 1.0):
            point = np.array(cuff.centre) + share * cuff.length / 2 * np.array(cuff.along)
            world = link.xpos + link.xmat.reshape(3, 3) @ point
            x, y, z = bone.xmat.reshape(3, 3).T @ (world - bone.xpos)
            distance.append(np.hypot(y - tissue.axis_y, z - tissue.axis_z))
            if share == 0.0:
                assert loads.overhang[0, i] == pytest.approx(max(tissue.start - x, x - tissue.end))
        deepest = max(distance) - cuff.radius + BONE_CLEARANCE
        assert loads.penetration[0, i] == pytest.approx(deepest)
