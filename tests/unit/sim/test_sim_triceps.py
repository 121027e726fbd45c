"""The triceps that wraps round the elbow: levers and torques beside published ones."""

import mujoco
import numpy as np
import pytest

from sim.muscles import ELBOW_EXTENSORS, add_muscles
from sim.skeleton import HUMAN_JOINTS, add_arm, add_torso, empty_spec
from sim.triceps import EXCURSION, FIBRE_LENGTHS, TROCHLEA_RADIUS
from sim.validation.isometric import (
    ANGLES_DEG,
    MEASURED,
    co_contraction_stiffness,
    run_isometric_test,
)
from sim.wearer import NOMINAL_WEARER

ANGLES = np.radians(np.arange(0.0, 131.0, 5.0))


def levers(*, wrapped: bool) -> dict[str, np.ndarray]:
    """Return each extensor's lever about the elbow (m, positive extends) over ANGLES."""
    spec = empty_spec()
    add_torso(spec)
    add_arm(spec, NOMINAL_WEARER)
    add_muscles(spec, NOMINAL_WEARER, wrapped=wrapped)
    model = spec.compile()
    data = mujoco.MjData(model)
    elbow = model.joint(HUMAN_JOINTS[3])
    data.qvel[elbow.dofadr[0]] = 1.0
    found = []
    for angle in ANGLES:
        data.qpos[elbow.qposadr[0]] = angle
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        found.append([data.ten_velocity[model.tendon(m.name).id] for m in ELBOW_EXTENSORS])
    return dict(zip((m.name for m in ELBOW_EXTENSORS), np.transpose(found), strict=True))


def test_wrapped_levers_are_those_measured_in_cadavers() -> None:
    """The fit of Pigeon, Yahia and Feldman 1996 (mm, degrees): 16 to 25 mm, least at the end."""
    degrees = np.degrees(ANGLES)
    measured = np.polyval(
        [-3.5171e-9, 1.3277e-6, -1.9092e-4, 1.2886e-2, -3.0284e-1, -23.287], degrees
    )
    for name, lever in levers(wrapped=True).items():
        if name in FIBRE_LENGTHS:
            assert 1e3 * lever == pytest.approx(-measured, abs=4.5), name
            assert lever.min() > TROCHLEA_RADIUS


def test_straight_levers_vanish_as_the_elbow_flexes() -> None:
    straight = levers(wrapped=False)
    assert straight["triceps_long"][-1] < 0.0, "the long head would flex"
    assert straight["triceps_lateral"].max() > 0.028 > 0.006 > straight["triceps_lateral"][-1]


def test_the_excursion_is_the_integral_of_the_lever() -> None:
    lever = levers(wrapped=True)["triceps_lateral"][: np.searchsorted(ANGLES, np.radians(121.0))]
    assert np.trapezoid(lever, dx=np.radians(5.0)) == pytest.approx(EXCURSION, abs=0.001)


def test_wrapped_isometric_peaks_lie_within_both_data_sets_of_figure_3() -> None:
    test = run_isometric_test(wrapped=True)
    for (torque, angle), expected, name in (
        (test.flexion_peak, 80.0, "flexion"),
        (test.extension_peak, -50.0, "extension"),
    ):
        assert torque == pytest.approx(expected, rel=0.05)
        first, last = sorted(data.peak_angle_deg(name) for data in MEASURED)
        assert first <= angle <= last


def test_the_measured_torques_ask_for_a_wrapped_triceps_stiffness() -> None:
    """Co-contraction at 0.4: one data set says it resists a movement, the other that it hardly
    pushes on. Straight lines push on three times as hard."""
    measured = sorted(
        co_contraction_stiffness(data.angles_deg, data.flexion_nm, data.extension_nm, 0.4)
        for data in MEASURED
    )
    straight, wrapped = (
        co_contraction_stiffness(ANGLES_DEG, test.flexion_nm, test.extension_nm, 0.4)
        for test in (run_isometric_test(), run_isometric_test(wrapped=True))
    )
    assert measured == pytest.approx([-4.0, 2.1], abs=0.1)
    assert measured[0] < wrapped < measured[1]
    assert straight > 3.0 * measured[1]


def test_a_line_is_its_own_co_contraction_stiffness() -> None:
    slope = 3.0 / np.radians(100.0)
    found = co_contraction_stiffness([20.0, 120.0], [10.0, 20.0], [-5.0, -12.0], 0.5)
    assert found == pytest.approx(0.5 * slope)


def test_wrapping_halves_the_distance_to_the_measured_torques_and_leaves_flexion_alone() -> None:
    straight, wrapped = run_isometric_test(), run_isometric_test(wrapped=True)
    distances = []
    for test in (straight, wrapped):
        gaps = [
            test.extension_nm[angle] - torque
            for data in MEASURED
            for angle, torque in zip(data.angles_deg, data.extension_nm, strict=True)
            if angle <= 130
        ]
        distances.append(np.sqrt(np.mean(np.square(gaps))))
    assert distances[1] < 0.5 * distances[0]
    assert wrapped.flexion_nm[:100] == pytest.approx(straight.flexion_nm[:100], abs=0.1)
