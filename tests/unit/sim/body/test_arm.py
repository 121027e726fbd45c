"""Bones, muscles and tissue follow the wearer."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sim.body.muscles.attach import add_muscles
from sim.body.muscles.elbow import PAPER_MUSCLES, REFITTED_MUSCLES
from sim.body.muscles.lengths import elbow_length_ranges
from sim.body.muscles.muscle import ElbowMuscles
from sim.body.skeleton import (
    HAND_MASS,
    HUMAN_JOINTS,
    PRONATION,
    add_arm,
    add_extension_stop,
    add_torso,
    empty_spec,
    extension_stop_torque,
)
from sim.body.soft_tissue import add_soft_tissue, element_name, soft_tissues
from sim.parameters.conditions import TISSUE_COUPLING
from sim.parameters.fidelity import FIDELITIES
from sim.parameters.wearer import NOMINAL_WEARER, Wearer
from sim.validation.isometric import run_isometric_test


def arm_of(wearer: Wearer) -> mujoco.MjModel:
    spec = empty_spec()
    add_arm(spec, wearer)
    return spec.compile()


def test_the_arm_has_five_degrees_of_freedom() -> None:
    model = arm_of(NOMINAL_WEARER)
    names = {model.joint(i).name for i in range(model.njnt)}
    assert names == {*HUMAN_JOINTS, PRONATION}
    assert model.nv == 5


def test_the_nominal_elbow_lies_on_the_exoskeletons_axis() -> None:
    elbow = arm_of(NOMINAL_WEARER).body("ulna").pos
    assert elbow == pytest.approx([0.25, 0.0, 0.0], abs=0.006)


def test_lengths_move_the_joints() -> None:
    longer = replace(NOMINAL_WEARER, upper_arm_length=0.3337 * 1.1, forearm_length=0.319 * 0.9)
    nominal, scaled = arm_of(NOMINAL_WEARER), arm_of(longer)
    assert scaled.body("ulna").pos == pytest.approx(1.1 * nominal.body("ulna").pos)
    assert scaled.body("hand").pos == pytest.approx(0.9 * nominal.body("hand").pos)


def test_masses_change_inertia() -> None:
    model = arm_of(replace(NOMINAL_WEARER, upper_arm_mass=3.0, forearm_mass=1.5))
    assert model.body("humerus").mass[0] == 3.0
    forearm = model.body("ulna").mass[0] + model.body("radius").mass[0]
    assert forearm == pytest.approx(1.5)
    assert model.body("hand").mass[0] == pytest.approx(HAND_MASS)
    ratio = model.body("humerus").inertia / arm_of(NOMINAL_WEARER).body("humerus").inertia
    assert ratio == pytest.approx([3.0 / 1.761] * 3)


def test_swept_length_ranges_agree_with_the_authors_fitted_formulas() -> None:
    """Their affine formulas at the nominal scales (facts of their nesm_with_patient model), m."""
    shrunk = 0.86267
    authors = {
        "brachialis": (0.1157036 * shrunk - 0.0163406, 0.1197597 * shrunk + 0.0346616),
        "triceps_long": (0.2898859 * shrunk - 0.0013835, 0.2898393 * shrunk + 0.0464836),
        "triceps_medial": (0.1102536 * shrunk - 0.0077232, 0.1147148 * shrunk + 0.0323103),
        "anconeus": (-0.0120683 * shrunk + 0.0306445, 0.0154295 * shrunk + 0.0322079),
    }
    ranges = elbow_length_ranges(NOMINAL_WEARER, PAPER_MUSCLES)
    for name, expected in authors.items():
        assert ranges[name] == pytest.approx(expected, abs=5e-4), name


def test_muscles_scale_with_the_bones() -> None:
    longer = replace(NOMINAL_WEARER, forearm_length=0.345)
    insertion = elbow_length_ranges(longer)["brachialis"]
    nominal = elbow_length_ranges(NOMINAL_WEARER)["brachialis"]
    assert insertion[0] < nominal[0] < nominal[1] < insertion[1]


@pytest.mark.parametrize("elbow", [PAPER_MUSCLES, REFITTED_MUSCLES], ids=["paper", "refitted"])
@pytest.mark.parametrize("upper", [0.2728, 0.3101, 0.3778])
def test_length_ranges_are_those_of_a_compiled_arm(upper: float, elbow: ElbowMuscles) -> None:
    wearer = replace(NOMINAL_WEARER, upper_arm_length=upper, forearm_length=0.3)
    spec = empty_spec()
    add_torso(spec)
    add_arm(spec, wearer)
    add_muscles(spec, wearer, elbow=elbow, others=())
    model = spec.compile()
    data, lengths = mujoco.MjData(model), []
    data.joint("shoulder_flexion").qpos = np.radians(-90.0)
    for angle in np.radians(np.linspace(0.0, 120.0, 25)):
        data.joint("elbow_flexion").qpos = angle
        mujoco.mj_forward(model, data)
        lengths.append(data.ten_length.copy())
    ranges = elbow_length_ranges(wearer, elbow)
    assert len(ranges) == model.ntendon == 8
    for tendon in range(model.ntendon):
        swept = np.array(lengths)[:, tendon]
        expected = (swept.min(), swept.max())
        assert ranges[model.tendon(tendon).name] == pytest.approx(expected, abs=1e-12)


def test_isometric_peaks_are_those_of_the_papers_figure_3() -> None:
    test = run_isometric_test()
    assert test.flexion_peak[0] == pytest.approx(80.0, rel=0.05)
    assert test.extension_peak[0] == pytest.approx(-50.0, rel=0.05)
    assert 60.0 <= test.flexion_peak[1] <= 90.0


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


def test_an_extension_stop_hardens_beyond_its_angle_and_does_nothing_before() -> None:
    spec = empty_spec()
    add_arm(spec, NOMINAL_WEARER)
    add_extension_stop(spec, 30.0)
    model = spec.compile()
    data = mujoco.MjData(model)
    elbow = model.joint(HUMAN_JOINTS[3])
    for angle, torque in (
        (90.0, 0.0),
        (5.0, 0.0),
        (0.0, 2.0 * 30.0 * np.radians(5.0)),
        (-5.0, 5.0 * 30.0 * np.radians(10.0)),
    ):
        data.qpos[elbow.qposadr[0]] = np.radians(angle)
        mujoco.mj_forward(model, data)
        assert data.qfrc_passive[elbow.dofadr[0]] == pytest.approx(torque, abs=1e-9)
        assert extension_stop_torque(np.radians(angle), 30.0) == pytest.approx(torque, abs=1e-9)
