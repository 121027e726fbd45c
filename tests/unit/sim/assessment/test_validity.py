"""Every detector fires on its own kind of failure and on nothing else."""

import numpy as np
import pytest
from numpy.typing import ArrayLike

from sim.assessment.validity import (
    FAILURES,
    HOLD_BOUNDS,
    Bound,
    Postures,
    check_outcome,
    check_posture,
    check_start,
    first_failure,
)
from sim.interface.interface import OF_ELEMENTS, Loads

ANGLES = {"exo_angle": np.radians(60.0), "human_angle": np.radians(65.0)}
LOADS = {
    "penetration": [-0.01, -0.02],
    "overhang": [-0.05, -0.06],
    "normal_force": 500.0,
    "roll": [0.05, 0.05],
    "slide": [0.0, 0.5],
    "tissue_left": [0.015, 0.012],
    "tissue_share": [0.8, 0.7],
    "strap_tension": [30.0, 0.0],
    "unheld": [0.0, 0.002],
}
STEPS = 10


def movement(**changes: ArrayLike) -> Postures:
    """Return ten plausible steps, with some quantities changed in all of them or step by step."""

    def steps(name: str, plausible: ArrayLike) -> np.ndarray:
        shape = (STEPS, *np.shape(plausible))
        return np.broadcast_to(np.asarray(changes.get(name, plausible)), shape)

    return Postures(
        **{name: steps(name, value) for name, value in ANGLES.items()},
        exo_range=(np.radians(-20.0), np.radians(125.0)),
        human_range=(np.radians(-10.0), np.radians(145.0)),
        motor_share=steps("motor_share", 0.5),
        loads=Loads(
            contact_force=np.zeros((STEPS, 2)),
            **{name: steps(name, value) for name, value in LOADS.items()},
            **dict.fromkeys(OF_ELEMENTS, np.zeros((STEPS, 2))),
        ),
    )


def test_a_plausible_trial_passes_every_detector() -> None:
    assert check_posture(movement(), 0) is None
    assert check_start(human_speed=np.full(4, 0.01), exo_error=np.zeros(4)) is None
    assert check_outcome(tracking_rmse=0.11, r_squared=0.98) is None


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"human_angle": np.radians(101.0)}, "slipped"),
        ({"overhang": np.array([-0.05, 0.021])}, "slipped"),
        ({"penetration": np.array([0.006, -0.02])}, "penetrated"),
        ({"roll": np.radians([2.0, 21.0])}, "slipped"),
        ({"slide": np.array([0.0, 1.16])}, "slipped"),
        ({"unheld": np.array([0.005, 0.0])}, "strap_lost"),
        ({"tissue_left": np.array([0.015, 0.0019])}, "bottomed_out"),
        ({"tissue_share": np.array([0.09, 0.8])}, "bottomed_out"),
        ({"normal_force": 2500.0}, "jammed"),
        ({"motor_share": 1.0}, "motor_limit"),
        ({"human_angle": np.radians(-9.5), "exo_angle": 0.0}, "human_joint_limit"),
        ({"human_angle": np.radians(100), "exo_angle": np.radians(124.5)}, "exo_joint_limit"),
        ({"human_angle": float("nan")}, "diverged"),
        ({"normal_force": float("inf")}, "diverged"),
    ],
)
def test_a_posture_that_cannot_be_believed_has_a_name(
    change: dict[str, ArrayLike], name: str
) -> None:
    failure = check_posture(movement(**change), 0)
    assert failure is not None
    assert failure.name == name
    assert failure.name in FAILURES
    assert failure.reason


@pytest.mark.parametrize(
    ("speed", "error", "words"),
    [(0.06, 0.0, "moved at 0.060 rad/s"), (0.0, 0.03, "stood 1.7 degrees from its start")],
)
def test_a_start_that_is_not_reached_says_what_moved(
    speed: float, error: float, words: str
) -> None:
    failure = check_start(human_speed=np.full(4, speed), exo_error=np.full(4, error))
    assert failure is not None
    assert failure.name == "start_not_reached"
    assert words in failure.reason


@pytest.mark.parametrize(
    ("rmse", "r_squared", "name"),
    [(0.25, 0.99, "tracking_lost"), (0.2, 0.3, "ill_conditioned")],
)
def test_a_trial_that_explains_nothing_is_no_number(
    rmse: float, r_squared: float, name: str
) -> None:
    failure = check_outcome(tracking_rmse=rmse, r_squared=r_squared)
    assert failure is not None
    assert failure.name == name


def test_a_movement_fails_at_the_first_step_that_a_detector_fires_at() -> None:
    assert first_failure(movement()) is None
    force = np.full(10, 500.0)
    force[[4, 7]] = 2001.0, 9000.0
    angle = np.radians(np.linspace(60.0, 65.0, 10))
    angle[6] = np.nan
    found = first_failure(movement(normal_force=force, human_angle=angle))
    assert found is not None
    assert (found[0], found[1].name) == (4, "jammed")
    found = first_failure(movement(human_angle=angle))
    assert found is not None
    assert (found[0], found[1].name) == (6, "diverged")


@pytest.mark.parametrize("limb", [0, 1])
@pytest.mark.parametrize("bound", HOLD_BOUNDS, ids=lambda bound: bound.quantity)
def test_either_limb_can_end_a_movement(limb: int, bound: Bound) -> None:
    values = np.broadcast_to(np.array(LOADS[bound.quantity]), (STEPS, 2)).copy()
    assert first_failure(movement(**{bound.quantity: values})) is None
    values[3, limb] = bound.limit * (1.1 if bound.which == "at most" else 0.9)
    found = first_failure(movement(**{bound.quantity: values}))
    assert found is not None
    assert (found[0], found[1].name) == (3, bound.outcome)
    assert found[1].reason.startswith(("upper arm: ", "forearm: ")[limb])
