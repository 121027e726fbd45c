"""A joint that rubs more than the bank's is strange, whatever the muscles."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from analysis.interpretation.bank.population import default_population, population_of
from analysis.interpretation.friction import break_away, most_friction, rubs
from sim.assessment.assess import assess
from sim.assessment.summary import Motion, motion_of
from sim.robot.device import NESM, load_device

POPULATION = default_population()
DEVICE = load_device(NESM.name)


@cache
def moved(friction: float, activation: float = 0.05) -> Motion:
    values = {"activation": activation, "robot_friction": friction, "passive_stiffness": 4.0}
    found = assess(values, fidelity="bushing").record
    assert found is not None
    return motion_of(found)


def noisy(motion: Motion) -> Motion:
    """Return a motion as sensors show it that see 0.5 mrad, 0.01 rad/s and 0.2 Nm."""
    rng = np.random.default_rng(51)

    def off(array: np.ndarray, by: float) -> np.ndarray:
        return array + by * rng.standard_normal(array.shape)

    return replace(
        motion,
        theta=off(motion.theta, 0.0005),
        velocity=off(motion.velocity, 0.01),
        torque=off(motion.torque, 0.2),
    )


def held_first(motion: Motion) -> Motion:
    """Return a motion before which the arm was held for 3 s."""
    step = motion.time[1] - motion.time[0]
    earlier = motion.time[0] - step * np.arange(round(3.0 / step), 0, -1)

    def held(array: np.ndarray) -> np.ndarray:
        return np.vstack([np.tile(array[0], (len(earlier), 1)), array])

    return replace(
        motion,
        time=np.concatenate([earlier, motion.time]),
        theta=held(motion.theta),
        velocity=np.vstack([np.zeros((len(earlier), 4)), motion.velocity]),
        torque=held(motion.torque),
    )


def begun_late(motion: Motion) -> Motion:
    """Return a motion of which the first 0.39 s were not recorded."""
    kept = slice(26, None)
    return Motion(
        time=motion.time[kept],
        theta=motion.theta[kept],
        velocity=motion.velocity[kept],
        torque=motion.torque[kept],
        joint=motion.joint,
    )


@pytest.mark.parametrize("spoilt", [lambda motion: motion, noisy, held_first, begun_late])
@pytest.mark.parametrize("activation", [0.02, 0.3])
def test_friction_beyond_the_banks_is_seen_and_named(
    spoilt: Callable[[Motion], Motion], activation: float
) -> None:
    said = rubs(spoilt(moved(2.8, activation)), DEVICE, POPULATION)
    assert said is not None
    assert "Nm to break the moved joint away" in said and "(up to 0.5 Nm)" in said
    for friction in (0.0, 0.5):
        assert rubs(spoilt(moved(friction, activation)), DEVICE, POPULATION) is None


def test_breaking_away_takes_the_joints_friction() -> None:
    more = break_away(moved(2.8), DEVICE) - break_away(moved(0.0), DEVICE)
    assert more == pytest.approx(2.8, abs=0.4)


def test_a_stiff_relaxed_or_offset_arm_is_no_friction() -> None:
    motion = moved(0.0, 0.3)
    assert break_away(motion, DEVICE) < 0.3
    offset = replace(motion, torque=motion.torque + 4.0)
    assert break_away(offset, DEVICE) == pytest.approx(break_away(motion, DEVICE))


def test_few_samples_show_no_friction_and_no_error() -> None:
    motion = moved(2.8)
    few = Motion(
        time=motion.time[::40],
        theta=motion.theta[::40],
        velocity=motion.velocity[::40],
        torque=motion.torque[::40],
        joint=motion.joint,
    )
    assert break_away(few, DEVICE) < break_away(motion, DEVICE)


def test_friction_that_the_population_has_is_familiar() -> None:
    content = POPULATION.content
    factors = {n: e for n, e in content["factors"].items() if n != "robot_friction"}
    fixed = population_of({**content, "factors": factors, "fixed": {"robot_friction": 2.8}}, "it")
    assert most_friction(fixed) == 2.8
    assert rubs(moved(2.8), DEVICE, fixed) is None
    rubbed = {**content, "fixed": {"effect.coulomb_friction.torque": 2.8}}
    assert most_friction(population_of(rubbed, "it")) is None
    none = population_of({**content, "factors": factors}, "it")
    assert most_friction(none) == 0.0
