"""Wearers and conditions over their ranges, at the ends, and beyond what can be believed."""

from collections.abc import Mapping

import numpy as np
import pytest

from sim.assessment.validity import FAILURES
from sim.models import ELBOW
from sim.parameters.wearer import TABLE_1
from tests.testbed.assessments import LONG_HEAVY_STIFF, Assess


@pytest.mark.parametrize("corner", ["low", "high"])
def test_wearers_and_conditions_at_the_ends_of_each_range_can_be_assessed(
    assessed: Assess, corner: str
) -> None:
    for factor in ELBOW.factors:
        if factor.name == "integral_gain":
            # Equation 19 to the letter: the paper's muscles push the robot into its stop.
            continue
        assessment = assessed({factor.name: getattr(factor, corner)})
        assert assessment.outcome == "ok", (factor.name, assessment.reason)


def errors_over(
    assessed: Assess, name: str, points: int, quantity: str = "stiffness_error"
) -> tuple[np.ndarray, np.ndarray]:
    """Return values of a factor over its range, the others nominal, and their errors."""
    (factor,) = (factor for factor in TABLE_1 if factor.name == name)
    values = np.linspace(factor.low, factor.high, points)
    return values, np.array([assessed({name: float(x)}).outputs[quantity] for x in values])


def test_one_factor_at_a_time_behaves_as_the_paper_reports(assessed: Assess) -> None:
    """Upper arm mass next to nothing, lines over the forearm's, a bend over long upper arms."""
    masses, of_mass = errors_over(assessed, "forearm_mass", 5)
    assert np.corrcoef(masses, of_mass)[0, 1] ** 2 > 0.98
    lengths, of_length = errors_over(assessed, "forearm_length", 7)
    assert np.corrcoef(lengths, of_length)[0, 1] ** 2 > 0.9
    assert np.ptp(errors_over(assessed, "upper_arm_mass", 5)[1]) < 0.1 * np.ptp(of_mass)
    of_upper_arm = errors_over(assessed, "upper_arm_length", 5)[1]
    assert of_upper_arm[-1] < of_upper_arm[-2] < of_upper_arm[2]
    assert np.ptp(errors_over(assessed, "forearm_elasticity", 5)[1]) < 0.1 * np.ptp(of_upper_arm)


def test_softness_matters_little(assessed: Assess) -> None:
    """The authors' model: 0.4 Nm/rad, in their form, over the range of either elasticity."""
    for name in ("upper_arm_elasticity", "forearm_elasticity"):
        assert np.ptp(errors_over(assessed, name, 3, "stiffness_error_authors")[1]) < 0.4
        assert np.ptp(errors_over(assessed, name, 3)[1]) < 0.6


STILL_CREEPING = {
    "upper_arm_length": 0.2728,
    "forearm_length": 0.3455,
    "upper_arm_mass": 3.41,
    "forearm_mass": 1.82,
    "upper_arm_elasticity": 974.43,
    "forearm_elasticity": 974.43,
}

#: Of the nine wearers of the benchmark.
NOISIEST = {
    "upper_arm_length": 0.3744,
    "forearm_length": 0.3179,
    "upper_arm_mass": 2.4863,
    "forearm_mass": 0.1676,
    "upper_arm_elasticity": 819.9483,
    "forearm_elasticity": 473.2736,
}


def test_an_arm_that_still_creeps_after_the_hold_is_waited_for(assessed: Assess) -> None:
    """A heavy forearm on a short, stiff upper arm creeps until a ring of tissue lets go."""
    assert assessed(STILL_CREEPING).outcome == "ok"


def test_rounding_moves_no_result(assessed: Assess) -> None:
    """What contacts make of the last digits is what the solver leaves undone."""
    moved = {name: value * (1.0 + 1e-7) for name, value in NOISIEST.items()}
    errors = [assessed(values).outputs["stiffness_error"] for values in (NOISIEST, moved)]
    assert errors[0] == pytest.approx(errors[1], abs=1e-4)


@pytest.mark.parametrize(
    ("values", "options", "outcome"),
    [
        ({"upper_arm_length": 0.50}, {}, "penetrated"),
        ({"upper_arm_length": 0.22}, {}, "bottomed_out"),
        ({"forearm_length": 0.18}, {}, "slipped"),
        ({"forearm_length": 0.48, "extension_stop": 0.0}, {}, "human_joint_limit"),
        (
            {
                "cuff_friction": 2.0,
                "upper_arm_length": 0.41,
                "upper_arm_elasticity": 4000.0,
                "forearm_elasticity": 4000.0,
            },
            {},
            "jammed",
        ),
        ({"forearm_mass": 10.0}, {}, "tracking_lost"),
        ({"forearm_mass": 15.0}, {}, "motor_limit"),
        ({"upper_arm_elasticity": 1.0}, {}, "bottomed_out"),
        ({"forearm_elasticity": 1.0}, {}, "bottomed_out"),
        ({"cuff_friction": 0.0}, {}, "slipped"),
        ({"upper_arm_elasticity": 1e7}, {}, "diverged"),
        ({}, {"controller": "pd"}, "exo_joint_limit"),
    ],
)
def test_what_cannot_be_believed_is_a_named_outcome_with_its_state(
    assessed: Assess, values: Mapping[str, float], options: Mapping[str, str], outcome: str
) -> None:
    assessment = assessed(values, **options)  # type: ignore[arg-type]
    assert assessment.outcome == outcome
    assert outcome in FAILURES
    assert assessment.outputs == {}
    assert assessment.reason
    assert assessment.state is not None
    assert set(assessment.state) == {"time", "phase", "qpos", "qvel", "act"}


@pytest.mark.parametrize("upper_arm_mass", [0.3, 3.41])
@pytest.mark.parametrize(
    "condition",
    [{}, {"muscles": "physiological"}, {"muscles": "holzbaur2005"}],
)
def test_long_heavy_arms_are_kept_from_hyperextension(
    assessed: Assess, condition: dict[str, float | str], upper_arm_mass: float
) -> None:
    assessment = assessed({**LONG_HEAVY_STIFF, "upper_arm_mass": upper_arm_mass, **condition})
    assert assessment.outcome == "ok", assessment.reason


def test_the_stop_is_what_keeps_them_from_hyperextension(assessed: Assess) -> None:
    corner = {**LONG_HEAVY_STIFF, "upper_arm_mass": 0.3, "extension_stop": 0.0}
    assert assessed(corner).outcome == "human_joint_limit"


def test_an_extension_stop_acts_on_nobody_who_does_not_reach_it(assessed: Assess) -> None:
    short = {"forearm_length": 0.2827}
    assert assessed({**short, "extension_stop": 60.0}).outputs == assessed(short).outputs
