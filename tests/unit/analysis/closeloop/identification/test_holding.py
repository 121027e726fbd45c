"""A name that does not hold at every frequency is the controller's answer, not the robot's."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from analysis.closeloop.identification import holding, parameters
from analysis.closeloop.identification.balance.declared import PLACED
from analysis.closeloop.identification.balance.model import Model, evaluate, unfitted
from analysis.closeloop.identification.balance.regression import Score, select_rows
from analysis.closeloop.identification.balance.terms import Candidate, Channel, Term
from analysis.closeloop.identification.findings import Grown, Option, Step
from analysis.closeloop.identification.holding import (
    determined,
    held_in_octaves,
    in_plainest_form,
    passive,
    sized,
)
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME, OF_ROBOTS
from sim.effects.effect import Columns
from tests.testbed.sessions.rich import ELBOW, rich_recording

DELAY = 0.02
INERTIA = 0.05

SLOW, QUICK = (0.4, 0.6), (0.01, 5.0)


def moving(
    recording: Recording,
    late: tuple[float, ...],
    sines: tuple[tuple[float, float], ...] = (SLOW, QUICK),
) -> Recording:
    """Return a recording that moves slowly and trembles; each part has its own delay, s.

    A part is an amplitude, rad, and a frequency, Hz; the first is the slow one.
    """
    time = recording.time
    parts = []
    for amplitude, hertz in sines:
        own = amplitude * np.sin(2 * np.pi * hertz * time)
        position = np.array(recording.position)
        position[:, 0], position[:, ELBOW] = 0.0, own
        velocity = np.gradient(position, time, axis=0)
        acceleration = np.gradient(velocity, time, axis=0)
        parts.append((position, velocity, acceleration))
    whole = [sum(signals) for signals in zip(*parts, strict=True)]
    names = ("position", "velocity", "acceleration")
    recording = replace(
        recording, joints=(ELBOW,), cache={}, **dict(zip(names, whole, strict=True))
    )
    # Of the first parts, then of one more, and so on: each less the one before is its own.
    sums = [[sum(own[: n + 1]) for own in zip(*parts, strict=True)] for n in range(len(parts))]
    inverse = [
        replace(recording, cache={}, **dict(zip(names, s, strict=True))).inverse for s in sums
    ]
    torques = [own - before for own, before in zip(inverse, [0.0, *inverse], strict=False)]
    effort = sum(recording.shifted(x, s) for x, s in zip(torques, late, strict=True))
    noise = 0.01 * np.random.default_rng(1).standard_normal(effort.shape)
    return replace(recording, effort=recording.filtered(effort + noise), cache={})


@pytest.mark.parametrize(
    ("late", "sines", "stays"),
    [
        ((DELAY, DELAY), (SLOW, QUICK), True),
        ((0.0, DELAY), (SLOW, QUICK), False),
        ((DELAY, 0.0), ((0.6, 1.5), (0.005, 5.0)), False),
        # What little there is just below the cutoff is what smoothing the positions made of it.
        ((DELAY, DELAY, -DELAY), (SLOW, (0.01, 6.0), (0.0003, 9.0)), True),
    ],
)
def test_a_delay_is_named_only_if_it_is_the_same_at_every_frequency(
    late: tuple[float, ...],
    sines: tuple[tuple[float, float], ...],
    stays: bool,
    recording: Recording,
) -> None:
    trembling = moving(recording, late, sines)
    rows = select_rows(trembling, (0,))
    candidate = Candidate(effect=BY_NAME["time_delay"], joint=ELBOW)
    channel = Channel(candidate=candidate, theta={"delay": DELAY})
    model = Model(trembling, channels=(channel,))
    score = evaluate(model, rows)
    option = Option(candidate=candidate, model=model, score=score, gain=1.0, z=9.0)
    step = Step(taken=option, equals=(), options=(), before=2.0)
    found, notes = held_in_octaves(Grown(model, score, (step,)), rows)
    assert bool(found.steps) is stays
    assert ("time_delay of elbow is not added" in " ".join(notes)) is not stays


@pytest.mark.parametrize("stays", [True, False])
def test_inertia_is_named_only_if_the_slow_motion_feels_it_too(
    stays: bool, recording: Recording
) -> None:
    trembling = moving(recording, (0.0, 0.0))
    amplitude, hertz = QUICK
    pulse = 2 * np.pi * hertz
    quick = -amplitude * pulse**2 * np.sin(pulse * trembling.time)
    felt = trembling.acceleration[:, ELBOW] if stays else quick
    effort = np.array(trembling.effort)
    effort[:, ELBOW] += trembling.filtered(INERTIA * felt[:, None])[:, 0]
    trembling = replace(trembling, effort=effort, cache={})
    rows = select_rows(trembling, (0,))
    candidate = Candidate(effect=BY_NAME["added_inertia"], joint=ELBOW)
    columns = candidate.effect.columns(unfitted(trembling, ELBOW), {})
    term = Term(
        effect=candidate.effect, joint=ELBOW, columns=columns, kept=(0,), candidate=candidate
    )
    model = Model(trembling, terms=(term,))
    score = evaluate(model, rows)
    found, notes = held_in_octaves(Grown(model, score, (added(candidate, model, score),)), rows)
    assert bool(found.steps) is stays and len(notes) == (not stays)


def rubs(recording: Recording) -> tuple[Recording, Columns]:
    """Return a recording whose elbow has Coulomb friction of 0.3 Nm, and the columns of that."""
    columns = BY_NAME["coulomb_friction"].columns(unfitted(recording, ELBOW), {"smooth": 0.02})
    effort = recording.effort + recording.filtered(0.3 * columns[ELBOW])
    return replace(recording, effort=effort, cache={}), columns


@pytest.mark.parametrize("damped", [True, False])
def test_damping_beside_friction_stays_where_every_joint_has_some(
    damped: bool, recording: Recording
) -> None:
    trembling, columns = rubs(moving(recording, (0.0, 0.0), (SLOW, (0.03, 5.0))))
    amplitude, hertz = SLOW
    pulse = 2 * np.pi * hertz
    effort = np.array(trembling.effort)
    # The slow motion alone feels it.
    slow = amplitude * pulse * np.cos(pulse * trembling.time)
    effort[:, ELBOW] += trembling.filtered(0.5 * slow[:, None])[:, 0]
    trembling = replace(trembling, effort=effort, cache={})
    rows = select_rows(trembling, (0,))
    friction, viscous = (
        Candidate(effect=BY_NAME[name], joint=ELBOW)
        for name in ("coulomb_friction", "viscous_friction")
    )
    terms = tuple(
        Term(effect=one.effect, joint=ELBOW, columns=own, kept=(0,), candidate=one)
        for one, own in (
            (friction, columns),
            (viscous, viscous.effect.columns(unfitted(trembling, ELBOW), {})),
        )
    )
    model = Model(trembling, terms=terms)
    score = evaluate(model, rows)
    steps = tuple(added(one, model, score) for one in (friction, viscous))
    found, notes = held_in_octaves(Grown(model, score, steps), rows, damped=damped)
    assert [step.key[0] for step in found.steps] == ["coulomb_friction", "viscous_friction"][
        : 1 + damped
    ]
    assert len(notes) == (not damped)


def test_what_only_made_up_for_an_effect_goes_with_it(recording: Recording) -> None:
    """A delay that answered a vibration left a damping of -0.02 Nm s/rad behind."""
    rubbing, rubbed = rubs(moving(recording, (0.0, 0.0)))
    rows = select_rows(rubbing, (0,))
    friction, damping, delay = (
        Candidate(effect=BY_NAME[name], joint=ELBOW)
        for name in ("coulomb_friction", "viscous_friction", "time_delay")
    )
    damped = damping.effect.columns(unfitted(rubbing, ELBOW), {})
    terms = tuple(
        Term(effect=one.effect, joint=ELBOW, columns=columns, kept=(0,), candidate=one)
        for one, columns in ((friction, rubbed), (damping, damped))
    )
    channel = Channel(candidate=delay, theta={"delay": DELAY})
    model = Model(rubbing, terms=terms, channels=(channel,))
    score = evaluate(model, rows)
    steps = tuple(added(candidate, model, score) for candidate in (friction, damping, delay))
    found, notes = held_in_octaves(Grown(model, score, steps), rows, damped=True)
    assert [step.key[0] for step in found.steps] == ["coulomb_friction"]
    assert "time_delay of elbow" in notes[0] and "do not miss it" in notes[1]


def added(candidate: Candidate, model: Model, score: Score) -> Step:
    option = Option(candidate=candidate, model=model, score=score, gain=1.0, z=9.0)
    return Step(taken=option, equals=(), options=(), before=2.0)


def test_a_delay_that_was_chosen_beside_what_has_gone_is_chosen_anew(recording: Recording) -> None:
    """A lag that stood beside a spring fell with it, though most of the residual was a lag's."""
    late = moving(recording, (DELAY, DELAY))
    rows = select_rows(late, (0,))
    candidate = Candidate(effect=BY_NAME["time_delay"], joint=ELBOW)
    model = Model(late, channels=(Channel(candidate=candidate, theta={"delay": -DELAY}),))
    score = evaluate(model, rows)
    found = holding._chosen_again(Grown(model, score), candidate, rows)
    (channel,) = found.model.channels
    assert channel.theta["delay"] == pytest.approx(DELAY, rel=0.05)
    assert found.score.sse < 0.1 * score.sse


@pytest.mark.parametrize(("true", "stays"), [(DELAY, True), (0.0, False)])
def test_what_may_be_nothing_within_its_interval_is_not_named(
    true: float, stays: bool, recording: Recording
) -> None:
    late = moving(recording, (true, true))
    rows = select_rows(late, (0,))
    delay, friction = (
        Candidate(effect=BY_NAME[name], joint=ELBOW) for name in ("time_delay", "coulomb_friction")
    )
    rubbing, columns = rubs(late)
    term = Term(effect=friction.effect, joint=ELBOW, columns=columns, kept=(0,), candidate=friction)
    # So short a delay is what noise makes of none.
    channel = Channel(candidate=delay, theta={"delay": true or 1e-5})
    rows = replace(rows, recording=rubbing, stacked={})
    model = Model(rubbing, terms=(term,), channels=(channel,))
    score = evaluate(model, rows)
    steps = tuple(added(candidate, model, score) for candidate in (delay, friction))
    found, notes = determined(Grown(model, score, steps), rows)
    assert [step.key[0] for step in found.steps] == ["time_delay"] * stays + ["coulomb_friction"]
    assert len(notes) == (not stays) and all("may be zero" in note for note in notes)


@pytest.mark.parametrize(("damping", "stays"), [(0.3, True), (-0.3, False)])
def test_what_has_a_size_that_cannot_be_answered_something_else(
    damping: float, stays: bool, recording: Recording
) -> None:
    """A limb softened by more than its whole stiffness, where it met a bump (a stranger's)."""
    moved = moving(recording, (0.0, 0.0))
    candidate = Candidate(effect=BY_NAME["viscous_friction"], joint=ELBOW)
    columns = candidate.effect.columns(unfitted(moved, ELBOW), {})
    effort = moved.effort + moved.filtered(damping * columns[ELBOW])
    dragged = replace(moved, effort=effort, cache={})
    rows = select_rows(dragged, (0,))
    term = Term(
        effect=candidate.effect, joint=ELBOW, columns=columns, kept=(0,), candidate=candidate
    )
    model = Model(dragged, terms=(term,))
    score = evaluate(model, rows)
    found, notes = sized(Grown(model, score, (added(candidate, model, score),)), rows)
    assert bool(found.steps) is stays
    assert ("its size may be any" in " ".join(notes)) is not stays


@pytest.mark.parametrize(
    ("sizes", "stays"),
    [
        ({"scale": (0.3, 0.5), "shape": (-9.0, 9.0)}, True),
        ({"scale": (-0.1, 0.5), "shape": (-9.0, 9.0)}, False),
        ({"scale": (-0.1, 0.5), "shape": (0.1, 0.9)}, True),
    ],
)
def test_one_size_that_is_sure_is_enough(
    sizes: dict[str, tuple[float, float]],
    stays: bool,
    recording: Recording,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    moved = moving(recording, (0.0, 0.0))
    rows = select_rows(moved, (0,))
    candidate = Candidate(effect=BY_NAME["time_delay"], joint=ELBOW)
    model = Model(moved, channels=(Channel(candidate=candidate, theta={"delay": DELAY}),))
    score = evaluate(model, rows)
    told = {
        name: {"value": sum(ends) / 2, "ci90": ends, "free": ends, "limits": (-1.0, 1.0)}
        for name, ends in sizes.items()
    }
    effect = SimpleNamespace(coefficients=tuple(sizes))
    part = SimpleNamespace(at=SimpleNamespace(effect=effect))
    monkeypatch.setattr(parameters, "part_of", lambda *_: part)
    monkeypatch.setattr(parameters, "parameters_of", lambda *_: told)
    found, _ = sized(Grown(model, score, (added(candidate, model, score),)), rows)
    assert bool(found.steps) is stays


@pytest.mark.parametrize(("mass", "stays"), [(0.3, True), (0.0, False)])
def test_a_load_without_a_mass_is_none_wherever_it_hangs(mass: float, stays: bool) -> None:
    recording = rich_recording(10)
    theta = {"position_x": 0.1, "position_y": 0.0, "position_z": 0.0}
    columns = PLACED.columns(unfitted(recording, ELBOW), theta)
    load = Candidate(effect=PLACED, joint=ELBOW)
    term = Term(
        effect=PLACED,
        joint=ELBOW,
        columns=columns,
        lower=PLACED.lower,
        kept=(0,),
        theta=theta,
        candidate=load,
    )
    own = {joint: mass * column[:, 0] for joint, column in columns.items()}
    # A little less than nothing, so that the mass is held at zero.
    effort = np.array(recording.inverse)
    for joint, torque in own.items():
        effort[:, joint] += torque - 1e-3 * columns[joint][:, 0]
    recording = replace(recording, effort=recording.filtered(effort), cache={})
    rows = select_rows(recording, (0,))
    model = Model(recording, terms=(term,))
    score = evaluate(model, rows)
    found, notes = determined(Grown(model, score, (added(load, model, score),)), rows)
    assert bool(found.steps) == stays and len(notes) == (not stays)


def test_friction_whose_form_is_unsure_leaves_the_simple_one() -> None:
    rubbing, _ = rubs(moving(rich_recording(10), (0.0, 0.0)))
    rows = select_rows(rubbing, (0,))
    richer = Candidate(effect=BY_NAME["asymmetric_friction"], joint=ELBOW)
    columns = richer.effect.columns(unfitted(rubbing, ELBOW), {"smooth": 0.02, "viscous": 0.0})
    # Only the difference of the levels, which is none.
    term = Term(effect=richer.effect, joint=ELBOW, columns=columns, kept=(1,), candidate=richer)
    model = Model(rubbing, terms=(term,))
    score = evaluate(model, rows)
    found, notes = determined(Grown(model, score, (added(richer, model, score),)), rows)
    assert [step.key for step in found.steps] == [("coulomb_friction", ELBOW)]
    assert found.score.loss < 0.1 * score.loss and len(notes) == 1


@pytest.mark.parametrize(("most", "stays"), [(-0.05, False), (0.05, True)])
def test_a_delay_beside_which_a_limb_gives_energy_is_the_controller_s_answer(
    most: float, stays: bool, recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A tremor of 5.2 Hz was a delay of 33 ms, and the damping surely below none."""
    late = moving(recording, (DELAY, DELAY))
    rows = select_rows(late, (0,))
    candidate = Candidate(effect=BY_NAME["time_delay"], joint=ELBOW)
    model = Model(late, channels=(Channel(candidate=candidate, theta={"delay": DELAY}),))
    score = evaluate(model, rows)
    fits = SimpleNamespace(coefficients=[], interval=lambda found, value: (value - 0.1, most))
    monkeypatch.setattr(holding, "leave_out", lambda *_: fits)
    monkeypatch.setattr(holding, "_passes", lambda step, rows: True)
    monkeypatch.setattr(holding, "impedances", lambda *_: {ELBOW: {"damping": -0.1}})
    grown = Grown(model, score, (added(candidate, model, score),))
    found, notes = passive(grown, rows)
    assert bool(found.steps) is stays
    assert ("would give energy" in " ".join(notes)) is not stays


@pytest.mark.parametrize(
    ("cubic", "name"), [(0.0, "joint_stiffness"), (5.0, "nonlinear_stiffness")]
)
def test_a_spring_is_nonlinear_only_if_a_straight_one_predicts_worse(
    cubic: float, name: str, recording: Recording
) -> None:
    """What a neighbour's friction left was the cubic of a straight spring, (-0.05, 0.05)."""
    still = moving(recording, (0.0, 0.0))
    (effect,) = [one for one in OF_ROBOTS if one.name == "nonlinear_stiffness"]
    spring = Candidate(effect=effect, joint=ELBOW)
    columns = spring.effect.columns(unfitted(still, ELBOW), {"centre": 0.0})
    sizes = np.zeros(columns[ELBOW].shape[1])
    sizes[0], sizes[1] = cubic, 3.0
    effort = np.array(still.effort)
    effort[:, ELBOW] += still.filtered(columns[ELBOW] @ sizes[:, None])[:, 0]
    sprung = replace(still, effort=effort, cache={})
    rows = select_rows(sprung, (0,)).reweighted({ELBOW: 0.01})
    kept = tuple(range(len(sizes)))
    theta = {"centre": 0.0}
    term = Term(
        effect=spring.effect, joint=ELBOW, columns=columns, kept=kept, theta=theta, candidate=spring
    )
    model = Model(sprung, terms=(term,))
    score = evaluate(model, rows)
    found = in_plainest_form(Grown(model, score, (added(spring, model, score),)), rows)
    assert [step.key[0] for step in found.steps] == [name]
    assert [one.effect.name for one in found.model.effects] == [name]
