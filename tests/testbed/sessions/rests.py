"""A limb that moves, rests and moves again."""

from dataclasses import replace

import numpy as np

from analysis.closeloop.session.contents import DeclaredEffect
from analysis.closeloop.session.recording import Recording
from tests.testbed.sessions.rich import ELBOW, rich_recording

RATE = 100.0


def with_rests() -> Recording:
    """One to three strokes at a time, with rests of 0.2 to 3 s between, 16 s at 100 Hz."""
    rng = np.random.default_rng(5)
    place, strokes = 1.0, []
    while sum(map(len, strokes)) < 16 * RATE:
        for _ in range(rng.integers(1, 4)):
            goal = 1.0 + rng.uniform(0.3, 0.7) * (-1.0 if place > 1.0 else 1.0)
            share = np.linspace(0.0, 1.0, int(RATE * rng.uniform(0.6, 1.0)))
            strokes.append(place + (goal - place) * (10 * share**3 - 15 * share**4 + 6 * share**5))
            place = goal
        strokes.append(np.full(int(RATE * rng.choice([0.2, 1.0, 3.0])), place))
    elbow = np.concatenate(strokes)
    rich = rich_recording()
    q = np.column_stack([np.full(len(elbow), -0.5), elbow])
    v = np.gradient(q, 1.0 / RATE, axis=0)
    declared = (DeclaredEffect(effect="viscoelastic_joint", joint="elbow"),)
    return replace(
        rich,
        session=replace(rich.session, declared=declared),
        sampling=replace(rich.sampling, recorded=RATE, working=RATE),
        slices=[slice(0, len(q))],
        trial=np.zeros(len(q), dtype=int),
        time=np.arange(len(q)) / RATE,
        position=q,
        velocity=v,
        acceleration=np.gradient(v, 1.0 / RATE, axis=0),
        effort=np.zeros_like(q),
        measured=np.ones(len(q)),
        extra=np.empty((len(q), 0)),
        joints=(ELBOW,),
        cache={},
    )
