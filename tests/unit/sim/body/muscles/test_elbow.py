"""The two fits of the elbow's muscles: levers, torques, passive stiffness beside published ones."""

from functools import cache

import mujoco
import numpy as np
import pytest

from sim.body.muscles.attach import add_muscles
from sim.body.muscles.elbow import (
    EXCURSION,
    FIBRE_LENGTHS,
    PAPER_MUSCLES,
    REFITTED_MUSCLES,
)
from sim.body.muscles.muscle import ElbowMuscles
from sim.body.skeleton import HUMAN_JOINTS, add_arm, add_torso, empty_spec
from sim.parameters.wearer import NOMINAL_WEARER
from sim.validation.isometric import (
    ANGLES_DEG,
    COMMON_DEG,
    MEASURED,
    DataSet,
    co_contraction_stiffness,
    run_isometric_test,
)

ANGLES = np.radians(np.arange(0.0, 131.0, 5.0))


@cache
def levers(elbow: ElbowMuscles) -> dict[str, np.ndarray]:
    """Return each extensor's lever about the elbow (m, positive extends) over ANGLES."""
    spec = empty_spec()
    add_torso(spec)
    add_arm(spec, NOMINAL_WEARER)
    add_muscles(spec, NOMINAL_WEARER, elbow=elbow)
    model = spec.compile()
    data = mujoco.MjData(model)
    joint = model.joint(HUMAN_JOINTS[3])
    data.qvel[joint.dofadr[0]] = 1.0
    names = [muscle.name for muscle in elbow.extensors.muscles]
    found = []
    for angle in ANGLES:
        data.qpos[joint.qposadr[0]] = angle
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        found.append([data.ten_velocity[model.tendon(name).id] for name in names])
    return dict(zip(names, np.transpose(found), strict=True))


def on_common_angles(flexion: DataSet, extension: DataSet) -> tuple[np.ndarray, np.ndarray]:
    """Return flexion torque of one experiment and extension torque of one over COMMON_DEG, Nm."""
    return (
        np.interp(COMMON_DEG, flexion.angles_deg, flexion.flexion_nm),
        np.interp(COMMON_DEG, extension.angles_deg, extension.extension_nm),
    )


def test_both_fits_are_of_the_same_muscles() -> None:
    for group in ("flexors", "extensors"):
        paper, refitted = (
            [(muscle.name, muscle.force) for muscle in getattr(fit, group).muscles]
            for fit in (PAPER_MUSCLES, REFITTED_MUSCLES)
        )
        assert paper == refitted


def test_refitted_levers_are_those_measured_in_cadavers() -> None:
    """The fit of Pigeon, Yahia and Feldman 1996 (mm, degrees): 25 mm at 30 degrees, 16 at 120."""
    degrees = np.degrees(ANGLES)
    measured = np.polyval(
        [-3.5171e-9, 1.3277e-6, -1.9092e-4, 1.2886e-2, -3.0284e-1, -23.287], degrees
    )
    for name in FIBRE_LENGTHS:
        lever = 1e3 * levers(REFITTED_MUSCLES)[name]
        assert lever == pytest.approx(-measured, abs=3.2), name
        assert lever[degrees >= 50.0] == pytest.approx(-measured[degrees >= 50.0], abs=1.2), name


def test_refitted_levers_are_those_measured_in_living_arms() -> None:
    """Sugisaki et al. 2010, magnetic resonance: 24 (sd 1.4) mm at 30 degrees, 17 (1.3) at 110."""
    lever = levers(REFITTED_MUSCLES)["triceps_lateral"]
    assert lever[6] == pytest.approx(0.0239, abs=0.0014)
    assert lever[22] == pytest.approx(0.0174, abs=0.0013)


def test_straight_levers_vanish_as_the_elbow_flexes() -> None:
    straight = levers(PAPER_MUSCLES)
    assert straight["triceps_long"][-1] < 0.0, "the long head would flex"
    assert straight["triceps_lateral"].max() > 0.028 > 0.006 > straight["triceps_lateral"][-1]


def test_the_excursion_is_the_integral_of_the_lever() -> None:
    upto = np.searchsorted(ANGLES, np.radians(121.0))
    lever = levers(REFITTED_MUSCLES)["triceps_lateral"][:upto]
    assert np.trapezoid(lever, dx=np.radians(5.0)) == pytest.approx(EXCURSION, abs=0.0005)


def test_refitted_isometric_peaks_lie_within_both_data_sets_of_figure_3() -> None:
    test = run_isometric_test(elbow=REFITTED_MUSCLES)
    for (torque, angle), expected, name in (
        (test.flexion_peak, 80.0, "flexion"),
        (test.extension_peak, -50.0, "extension"),
    ):
        assert torque == pytest.approx(expected, rel=0.05)
        first, last = sorted(data.peak_angle_deg(name) for data in MEASURED)
        assert first <= angle <= last


def test_refitting_halves_the_distance_of_extension_to_the_measured_torques() -> None:
    distances = []
    for elbow in (PAPER_MUSCLES, REFITTED_MUSCLES):
        test = run_isometric_test(elbow=elbow)
        gaps = [
            test.extension_nm[angle] - torque
            for data in MEASURED
            for angle, torque in zip(data.angles_deg, data.extension_nm, strict=True)
            if angle <= 130
        ]
        distances.append(np.sqrt(np.mean(np.square(gaps))))
    assert distances[1] < 0.5 * distances[0]


def test_refitted_co_contraction_pushes_on_within_what_the_experiments_allow() -> None:
    """K_h without movement is the paper's 6 Nm/rad, inside the slopes of one experiment's flexors
    beside one experiment's extensors."""
    slopes = sorted(
        co_contraction_stiffness(COMMON_DEG, *on_common_angles(flexion, extension), 0.4)
        for flexion in MEASURED
        for extension in MEASURED
    )
    test = run_isometric_test(elbow=REFITTED_MUSCLES)
    ours = co_contraction_stiffness(ANGLES_DEG, test.flexion_nm, test.extension_nm, 0.4)
    assert slopes == pytest.approx([-10.0, -4.0, 2.1, 8.2], abs=0.15)
    assert slopes[0] < ours < slopes[-1]
    assert ours == pytest.approx(6.0, abs=1.0)


def test_a_line_is_its_own_co_contraction_stiffness() -> None:
    slope = 3.0 / np.radians(100.0)
    found = co_contraction_stiffness([20.0, 120.0], [10.0, 20.0], [-5.0, -12.0], 0.5)
    assert found == pytest.approx(0.5 * slope)


def test_a_relaxed_elbow_is_as_stiff_as_measured_ones_once_refitted() -> None:
    """Wiegner and Watts 1986: 0.4 to 1.8 Nm/rad in 19 subjects, at rest near 107 degrees."""
    stiffness, at_rest = [], []
    for elbow in (PAPER_MUSCLES, REFITTED_MUSCLES):
        passive = run_isometric_test(elbow=elbow).passive_nm
        stiffness.append(-(passive[107] - passive[20]) / np.radians(87.0))
        at_rest.append(np.abs(passive[107:]).max())
    assert 0.4 < stiffness[1] < 1.8 < 3.0 < stiffness[0]
    assert at_rest[1] < 0.1
