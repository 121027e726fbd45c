"""The bench that is not kind: what it draws, what its laws do, and how it judges."""

import json
from dataclasses import asdict, replace
from itertools import pairwise

import numpy as np
import pytest

from benchmarks.closeloop.unkind.cases import SEEDS, TURNS, Case, draw, from_json, named, to_json
from benchmarks.closeloop.unkind.chain import TIMINGS, logged, stamps
from benchmarks.closeloop.unkind.faults import ARM, ELBOW, GROUPS, OUTSIDE, SCALED, Fault
from benchmarks.closeloop.unkind.judge import Outcome, from_line
from benchmarks.closeloop.unkind.laws import Bristles, friction_level
from benchmarks.closeloop.unkind.search import fooled, simpler
from benchmarks.closeloop.unkind.session import effort_noise
from benchmarks.closeloop.unkind.simulate import Bench, Trial
from benchmarks.closeloop.unkind.sizing import shown
from benchmarks.closeloop.unkind.table import right, wilson


def outcome(**values: object) -> Outcome:
    known = {
        "case": "tuning:limb:0", "world": "limb", "kind": "one", "sensor": "hobby",
        "timing": "dropped", "share": 0.1, "truth": (("drift", "elbow"),), "weak": False,
        "verdict": "effect_found", "names": (("drift", "elbow"),), "returned": ("drift",),
        "before": 0.1, "after": 0.01, "covered": True, "pushes": 0, "found_pushes": 0,
        "gain": 1.0, "seconds": 1.0,
    }  # fmt: skip
    return Outcome(**{**known, **values})  # type: ignore[arg-type]


@pytest.mark.parametrize("world", TURNS)
def test_a_case_is_drawn_from_its_name_alone(world: str) -> None:
    assert named(f"tuning:{world}:3") == draw("tuning", world, 3)


def test_seeds_for_reporting_are_none_of_those_for_tuning() -> None:
    for one, other in pairwise(sorted(SEEDS.values())):
        assert other - one >= 1_000_000
    assert draw("tuning", "limb", 3).robot != draw("reporting", "limb", 3).robot


@pytest.mark.parametrize("name", ["tuning:limb", "tuning:leg:3", "other:limb:3", "tuning:limb:x"])
def test_a_wrong_name_is_refused_in_one_sentence(name: str) -> None:
    with pytest.raises(ValueError, match="is no case"):
        named(name)


@pytest.mark.parametrize("number", range(10))
def test_a_case_is_the_same_after_json(number: int) -> None:
    case = draw("tuning", "arm", number)
    assert from_json(json.loads(json.dumps(to_json(case)))) == case


def test_every_fault_has_a_size_that_can_grow() -> None:
    assert set(SCALED) == {*ELBOW, *ARM, *OUTSIDE}


@pytest.mark.parametrize("number", range(40))
def test_no_two_faults_of_a_joint_do_the_same(number: int) -> None:
    case = draw("tuning", "arm" if number % 2 else "limb", number)
    for group in GROUPS:
        here = [fault.joint for fault in case.faults if fault.name in group]
        assert len(here) == len(set(here))


@pytest.mark.parametrize("timing", TIMINGS)
def test_a_logger_keeps_stamps_in_order(timing: str) -> None:
    chain = replace(draw("tuning", "limb", 0).chain, timing=timing, share=0.008)
    rng = np.random.default_rng(1)
    taken, said = stamps(chain, 6.0, rng)
    lines = logged(chain, np.stack([said, taken], axis=1), rng)
    steps = np.diff(lines[:, 0])
    assert np.all(steps >= 0)
    assert (timing == "duplicated") == bool(np.any(steps == 0))


@pytest.mark.parametrize("sensor", [2, 5, 13])
def test_noise_is_as_strong_as_its_share(sensor: int) -> None:
    chain = replace(draw("tuning", "limb", sensor).chain, noise=0.02)
    noise = effort_noise(chain, 10.0, 20_000, np.random.default_rng(2))
    assert np.std(noise) == pytest.approx(0.2, rel=0.1)


def test_bristles_give_way_first_and_slide_then() -> None:
    bristles = Bristles(0.002)
    torques = [bristles.torque(3.0, 0.1, 0.002) for _ in range(400)]
    assert -1.0 < torques[0] < 0.0
    assert torques[-1] == pytest.approx(-3.0)


def test_stribeck_friction_falls_from_its_static_level_with_speed() -> None:
    values = {"coulomb": 1.0, "static": 2.0, "velocity": 0.1}
    fault = Fault(name="stribeck_friction", joint="elbow", values=values, size=3.0)
    assert friction_level(fault, 0.0, 0.0, 0.0) == pytest.approx(6.0)
    assert friction_level(fault, 0.0, 1.0, 0.0) == pytest.approx(3.0)


@pytest.fixture(scope="module")
def arm() -> Case:
    case = draw("tuning", "arm", 0)
    return replace(case, faults=(), declared={}, plans=(replace(case.plans[0], seconds=0.8),))


def test_a_device_as_declared_leaves_nothing(arm: Case) -> None:
    bench = Bench(arm)
    trial = bench.run(arm.plans[0], 0.0, {})
    assert np.max(np.abs(bench.missing(trial))) < 1e-6 * np.max(np.abs(trial.effort))


def test_what_a_faulty_device_leaves_is_the_fault(arm: Case) -> None:
    fault = Fault(name="torque_offset", joint="joint_1", values={"torque": 0.7})
    bench = Bench(replace(arm, faults=(fault,)))
    missing = bench.missing(bench.run(arm.plans[0], 0.0, {}))
    assert missing[:, 0] == pytest.approx(0.7, abs=1e-6)
    assert np.max(np.abs(missing[:, 1:])) < 1e-6


def test_an_outcome_is_the_same_after_json() -> None:
    assert from_line(json.loads(json.dumps(asdict(outcome())))) == outcome()


def test_a_name_beside_the_true_one_is_wrong_and_fools() -> None:
    both = outcome(names=(("drift", "elbow"), ("backlash", "elbow")))
    assert right(outcome()) and not right(both)
    assert fooled(both) and not fooled(outcome(names=(), verdict="unexplained"))


def test_a_push_without_its_time_is_not_right() -> None:
    push = outcome(kind="push", truth=(), names=(), verdict="unexplained", pushes=2)
    assert not right(push)
    assert right(replace(push, found_pushes=2))


def test_simpler_cases_are_other_cases() -> None:
    case = draw("tuning", "arm", 4)
    variants = [variant for _, variant in simpler(case)]
    assert len(variants) > 5
    assert case not in variants


def test_wilsons_interval_is_that_of_the_textbook() -> None:
    low, high = wilson(8, 10)
    assert (low, high) == (pytest.approx(0.541, abs=0.002), pytest.approx(0.931, abs=0.002))
    assert wilson(0, 5)[0] == 0.0


@pytest.mark.parametrize(("height", "chatter", "seen"), [(0.0, 1.0, 0.0), (2.0, 0.0, 2.0)])
def test_a_push_shows_as_far_as_its_motor_answers_it(
    height: float, chatter: float, seen: float
) -> None:
    """What a controller makes of its encoder's last digit is no answer."""
    time = np.arange(0.0, 4.0, 1e-3)
    answer = np.stack([height * (abs(time - 2.0) < 0.5), np.zeros(len(time))], axis=1)
    quick = chatter * np.sin(np.pi * time / 4.0) * np.sin(2 * np.pi * 60.0 * time)
    quick = quick[:, None] * [1.0, 0.0]
    zero = np.zeros((len(time), 2))

    def trial(effort: np.ndarray) -> Trial:
        return Trial(time=time, q=zero, v=zero, a=zero, effort=effort, known=zero)

    assert shown(trial(answer + quick), trial(zero), 0) == pytest.approx(seen, rel=0.2, abs=0.05)
