"""K_h with an interval, on a bank without a simulation."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from analysis.interpretation.answer import Question, interpret
from analysis.interpretation.bank.bank import with_zero_errors
from analysis.interpretation.errors import InterpretationError
from analysis.interpretation.inference import interpreter as learning
from analysis.interpretation.inference.features import RECORDED
from analysis.interpretation.inference.interpreter import Interpreter, Known
from analysis.interpretation.inference.rounding import ALLOWED, moved_by_rounding
from analysis.interpretation.inference.rows import targets_of
from analysis.interpretation.inference.view import View
from analysis.interpretation.plan import half_width_after, parts, shortest_plan, steps
from analysis.interpretation.recording import Recording
from sim.assessment.summary import Motion
from sim.models import WINDOWS
from sim.robot.device import NESM
from tests.testbed.bank import bank, samples


@pytest.fixture(scope="module")
def interpreter() -> Interpreter:
    return Interpreter.read(bank())


FRESH = samples(2, 200)
TRUTH = targets_of(FRESH)
RECORDINGS = FRESH.of(*RECORDED)


def tape(row: int, sd: float = 0.002) -> tuple[Known, ...]:
    return (Known(name="forearm_length", value=float(FRESH.factors[row, 0]), sd=sd),)


@pytest.mark.parametrize("look", [Interpreter.look, Interpreter.look_by_sets])
def test_intervals_hold_the_truth_as_often_as_they_say(
    interpreter: Interpreter, look: Callable[[Interpreter, np.ndarray], View]
) -> None:
    ranks = np.array(
        [
            interpreter.infer(look(interpreter, recorded)).rank(truth)
            for recorded, truth in zip(RECORDINGS, TRUTH, strict=True)
        ]
    )
    inside = np.mean((ranks > 0.05) & (ranks < 0.95), axis=0)
    assert inside[:2] == pytest.approx([0.9, 0.9], abs=0.07)
    assert np.mean(ranks[:, 0] < 0.5) == pytest.approx(0.5, abs=0.1)


def test_what_is_measured_on_the_patient_narrows_the_interval_and_moves_it_to_the_truth(
    interpreter: Interpreter,
) -> None:
    rows = range(60)
    views = [interpreter.look(RECORDINGS[row]) for row in rows]
    before = [interpreter.infer(view) for view in views]
    after = [interpreter.infer(view, tape(row)) for row, view in zip(rows, views, strict=True)]
    # Half a unit of K per sd of length is what the recording does not show.
    assert before[0].half_width() == pytest.approx(1.645 * 0.5, rel=0.25)
    assert np.mean([one.half_width() for one in after]) < 0.4 * before[0].half_width()
    errors = [abs(one.centre[0] - TRUTH[row, 0]) for row, one in zip(rows, after, strict=True)]
    assert np.mean(errors) < 0.25
    inside = [0.05 < one.rank(TRUTH[row])[0] < 0.95 for row, one in zip(rows, after, strict=True)]
    assert np.mean(inside) > 0.78


def test_what_is_known_must_go_with_the_recording(interpreter: Interpreter) -> None:
    column = interpreter.population.names.index("forearm_mass")
    contrary = []
    for row in range(60):
        right = Known(name="forearm_mass", value=float(FRESH.factors[row, column]), sd=0.02)
        found, limit, _ = interpreter.surprise(interpreter.look(RECORDINGS[row]), (right,))
        contrary.append(found > limit)
    assert np.mean(contrary) < 0.06
    # A recording that shows the mass to a hundredth of that, and a wearer of whom another is known.
    view = interpreter.look(RECORDINGS[0])
    sure = replace(view, covariance=1e-4 * view.covariance)
    other = Known(name="forearm_mass", value=1.45, sd=0.02)
    length = Known(name="forearm_length", value=0.3, sd=0.05)
    found, limit, worst = interpreter.surprise(sure, (length, other))
    assert found > limit and worst == 1


def test_errors_are_sized_by_how_long_an_arm_is_told_to_be(
    interpreter: Interpreter, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = len(interpreter.local.expected.unit)
    monkeypatch.setattr(learning, "SIZED_BY", ("forearm_length", "length_of_nobody"))
    told = Interpreter.fit(bank())
    assert told.any_muscles is not None
    assert len(told.local.expected.unit) == plain + 1
    assert len(told.any_muscles.of_others.unit) == plain + 1
    for view in (told.look(RECORDINGS[0]), told.look_by_sets(RECORDINGS[0])):
        assert told.infer(view).half_width() > 0.0


@pytest.mark.parametrize("length", [0.251, 0.3, 0.349])
def test_the_half_width_to_expect_comes_wherever_in_its_range_a_factor_is_read(
    interpreter: Interpreter, length: float
) -> None:
    for row in range(10):
        view = interpreter.look(RECORDINGS[row])
        (step, *_) = steps(interpreter, ())
        said = half_width_after(interpreter, view, (), (step,))
        read = Known(name=step.factor, value=length, sd=step.to)
        assert interpreter.infer(view, (read,)).half_width() == pytest.approx(said)


def test_the_interval_is_made_of_what_is_not_known(interpreter: Interpreter) -> None:
    shares = parts(interpreter, interpreter.look(RECORDINGS[0]), ())
    assert next(iter(shares)) == "forearm_length"
    assert shares["forearm_length"] > 0.6
    assert sum(shares.values()) == pytest.approx(1.0, abs=1e-6)
    left = parts(interpreter, interpreter.look(RECORDINGS[0]), tape(0))
    assert left["forearm_length"] < 0.2


def test_the_plan_is_the_shortest_that_is_enough(interpreter: Interpreter) -> None:
    view = interpreter.look(RECORDINGS[0])
    offered = steps(interpreter, ())
    found = shortest_plan(interpreter, view, (), offered, 0.4)
    assert found is not None
    done, width = found
    assert [step.factor for step in done] == ["forearm_length"]
    assert width <= 0.4
    assert shortest_plan(interpreter, view, (), offered, 0.001) is None


def test_what_is_known_well_enough_is_not_offered_again(interpreter: Interpreter) -> None:
    assert [step.factor for step in steps(interpreter, tape(0))] == ["forearm_mass"]
    assert len(steps(interpreter, tape(0, sd=0.01))) == 2


@pytest.mark.parametrize(
    ("known", "sentence"),
    [
        (Known(name="weather", value=1.0, sd=1.0), "there is no 'weather' to be known"),
        (Known(name="muscles", value=1.0, sd=1.0), "muscles is a choice"),
        (
            Known(name="forearm_length", value=0.9, sd=0.01),
            "cannot be 0.9 m: .* 0.25 to 0.35 m, and a reading may be 2 standard deviations beyond",
        ),
        (
            Known(name="forearm_mass", value=0.96, sd=1e300),
            r"forearm_mass to 1e\+300 kg says nothing: .* it is 0.5 to 1.5 kg; leave it out",
        ),
    ],
)
def test_what_cannot_be_known_is_one_sentence(
    interpreter: Interpreter, known: Known, sentence: str
) -> None:
    with pytest.raises(InterpretationError, match=sentence):
        interpreter.infer(interpreter.look(RECORDINGS[0]), (known,))


def test_a_recording_like_the_banks_is_familiar_and_one_unlike_them_is_not(
    interpreter: Interpreter,
) -> None:
    own = interpreter.features.scaled(RECORDINGS)
    called = [interpreter.familiarity.distance(one) > interpreter.familiarity.limit for one in own]
    assert np.mean(called) <= 0.08
    odd = interpreter.features.scaled(samples(3, 20, strange=0.02).of(*RECORDED))
    for one in odd:
        assert interpreter.familiarity.distance(one) > interpreter.familiarity.limit
    assert interpreter.familiarity.strangest(odd[0]) == "the elbow's angle over time"


def moved(velocity: float) -> Recording:
    """Return a movement of J4, whose velocity is `velocity` times the slope of its angle."""
    time = np.linspace(0.0, 6.0, 601)
    phase = np.clip((time - 2.0) / 2.0, 0.0, 1.0)
    theta, slope = np.zeros((601, 4)), np.zeros((601, 4))
    theta[:, 3] = 1.9 - 0.875 * (1.0 - np.cos(np.pi * phase))
    slope[:, 3] = -0.4375 * np.pi * np.sin(np.pi * phase)
    motion = Motion(
        time=time, theta=theta, velocity=velocity * slope, torque=np.zeros_like(theta), joint=3
    )
    return Recording(source="a.npz", device="nesm", motion=motion)


def test_a_velocity_that_is_not_the_angles_slope_is_not_familiar_and_named() -> None:
    made = bank()
    scale = made.fitted["features.scale"].copy()
    scale[0, RECORDED.index("affine_damping")] = -1.0
    damped = replace(made, fitted={**made.fitted, "features.scale": scale})
    found = interpret(damped, Question(recording=moved(2.0)))
    assert not found["familiar"]
    assert "velocity is not the slope of its angle over time: it is 2.00 times" in found["why_not"]
    assert "velocity" not in interpret(damped, Question(recording=moved(1.0)))["why_not"]


@pytest.mark.parametrize("joint", [0, 1, 2, 3])
def test_an_offset_of_a_torque_is_not_familiar_and_named(
    interpreter: Interpreter, joint: int
) -> None:
    own = interpreter.features.scaled(RECORDINGS)
    called = [interpreter.familiarity.offset(one) is not None for one in own]
    assert np.mean(called) <= 0.06
    errors = 3.0 * np.eye(4)[[joint]]
    (odd,) = interpreter.features.scaled(with_zero_errors(RECORDINGS[:1], errors))
    found = interpreter.familiarity.offset(odd)
    assert found is not None
    assert found[0] == joint + 1
    unit = interpreter.features.scale[1, WINDOWS * (joint + 1)]
    assert -found[1] * unit == pytest.approx(3.0, rel=0.2)


def test_an_offset_of_the_moved_joints_angle_is_not_familiar_and_named() -> None:
    made = bank()
    interpreter = Interpreter.read(made)
    odd = RECORDINGS[0].copy()
    odd[:WINDOWS] += 10.0 * interpreter.features.scale[1, 0]
    found = interpreter.familiarity.offset(interpreter.features.scaled(odd[None])[0])
    assert found is not None
    assert found[0] == 0
    assert found[1] == pytest.approx(10.0, rel=0.2)


def recording(device: str) -> Recording:
    time = np.linspace(0.0, 6.0, 100)
    one = np.zeros((100, 1))
    motion = Motion(time=time, theta=one, velocity=one, torque=one, joint=0)
    return Recording(source="a.npz", device=device, motion=motion)


def test_another_device_is_not_familiar_and_says_no_more_than_the_population() -> None:
    found = interpret(bank(), Question(recording=recording("elbow_orthosis"), tolerance=0.2))
    assert not found["familiar"]
    assert "elbow_orthosis" in found["why_not"]
    low, high = found["stiffness"]["interval90"]
    assert (low, high) == pytest.approx((1.25, 5.75), abs=0.2)
    assert found["tolerance"]["inside"] is False
    assert found["tolerance"]["why_no_plan"].startswith("the recording is not familiar")


def test_a_bank_with_too_few_contacts_says_no_more_than_the_population() -> None:
    few = replace(bank(), contact=samples(3, 59))
    found = interpret(few, Question(recording=recording("nesm"), tolerance=0.2))
    assert not found["familiar"]
    assert "59 recordings with contact, too few" in found["why_not"]
    assert "60 or more --contact-rows" in found["advice"][0]
    low, high = found["stiffness"]["interval90"]
    assert (low, high) == pytest.approx((1.25, 5.75), abs=0.2)
    assert found["tolerance"]["inside"] is False


@pytest.mark.parametrize(
    ("asked", "sentence"),
    [
        ({"tolerance": 0.0}, "a tolerance is positive"),
        ({"known": (Known(name="a", value=1.0, sd=0.0),)}, "a positive standard deviation"),
        ({"known": (Known(name="a", value=1.0, sd=1.0),) * 2}, "known twice"),
    ],
)
def test_a_question_that_means_nothing_is_one_sentence(asked: dict, sentence: str) -> None:
    with pytest.raises(InterpretationError, match=sentence):
        Question(recording=recording("nesm"), **asked)


def test_steps_of_a_torque_move_k_by_what_it_rests_on_that_torque(
    interpreter: Interpreter,
) -> None:
    def moved(*steps: float) -> float:
        return moved_by_rounding(interpreter, bank(), np.array(steps))

    assert moved(0.0, 0.0, 0.0, 0.0) == 0.0
    # K is the slope of the elbow's torque over 1.75 rad.
    small, fine, coarse = (moved(0.0, 0.0, 0.0, step) for step in (0.1, 0.2, 2.0))
    assert fine < ALLOWED < coarse
    assert 1.2 * small < fine < 3.0 * small


def held(motion: Motion) -> Motion:
    """Return a movement with the other joints where an assessment holds them."""
    theta = motion.theta.copy()
    theta[:, :3] = NESM.start("elbow").angles[:3]
    return replace(motion, theta=theta)


def quiet() -> Recording:
    """Return a familiar movement with some torque."""
    own = moved(1.0)
    torque = np.random.default_rng(4).normal(0.0, 0.01, own.motion.theta.shape)
    return replace(own, motion=replace(own.motion, torque=torque + 4.0 * own.motion.theta))


def named(**changes: object) -> dict:
    """Return the answer to a familiar movement with some torque, changed."""
    return interpret(bank(), Question(recording=replace(quiet(), **changes)))


def test_first_is_said_what_rests_on_no_set_of_muscles_and_so_is_what_to_measure_next(
    interpreter: Interpreter,
) -> None:
    found, values = named(), quiet().values()
    views = (interpreter.look(values), interpreter.look_by_sets(values))
    first, by_sets = (interpreter.infer(view) for view in views)
    assert found["muscle_model"] == "any"
    assert found["half_width"] == pytest.approx(first.half_width())
    assert found["damping"]["median"] == pytest.approx(first.quantiles(np.array([0.5]))[0, 1])
    beside = found["if_muscles_of_bank"]
    assert beside["half_width"] == pytest.approx(by_sets.half_width())
    assert {"stiffness", "damping", "stiffness_over_angle"} <= set(beside)
    (length,) = (step for step in steps(interpreter, ()) if step.factor == "forearm_length")
    said = found["next"][0]
    assert said["factor"] == "forearm_length"
    after = half_width_after(interpreter, views[0], (), (length,))
    assert said["half_width_after"] == pytest.approx(after)
    assert said["do"] == "measure forearm_length to 0.002 m: tape"


def test_a_bank_of_one_set_of_muscles_says_that_its_answer_rests_on_it() -> None:
    own = bank()
    column = own.population.names.index("muscles")
    one = replace(own, bushing=own.bushing.some(own.bushing.factors[:, column] == 0.0))
    found = interpret(one, Question(recording=quiet()))
    assert (found["muscle_model"], found["if_muscles_of_bank"]) == ("the bank's", None)


def test_a_torque_in_steps_that_move_k_is_not_familiar_and_says_which_steps_are() -> None:
    own = held(moved(1.0).motion)
    torque = np.random.default_rng(4).normal(0.0, 0.01, own.theta.shape)
    torque[:, 3] = 2.0 * np.round(4.0 * own.theta[:, 3] / 2.0)
    found = named(motion=replace(own, torque=torque))
    assert "the torque of J4 is recorded in steps of 2 Nm, which move K" in found["why_not"]
    # A held joint whose torque never leaves a small step is none for that reason.
    torque[:, 3] = 0.02 * np.round(4.0 * own.theta[:, 3] / 0.02)
    torque[:, 1] = 3.0
    assert "steps" not in named(motion=replace(own, torque=torque))["why_not"]


def test_another_declared_robot_is_not_familiar_and_says_why() -> None:
    found = named(differs="the mass of the link of J4 is 2 kg, not 0.494, by r.xml")
    assert "is not the bank's nesm: the mass of the link of J4 is 2 kg" in found["why_not"]
    assert found["familiar"] is False and found["next"] == []


def test_a_declared_load_is_not_familiar_unless_the_bank_has_it() -> None:
    asked = Question(recording=replace(quiet(), loads=("payload",)))
    found = interpret(bank(), asked)
    assert found["familiar"] is False
    assert "the session declares payload" in found["why_not"]
    assert "record without it, or build a bank that has it" in found["why_not"]
    people = replace(bank().population, fixed={"effect.payload.mass": 0.5})
    loaded = interpret(replace(bank(), population=people), asked)
    assert loaded["why_not"] == interpret(bank(), Question(recording=quiet()))["why_not"]


def test_a_declared_low_pass_is_not_familiar_if_a_second_one_moves_k() -> None:
    plain = named()["why_not"]
    assert named(effort_filter_hz=20.0)["why_not"] == plain
    found = named(effort_filter_hz=0.3)
    assert "the torques are behind a low-pass of 0.3 Hz, which moves K by" in found["why_not"]


def test_what_was_replaced_or_left_out_is_said_and_too_much_of_it_is_strange() -> None:
    found = named(replaced={"torque of J4": 1}, unused=("subject",))
    replaced, unused = found["advice"][:2]
    assert replaced.endswith("by the median: 1 of the torque of J4")
    assert unused.startswith("subject of session.json: not used here")
    found = named(replaced={"torque of J4": 7})
    assert found["why_not"] == "7 samples of the torque of J4 are far from their neighbours"
