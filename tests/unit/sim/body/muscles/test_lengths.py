"""Lengths of muscles follow the wearer's bones."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sim.body.muscles.attach import add_muscles
from sim.body.muscles.elbow import PAPER_MUSCLES, REFITTED_MUSCLES
from sim.body.muscles.lengths import elbow_length_ranges
from sim.body.muscles.muscle import ElbowMuscles
from sim.body.skeleton import (
    add_arm,
    add_torso,
    empty_spec,
)
from sim.parameters.wearer import NOMINAL_WEARER


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
