"""Lengths of muscles follow the wearer's bones."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sim.body.muscles import lengths as module
from sim.body.muscles.attach import add_muscles
from sim.body.muscles.authors import PAPER_MUSCLES
from sim.body.muscles.elbow import ELBOW_MUSCLES
from sim.body.muscles.lengths import elbow_length_ranges
from sim.body.muscles.muscle import ElbowMuscles
from sim.body.skeleton import (
    add_arm,
    add_torso,
    empty_spec,
)
from sim.parameters.wearer import NOMINAL_WEARER


def swept(elbow: ElbowMuscles) -> ElbowMuscles:
    """Return a set whose lengths are swept, whatever formulas it has."""
    flexors, extensors = (
        replace(group, muscles=tuple(replace(m, length_formulas=None) for m in group.muscles))
        for group in (elbow.flexors, elbow.extensors)
    )
    return ElbowMuscles(flexors=flexors, extensors=extensors)


def test_the_authors_fitted_formulas_are_what_their_paths_sweep() -> None:
    """Their affine formulas (facts of their nesm_with_simple_patient model); the heads of the
    biceps have other lengths at their shoulder's angle."""
    ranges, own = (
        elbow_length_ranges(NOMINAL_WEARER, elbow)
        for elbow in (PAPER_MUSCLES, swept(PAPER_MUSCLES))
    )
    for name, (shortest, longest) in ranges.items():
        assert (shortest, longest) == pytest.approx(own[name], abs=2.2e-3), name


def test_muscles_scale_with_the_bones() -> None:
    longer = replace(NOMINAL_WEARER, forearm_length=0.345)
    insertion = elbow_length_ranges(longer, PAPER_MUSCLES)["brachialis"]
    nominal = elbow_length_ranges(NOMINAL_WEARER, PAPER_MUSCLES)["brachialis"]
    assert insertion[0] < nominal[0] < nominal[1] < insertion[1]


@pytest.mark.parametrize("name", ELBOW_MUSCLES)
@pytest.mark.parametrize(("upper", "offset"), [(0.2728, 0.0), (0.3101, -0.0042), (0.3778, 0.01)])
def test_length_ranges_are_those_of_a_compiled_arm(upper: float, offset: float, name: str) -> None:
    elbow = swept(ELBOW_MUSCLES[name])
    wearer = replace(
        NOMINAL_WEARER, upper_arm_length=upper, forearm_length=0.3, elbow_offset=offset
    )
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
        found = np.array(lengths)[:, tendon]
        expected = (found.min(), found.max())
        assert ranges[model.tendon(tendon).name] == pytest.approx(expected, abs=1e-12)


def test_no_arm_is_compiled_for_a_wearer_whose_elbow_is_elsewhere(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A bank has thousands of them, each with an elbow of its own."""
    elbow = swept(PAPER_MUSCLES)
    first = elbow_length_ranges(replace(NOMINAL_WEARER, elbow_offset=0.003), elbow)
    monkeypatch.setattr(module, "empty_spec", lambda: pytest.fail("an arm is compiled again"))
    second = elbow_length_ranges(replace(NOMINAL_WEARER, elbow_offset=-0.003), elbow)
    assert first["brachialis"] != second["brachialis"]
