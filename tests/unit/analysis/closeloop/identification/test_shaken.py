"""Nothing that only passes the motion on is named for what oscillates by itself."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import Model, evaluate
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from analysis.closeloop.identification.balance.terms import Candidate
from analysis.closeloop.identification.findings import Grown
from analysis.closeloop.identification.growing.shaken import shaken
from analysis.closeloop.identification.growing.steps import grow
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.rich import ELBOW, rich_recording

NOISE = 0.02
#: Hz, and how far it moves the joint, rad.
TREMOR, MOVED = 5.0, 2e-3


def trembling(
    moved: float = MOVED, reach: float = 0.4, beside: float = 0.0
) -> tuple[Recording, np.ndarray]:
    """Return an elbow that a tremor moves beside its task, and its acceleration by the tremor.

    The shoulder is moved that many times as far.
    """
    recording = rich_recording(10)
    time, w = recording.time, 2 * np.pi * TREMOR
    scale = reach / 0.4
    middle = np.array([-0.5, 1.0])
    only = moved * np.array([beside, 1.0])
    wave, rate = np.sin(w * time)[:, None], np.cos(w * time)[:, None]
    return replace(
        recording,
        position=middle + scale * (recording.position - middle) + only * wave,
        velocity=scale * recording.velocity + only * w * rate,
        acceleration=scale * recording.acceleration - only * w**2 * wave,
        joints=(ELBOW,),
        cache={},
    ), -moved * w**2 * wave[:, 0]


def rows_of(recording: Recording, extra: np.ndarray) -> Rows:
    """Return the rows of a recording whose elbow needs a further torque."""
    effort = np.array(recording.inverse)
    effort[:, ELBOW] += extra + NOISE * np.random.default_rng(4).standard_normal(len(effort))
    measured = replace(recording, effort=recording.filtered(effort), cache={})
    return select_rows(measured, (0,)).reweighted({ELBOW: NOISE})


def of(rows: Rows) -> set[int]:
    model = Model(rows.recording)
    return set(shaken(model, evaluate(model, rows), rows))


def test_a_line_that_the_motion_hardly_has_shakes_the_joint() -> None:
    recording, quick = trembling()
    assert of(rows_of(recording, 0.2 * quick)) == {ELBOW}


@pytest.mark.parametrize(
    ("moved", "reach"),
    [(0.0, 0.01), (0.02, 0.01), (0.02, 0.3)],
    ids=["nothing", "a joint that is shaken on purpose", "a loop that rings"],
)
def test_what_the_motion_explains_does_not_shake_it(moved: float, reach: float) -> None:
    recording, quick = trembling(moved, reach)
    assert of(rows_of(recording, 0.2 * quick)) == set()


def test_an_effect_of_all_the_motion_does_not_shake_it() -> None:
    recording, _ = trembling()
    assert of(rows_of(recording, 0.5 * recording.velocity[:, ELBOW])) == set()


@pytest.mark.parametrize(("tremor", "found"), [(0.0, ["added_inertia"]), (1.0, [])])
def test_no_inertia_is_named_for_a_tremor_and_the_answer_to_it(
    tremor: float, found: list[str]
) -> None:
    recording, quick = trembling()
    inertia = 0.2 * (quick if tremor else recording.acceleration[:, ELBOW])
    rows = rows_of(recording, inertia)
    model = Model(rows.recording)
    score = evaluate(model, rows)
    tried = [
        Candidate(effect=BY_NAME[name], joint=ELBOW)
        for name in ("added_inertia", "time_delay", "series_elasticity")
    ]
    grown, refused = grow(Grown(model, score), rows, score, lambda _: None, tried)
    assert [step.key[0] for step in grown.steps] == found and refused is None


@pytest.mark.parametrize(
    ("beside", "tremor", "found"),
    [
        (-0.3, 1.0, []),
        # As by a rotor that the neighbour turns.
        (-0.3, 0.0, ["cross_joint_coupling"]),
    ],
)
def test_no_coupling_is_named_for_what_shakes_the_neighbour_too(
    beside: float, tremor: float, found: list[str]
) -> None:
    """Of three arms of an opponent that vibrate two had a coupling by the other's acceleration."""
    recording, quick = trembling(0.01, beside=beside)
    other = recording.acceleration[:, 1 - ELBOW]
    answer = np.roll(quick, 6) if tremor else other
    rows = rows_of(recording, 0.2 * answer)
    model = Model(rows.recording)
    score = evaluate(model, rows)
    tried = [Candidate(effect=BY_NAME["cross_joint_coupling"], joint=ELBOW)]
    grown, refused = grow(Grown(model, score), rows, score, lambda _: None, tried)
    assert [step.key[0] for step in grown.steps] == found and refused is None


@pytest.mark.parametrize("found", ["time_delay", "added_inertia"])
def test_what_makes_a_loop_ring_is_named(found: str) -> None:
    """The ringing holds most of what is missing, and less than half of what the motion needs.

    It takes all, and has the same size where nothing rings. (A load of the unkind bench.)
    """
    recording, _ = trembling(0.006)
    needed = recording.inverse[:, [ELBOW]]
    extra = {
        "time_delay": (recording.shifted(needed, 0.02) - needed)[:, 0],
        "added_inertia": 0.2 * recording.acceleration[:, ELBOW],
    }
    rows = rows_of(recording, extra[found])
    assert of(rows) == {ELBOW}
    model = Model(rows.recording)
    score = evaluate(model, rows)
    tried = [Candidate(effect=BY_NAME[name], joint=ELBOW) for name in extra]
    grown, _ = grow(Grown(model, score), rows, score, lambda _: None, tried)
    (step,) = grown.steps
    assert step.key[0] == found
    if found == "time_delay":
        assert step.taken.theta["delay"] == pytest.approx(0.02, rel=0.05)
