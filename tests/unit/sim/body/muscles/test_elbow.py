"""The sets of the elbow's muscles: levers, torques, passive stiffness beside published ones."""

from functools import cache

import mujoco
import numpy as np
import pytest

from benchmarks.simulation.co_contraction import COMMON_DEG, co_contraction_stiffness
from sim.body.muscles.attach import add_muscles
from sim.body.muscles.authors import PAPER_MUSCLES
from sim.body.muscles.elbow import ELBOW_MUSCLES
from sim.body.muscles.holzbaur import HOLZBAUR_MUSCLES
from sim.body.muscles.lengths import elbow_length_ranges, operating_range
from sim.body.muscles.muscle import ElbowMuscles
from sim.body.muscles.physiological import EXCURSION, FIBRE_LENGTHS, PHYSIOLOGICAL_MUSCLES
from sim.body.skeleton import HUMAN_JOINTS, add_arm, add_torso, empty_spec
from sim.parameters.wearer import NOMINAL_WEARER
from sim.validation.isometric import ANGLES_DEG, MEASURED, DataSet, run_isometric_test

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


def test_all_sets_are_of_the_same_muscles() -> None:
    for group in ("flexors", "extensors"):
        names = [
            [muscle.name for muscle in getattr(elbow, group).muscles]
            for elbow in ELBOW_MUSCLES.values()
        ]
        assert names[0] == names[1] == names[2]


def test_published_levers_are_those_of_the_published_model() -> None:
    """MyoSuite's copy of Holzbaur et al. 2005, m from the straight elbow to 120 degrees: what paths
    change by. The elbow's axis is tilted there, spheres at the elbow
    are cylinders here, the humerus is shorter, and the copy wraps each head of the biceps apart."""
    published = {
        "biceps_long": 0.0631,
        "biceps_short": 0.0503,
        "brachialis": 0.0371,
        "brachioradialis": 0.1147,
        "triceps_long": 0.0447,
        "triceps_medial": 0.0448,
        "triceps_lateral": 0.0448,
        "anconeus": 0.0239,
    }
    ranges = elbow_length_ranges(NOMINAL_WEARER, HOLZBAUR_MUSCLES)
    for name, excursion in published.items():
        shortest, longest = ranges[name]
        assert longest - shortest == pytest.approx(excursion, rel=0.15), name


def test_published_fibres_are_as_long_as_published() -> None:
    """Slack tendon plus fibre is the published path while the elbow is straight."""
    for group in (HOLZBAUR_MUSCLES.flexors, HOLZBAUR_MUSCLES.extensors):
        for muscle in group.muscles:
            assert muscle.fibres is not None
            ends = operating_range(muscle, group, HOLZBAUR_MUSCLES)
            straight = ends[1] if group is HOLZBAUR_MUSCLES.flexors else ends[0]
            length = muscle.fibres.slack + straight * muscle.fibres.optimal
            assert length == pytest.approx(muscle.fibres.extended)


def test_published_muscles_resist_where_the_papers_push_on() -> None:
    """Nothing is fitted to torques: both peaks are weaker and extension grows to the very end."""
    test = run_isometric_test(elbow=HOLZBAUR_MUSCLES)
    assert test.flexion_peak == pytest.approx((58.9, 79.0), abs=5.0)
    assert test.extension_peak[1] == ANGLES_DEG[-1]


def test_physiological_levers_are_those_measured_in_cadavers() -> None:
    """The fit of Pigeon, Yahia and Feldman 1996 (mm, degrees): 25 mm at 30 degrees, 16 at 120."""
    degrees = np.degrees(ANGLES)
    measured = np.polyval(
        [-3.5171e-9, 1.3277e-6, -1.9092e-4, 1.2886e-2, -3.0284e-1, -23.287], degrees
    )
    for name in FIBRE_LENGTHS:
        lever = 1e3 * levers(PHYSIOLOGICAL_MUSCLES)[name]
        assert lever == pytest.approx(-measured, abs=3.8), name
        assert lever[degrees >= 20.0] == pytest.approx(-measured[degrees >= 20.0], abs=1.5), name


def test_physiological_levers_are_those_measured_in_living_arms() -> None:
    """Sugisaki et al. 2010, magnetic resonance: 24 (sd 1.4) mm at 30 degrees, 17 (1.3) at 110."""
    lever = levers(PHYSIOLOGICAL_MUSCLES)["triceps_lateral"]
    assert lever[6] == pytest.approx(0.0239, abs=0.0014)
    assert lever[22] == pytest.approx(0.0174, abs=0.0013)


def test_straight_levers_vanish_as_the_elbow_flexes() -> None:
    straight = levers(PAPER_MUSCLES)
    assert straight["triceps_long"][-1] < 0.0, "the long head would flex"
    assert straight["triceps_lateral"].max() > 0.028 > 0.006 > straight["triceps_lateral"][-1]


def test_the_excursion_is_the_integral_of_the_lever() -> None:
    upto = np.searchsorted(ANGLES, np.radians(121.0))
    lever = levers(PHYSIOLOGICAL_MUSCLES)["triceps_lateral"][:upto]
    assert np.trapezoid(lever, dx=np.radians(5.0)) == pytest.approx(EXCURSION, abs=0.0005)


def test_physiological_extension_peaks_within_both_data_sets_of_figure_3() -> None:
    torque, angle = run_isometric_test(elbow=PHYSIOLOGICAL_MUSCLES).extension_peak
    assert torque == pytest.approx(-50.0, rel=0.05)
    first, last = sorted(data.peak_angle_deg("extension") for data in MEASURED)
    assert first <= angle <= last


def test_a_triceps_round_the_elbow_halves_the_distance_to_the_measured_extension() -> None:
    distances = []
    for elbow in (PAPER_MUSCLES, PHYSIOLOGICAL_MUSCLES):
        test = run_isometric_test(elbow=elbow)
        gaps = [
            test.extension_nm[angle] - torque
            for data in MEASURED
            for angle, torque in zip(data.angles_deg, data.extension_nm, strict=True)
            if angle <= 130
        ]
        distances.append(np.sqrt(np.mean(np.square(gaps))))
    assert distances[1] < 0.55 * distances[0]


def test_co_contraction_is_within_what_the_experiments_allow() -> None:
    """K_h without movement lies inside the slopes of one experiment's flexors beside one
    experiment's extensors, whichever muscles; the paper's at their very end."""
    slopes = sorted(
        co_contraction_stiffness(COMMON_DEG, *on_common_angles(flexion, extension), 0.4)
        for flexion in MEASURED
        for extension in MEASURED
    )
    assert slopes == pytest.approx([-10.0, -4.0, 2.1, 8.2], abs=0.15)
    for elbow, expected in zip(ELBOW_MUSCLES.values(), (8.0, 0.3, -0.9), strict=True):
        test = run_isometric_test(elbow=elbow)
        ours = co_contraction_stiffness(ANGLES_DEG, test.flexion_nm, test.extension_nm, 0.4)
        assert slopes[0] < ours < slopes[-1]
        assert ours == pytest.approx(expected, abs=0.3)


def test_a_line_is_its_own_co_contraction_stiffness() -> None:
    slope = 3.0 / np.radians(100.0)
    found = co_contraction_stiffness([20.0, 120.0], [10.0, 20.0], [-5.0, -12.0], 0.5)
    assert found == pytest.approx(0.5 * slope)


def test_a_relaxed_elbow_is_as_stiff_as_measured_ones_with_physiological_muscles() -> None:
    """Wiegner and Watts 1986: 0.4 to 1.8 Nm/rad in 19 subjects, at rest near 107 degrees."""
    stiffness, at_rest = [], []
    for elbow in (PAPER_MUSCLES, PHYSIOLOGICAL_MUSCLES):
        passive = run_isometric_test(elbow=elbow).passive_nm
        stiffness.append(-(passive[107] - passive[20]) / np.radians(87.0))
        at_rest.append(np.abs(passive[107:]).max())
    assert 0.4 < stiffness[1] < 1.8 < 3.0 < stiffness[0]
    assert at_rest[1] < 0.1
