"""A name that does not hold at every frequency is the controller's answer, not the robot's."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import Candidate, Channel, Model, evaluate
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.findings import Option, Step
from analysis.closeloop.identification.growing import Grown
from analysis.closeloop.identification.holding import held_in_octaves
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.rich import ELBOW

DELAY = 0.02


def moving(recording: Recording, late: tuple[float, float]) -> Recording:
    """Return a recording that moves slowly and trembles; each part has its own delay, s."""
    time = recording.time
    slow = 0.4 * np.sin(2 * np.pi * 0.6 * time)
    quick = 0.01 * np.sin(2 * np.pi * 5.0 * time)
    parts = []
    for own in (slow, quick):
        position = np.array(recording.position)
        position[:, 0], position[:, ELBOW] = 0.0, own
        velocity = np.gradient(position, time, axis=0)
        acceleration = np.gradient(velocity, time, axis=0)
        parts.append((position, velocity, acceleration))
    whole = [one + other for one, other in zip(*parts, strict=True)]
    names = ("position", "velocity", "acceleration")
    recording = replace(
        recording, joints=(ELBOW,), cache={}, **dict(zip(names, whole, strict=True))
    )
    calm = replace(recording, cache={}, **dict(zip(names, parts[0], strict=True)))
    first = calm.inverse
    rest = recording.inverse - first
    effort = sum(recording.shifted(x, s) for x, s in zip((first, rest), late, strict=True))
    noise = 0.01 * np.random.default_rng(1).standard_normal(effort.shape)
    return replace(recording, effort=recording.filtered(effort + noise), cache={})


@pytest.mark.parametrize(
    ("late", "stays"), [((DELAY, DELAY), True), ((0.0, DELAY), False), ((DELAY, 0.0), False)]
)
def test_a_delay_is_named_only_if_it_is_the_same_at_every_frequency(
    late: tuple[float, float], stays: bool, recording: Recording
) -> None:
    trembling = moving(recording, late)
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
