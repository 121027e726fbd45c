"""Soft tissue follows the wearer and the fidelity."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sim.body.skeleton import empty_spec
from sim.body.soft_tissue import add_soft_tissue, element_name, over_elements, soft_tissues
from sim.parameters.conditions import TISSUE_COUPLING
from sim.parameters.fidelity import FIDELITIES
from sim.parameters.wearer import NOMINAL_WEARER


def test_one_element_has_the_stiffness_of_table_1_in_newton_per_metre() -> None:
    """Central spring k, neighbours' springs a share of k each, and k / count of the volume's."""
    tissue = soft_tissues(replace(NOMINAL_WEARER, upper_arm_elasticity=400.0))[0]
    spec = empty_spec()
    spec.worldbody.add_body(name=tissue.bone)
    add_soft_tissue(spec, tissue)
    model = spec.compile()
    data = mujoco.MjData(model)
    joint = model.joint(element_name(tissue, 5, 3))
    press = 1e-5
    data.qpos[joint.qposadr[0]] = -press
    mujoco.mj_forward(model, data)
    stiffness = data.qfrc_spring[joint.dofadr[0]] / press
    assert stiffness == pytest.approx(
        400.0 * (1 + 4 * TISSUE_COUPLING + 1 / len(tissue.places)), rel=1e-4
    )


def test_finer_elements_share_the_stiffness_of_the_reference_ones() -> None:
    for fidelity in FIDELITIES.values():
        for tissue in soft_tissues(NOMINAL_WEARER, fidelity=fidelity):
            total = tissue.share * tissue.elasticity * len(tissue.places)
            assert total == pytest.approx(96 * 537.465)


def test_tissue_weighs_what_the_paper_leaves_for_it() -> None:
    for tissue, mass in zip(soft_tissues(NOMINAL_WEARER), (0.489, 0.351), strict=True):
        spec = empty_spec()
        spec.worldbody.add_body(name=tissue.bone)
        add_soft_tissue(spec, tissue)
        assert spec.compile().body_subtreemass[0] == pytest.approx(mass)


def test_elements_point_away_from_the_limbs_axis() -> None:
    for tissue in soft_tissues(NOMINAL_WEARER):
        for index in range(tissue.per_ring):
            skin, normal = tissue.element(3, index)
            radial = skin - np.array([skin[0], tissue.axis_y, tissue.axis_z])
            assert radial == pytest.approx(tissue.radius * normal)


def test_forces_of_a_step_are_the_same_bits_alone_and_among_others() -> None:
    """Whoever watches an assessment has its steps one by one, others all of them together."""
    tissue = soft_tissues(NOMINAL_WEARER)[0]
    states = np.random.default_rng(0).normal(0.0, 1e-3, (9, 1 + 2 * len(tissue.places)))
    columns = list(range(1, 1 + len(tissue.places)))
    together = tissue.spring_forces(states[:, columns], 10.0 * states[:, columns])
    total = over_elements(together)
    for step in range(len(states)):
        seen = states[step : step + 1]
        alone = tissue.spring_forces(seen[:, columns], 10.0 * seen[:, columns])
        np.testing.assert_array_equal(alone[0], together[step])
        assert over_elements(alone)[0] == total[step]
