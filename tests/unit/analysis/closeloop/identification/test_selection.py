"""When a gain on rows that nothing was fitted to is no luck."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from analysis.closeloop.identification import selection
from analysis.closeloop.identification.balance.luck import (
    ALONE_Z,
    MIN_TORQUE,
    comes_in_time,
    more_than_luck,
)
from analysis.closeloop.identification.balance.model import Model
from analysis.closeloop.identification.balance.regression import Rows, Score, select_rows
from analysis.closeloop.identification.balance.terms import Candidate
from analysis.closeloop.identification.findings import Option
from analysis.closeloop.identification.selection import _worth
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.rich import ELBOW


def test_a_gain_that_every_second_shows_is_no_luck_from_six_seconds_on() -> None:
    folds = np.arange(6) % 3
    assert more_than_luck(np.full(6, 2.0), np.linspace(0.9, 1.1, 6), folds)
    assert not more_than_luck(np.full(5, 2.0), np.linspace(0.9, 1.1, 5), folds[:5])


def test_trials_without_motion_have_no_rows(recording: Recording) -> None:
    rows = select_rows(recording, ())
    assert not len(rows.weight) and not any(len(own) for own in rows.samples.values())
    assert rows.parts.keys() == set(recording.joints)
    assert not len(rows.reweighted({}).weight) and not rows.joints


def test_one_effect_alone_needs_less_than_the_best_of_many() -> None:
    """A fast second holds nearly all of what every second shows."""
    worse = np.array([100.0, *np.ones(13)])
    folds = np.arange(14) % 4
    assert more_than_luck(worse, 0.3 * worse, folds, ALONE_Z)
    assert not more_than_luck(worse, 0.3 * worse, folds)
    assert not more_than_luck(worse[:10], 0.3 * worse[:10], folds[:10], ALONE_Z)


@pytest.mark.parametrize(
    ("takes", "smoothing", "limbs", "worth"),
    [
        (0.95, 2.0, (), True),
        (0.95, 20.0, (), False),
        (0.7, 2.0, (), False),
        (0.7, 2.0, (0,), True),
        (0.7, 4.0, (0,), False),
        (0.2, 0.1, (0,), False),
    ],
    ids=[
        "nearly all",
        "no more than smoothing does",
        "a part",
        "much, of a limb",
        "hardly more than smoothing does, of a limb",
        "little, of a limb",
    ],
)
def test_little_torque_counts_if_it_takes_nearly_all_that_smoothing_does_not_or_much_of_a_limb_s(
    takes: float, smoothing: float, limbs: tuple[int, ...], worth: bool
) -> None:
    """Of a hundredth of what otherwise matters: backlash gives little torque, in its own form.

    And what a gain or a delay does goes into a limb's stiffness and damping, nearly all of it: K
    was a quarter too high (an opponent's).
    """
    losses = np.linspace(0.5, 1.5, 12)
    rows = SimpleNamespace(
        effort_power=lambda joint: 1000.0 / MIN_TORQUE**2,
        smoothing_power=lambda joint: smoothing,
        joints=(0,),
        joint_of_block=np.zeros(12, dtype=int),
        recording=SimpleNamespace(limbs=limbs),
        fold_of_block=np.arange(12) % 3,
    )
    score = SimpleNamespace(losses=(1.0 - takes) * losses)
    one = SimpleNamespace(joint=0, effect=SimpleNamespace(timed=False))
    gain = float((losses - score.losses).sum())
    option = SimpleNamespace(gain=gain, candidate=one, score=score)
    current, model = cast(Score, SimpleNamespace(losses=losses)), cast(Model, None)
    assert _worth(cast(Option, option), model, current, cast(Rows, rows), 0.0) is worth


#: Rows of a second, seconds, and those in which a limb lands.
SECOND, SECONDS, LANDS = 20, 24, (3, 9, 10, 17)


def jerks() -> np.ndarray:
    """Return a torque that jerks in a few seconds, (r,)."""
    torque = np.zeros(SECOND * SECONDS)
    for number, second in enumerate(LANDS):
        torque[SECOND * second + 3 * number :][:4] = (2.0, 1.0, -1.0, -2.0)
    return torque


def test_a_few_jerks_in_time_are_no_luck() -> None:
    noise = 0.1 * np.random.default_rng(1).standard_normal(SECOND * SECONDS)
    assert comes_in_time(jerks() + noise, jerks(), SECOND)
    assert not comes_in_time(np.roll(jerks(), 70) + noise, jerks(), SECOND)
    assert not comes_in_time(noise[:SECOND], jerks()[:SECOND], SECOND)


@pytest.mark.parametrize(
    ("timed", "late", "smoothing", "worth"),
    [
        (True, 0, 1.0, True),
        (False, 0, 1.0, False),
        (True, 70, 1.0, False),
        (True, 0, 1e3, False),
    ],
    ids=["in time", "at any time", "at other times", "no more than smoothing does"],
)
def test_jerks_of_the_size_and_at_the_times_that_a_law_says_are_no_luck(
    timed: bool, late: int, smoothing: float, worth: bool
) -> None:
    """Four seconds hold all of the gain: by the error of seconds it may be chance."""
    noise = 0.3 * np.random.default_rng(2).standard_normal(SECOND * SECONDS)
    left, block = jerks() + noise, np.repeat(np.arange(SECONDS), SECOND)
    none = np.zeros((len(left), 0))
    rows = SimpleNamespace(
        effort_power=lambda joint: 1e3 / MIN_TORQUE**2,
        smoothing_power=lambda joint: smoothing,
        fold_of_block=np.arange(SECONDS) // 6,
        joints=(0,),
        joint_of_block=np.zeros(SECONDS, dtype=int),
        recording=SimpleNamespace(limbs=()),
        parts={0: slice(0, len(left))},
    )
    worse, better = (np.bincount(block, own**2) for own in (left, noise))
    assert not more_than_luck(worse, better, rows.fold_of_block)
    model = SimpleNamespace(base=lambda rows: (none, None), target=lambda rows: left)
    option = SimpleNamespace(
        gain=float((worse - better).sum()),
        candidate=SimpleNamespace(joint=0, effect=SimpleNamespace(timed=timed)),
        model=SimpleNamespace(base=lambda rows: (np.roll(jerks(), late)[:, None], None)),
        score=SimpleNamespace(losses=better, coefficients=np.ones(1)),
    )
    current = cast(Score, SimpleNamespace(losses=worse, loss=float(worse.sum())))
    found = _worth(cast(Option, option), cast(Model, model), current, cast(Rows, rows), 0.0)
    assert found is worth


def test_smoothing_takes_more_of_a_quick_motion(recording: Recording) -> None:
    slow = select_rows(replace(recording, joints=(ELBOW,), cache={}), (0,))
    sampling = replace(recording.sampling, cutoff=0.2 * recording.sampling.cutoff)
    smoother = replace(recording, joints=(ELBOW,), sampling=sampling, cache={})
    # The same samples, as if a lower cutoff had been needed.
    coarse = replace(slow, recording=smoother, stacked={})
    assert 0.0 < 20.0 * slow.smoothing_power(ELBOW) < coarse.smoothing_power(ELBOW)


@pytest.mark.parametrize("closer", ["added_inertia", "torque_gain"])
def test_of_names_that_fit_alike_but_for_rounding_the_first_of_the_catalogue_is_said(
    closer: str, recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Which of a gain and an inertia came first changed with the machine."""
    monkeypatch.setattr(selection, "_worth", lambda *_: True)
    for asked in ("only_presliding", "only_slips", "_of_form"):
        monkeypatch.setattr(selection, asked, lambda *_: False)
    options = [
        cast(
            Option,
            SimpleNamespace(
                candidate=Candidate(effect=BY_NAME[name], joint=ELBOW),
                model=Model(recording),
                score=SimpleNamespace(
                    losses=np.ones(12), sse=9.0 - 1e-12 * (name == closer), coefficients=np.ones(1)
                ),
                theta={},
                gain=5.0 + 1e-12 * (name == closer),
                replaced=frozenset(),
                refused="",
            ),
        )
        for name in ("torque_gain", "added_inertia")
    ]
    current = cast(Score, SimpleNamespace(losses=np.full(12, 6.0), loss=72.0))
    rows = select_rows(recording, (0,))
    step = selection.choose(options, Model(recording), current, rows, 1.0)
    assert step is not None and step.taken.candidate.effect.name == "added_inertia"
