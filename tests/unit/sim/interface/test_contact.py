"""What the engine measures is what the contacts and the bodies say."""

import mujoco
import numpy as np
import pytest

from sim.body.soft_tissue import BONE_CLEARANCE, element_name
from sim.interface.contact import slides
from sim.interface.interface import Loads
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


def loads_of(system: System, data: mujoco.MjData) -> Loads:
    states = np.concatenate([[data.time], data.qpos, data.qvel])
    return system.interface.loads(system.model, states[None], data.sensordata[None])


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
    loads = loads_of(system, data)
    expected = [np.linalg.norm(resultant[name]) for name in ("upper_arm", "forearm")]
    assert loads.contact_force[0] == pytest.approx(expected, rel=1e-9)
    assert loads.normal_force[0] == pytest.approx(normal, rel=1e-9)
    assert min(expected) > 1.0


def test_a_cuffs_place_is_seen_from_its_bone(loaded: tuple[System, mujoco.MjData]) -> None:
    system, data = loaded
    loads = loads_of(system, data)
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


def test_an_elements_forces_are_those_of_its_springs_in_the_engine(
    loaded: tuple[System, mujoco.MjData],
) -> None:
    system, data = loaded
    states = np.concatenate([[data.time], data.qpos, data.qvel])[None]
    for tissue in system.interface.tissues:
        forces = tissue.spring_forces(*slides(system.model, states, tissue))[0]
        names = [element_name(tissue, *place) for place in tissue.places]
        assert forces == pytest.approx(
            [float(data.joint(name).qfrc_passive[0]) for name in names], abs=1e-9
        )
        assert np.abs(forces).max() > 0.1


def test_a_cuff_that_is_turned_round_its_limb_says_by_how_much(nominal_system: System) -> None:
    data = reset_to_start(nominal_system)
    data.qpos[nominal_system.human_qpos[2]] += 0.2
    mujoco.mj_forward(nominal_system.model, data)
    # The upper arm turns about its own axis; the bent forearm is swung aside by it.
    assert loads_of(nominal_system, data).roll[0, 0] == pytest.approx(0.2, abs=0.01)


def test_a_straps_tension_is_that_of_its_rows_together(nominal_system: System) -> None:
    system, data = nominal_system, reset_to_start(nominal_system)
    model = system.model
    mujoco.mj_forward(model, data)
    saved = model.tendon_lengthspring[system.straps].copy()
    try:
        # Ten newtons in each segment of three rows.
        rest = data.ten_length[system.straps] - 10.0 / model.tendon_stiffness[system.straps]
        model.tendon_lengthspring[system.straps] = rest[:, None]
        assert loads_of(system, data).strap_tension[0] == pytest.approx([30.0, 30.0])
    finally:
        model.tendon_lengthspring[system.straps] = saved


def test_pressure_and_shear_are_of_the_forces_on_each_element(
    loaded: tuple[System, mujoco.MjData],
) -> None:
    system, data = loaded
    model, wrench = system.model, np.empty(6)
    on_each: dict[str, np.ndarray] = {}
    for number in range(data.ncon):
        contact = data.contact[number]
        mujoco.mj_contactForce(model, data, number, wrench)
        names = [model.geom(geom).name for geom in contact.geom]
        element = next(name for name in names if "_tissue_" in name)
        force = (1.0 if element == names[1] else -1.0) * contact.frame.reshape(3, 3).T @ wrench[:3]
        on_each[element] = on_each.get(element, np.zeros(3)) + force
    states = np.concatenate([[data.time], data.qpos, data.qvel])[None]
    loads = loads_of(system, data)
    for limb, tissue in enumerate(system.interface.tissues):
        pressing = np.maximum(0.0, tissue.spring_forces(*slides(model, states, tissue))[0])
        names = [element_name(tissue, *place) for place in tissue.places]
        whole = [float(np.linalg.norm(on_each.get(name, np.zeros(3)))) for name in names]
        along = np.sqrt(np.maximum(0.0, np.square(whole) - np.square(pressing)))
        skin = 2 * np.pi * tissue.radius * (tissue.end - tissue.start)
        assert len(names) * tissue.element_area == pytest.approx(skin)
        assert loads.peak_pressure[0, limb] * tissue.element_area == pytest.approx(pressing.max())
        assert loads.peak_shear[0, limb] * tissue.element_area == pytest.approx(along.max())
        assert 0.0 < loads.mean_pressure[0, limb] < loads.peak_pressure[0, limb]
        assert 0.0 < loads.strain[0, limb] < 0.5
