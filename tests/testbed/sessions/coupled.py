"""A robot of three joints without a limb whose every joint moves in two frequencies."""

from dataclasses import replace

import numpy as np

from analysis.closeloop.identification.arms.robot import traced_robot, weighed
from analysis.closeloop.identification.balance.model import Model, evaluate, unfitted
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.findings import Step
from analysis.closeloop.session.contents import Trial
from analysis.closeloop.session.recording import Recording
from tests.testbed.sessions.rich import swung

#: Two hinges that gravity loads, and a slide along the first's axis, which it does not.
CHAIN = """<mujoco><worldbody>
<body name="one"><joint name="a" axis="0 1 0"/><geom size=".05" pos=".1 0 0"/>
<body name="two" pos=".2 0 0"><joint name="b" axis="0 1 0"/><geom size=".05" pos=".1 0 0"/>
<body name="three" pos=".2 0 0">
<joint name="c" type="slide" axis="0 1 0"/><geom size=".05" pos=".1 0 0"/>
</body></body></body></worldbody></mujoco>"""
NOISE = 0.002


def moving(chain: str = CHAIN) -> Recording:
    """Return the robot in motion, 20 s; in one frequency, acceleration is position."""
    plain = swung(chain, (0.2, 0.4, -0.3), (0.7, 0.4, 0.55), 20, rate=100.0)
    session = replace(plain.session, limb_joints=())
    w = 2 * np.pi * np.array([1.31, 1.73, 1.13])
    angle = plain.time[:, None] * w
    return replace(
        plain,
        session=session,
        position=plain.position + 0.1 * np.sin(angle),
        velocity=plain.velocity + 0.1 * w * np.cos(angle),
        acceleration=plain.acceleration - 0.1 * w**2 * np.sin(angle),
        cache={},
    )


def in_trials(moves: np.ndarray) -> Recording:
    """Return the robot in trials of equal length, a group each.

    Args:
        moves: whether each joint moves in each trial, (trials, joints).
    """
    whole = moving()
    trial = np.arange(len(whole.time)) * len(moves) // len(whole.time)
    names = [f"t{number}.csv" for number in range(len(moves))]
    trials = tuple(Trial(file=name, label=name, group=name, role="fit") for name in names)
    return replace(
        whole,
        session=replace(whole.session, trials=trials),
        slices=[slice(*np.flatnonzero(trial == n)[[0, -1]] + [0, 1]) for n in range(len(moves))],
        trial=trial,
        position=np.where(moves[trial], whole.position, 0.3),
        velocity=whole.velocity * moves[trial],
        acceleration=whole.acceleration * moves[trial],
        fit_trials=tuple(range(len(moves))),
        cache={},
    )


def measured(recording: Recording, effort: np.ndarray, noise: float = NOISE) -> Recording:
    """Return the recording with a noisy effort, low-passed for the fit."""
    loud = effort + noise * np.random.default_rng(4).standard_normal(effort.shape)
    return replace(recording, effort=recording.filtered(loud), unfiltered=loud, cache={})


def traced(recording: Recording) -> dict[tuple[str, int], Step]:
    """Return what is found, by effect and joint."""
    rows = select_rows(recording, (0,))
    found = traced_robot(Model(recording), weighed(Model(recording), rows), lambda _: None)
    return {step.key: step for step in found.steps}


def values(step: Step, recording: Recording) -> dict[str, float]:
    """Return the parameters of an effect that was found."""
    candidate, model = step.taken.candidate, step.taken.model
    score = evaluate(model, select_rows(recording, (0,)))
    for term, own in model.split(score.coefficients):
        if term.candidate == candidate:
            read = candidate.effect.readings(unfitted(recording, candidate.joint), term.theta)
            found = dict(zip(term.kept, own.tolist(), strict=True))
            return {name: float(r.of(found)) for name, r in read.items() if r.columns <= set(found)}
    raise AssertionError(candidate.key)
