"""One trial whose columns are not what the others' are: in another unit, or exchanged.

What the other trials say of every joint is asked of each, beside what a remedy would make of it.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from analysis.closeloop.remedies import (
    scaled,
    with_efforts_exchanged,
    with_motions_exchanged,
)
from analysis.closeloop.session.angles import DEGREES
from analysis.closeloop.session.faults import fault
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.signs import (
    TURNED_LEAVES,
    Prediction,
    effort_table,
    left_of,
    predictions,
)
from analysis.closeloop.units import units_near
from sim.effects.laws.drive import HEAVIEST

#: Share of an effort's variance that the others leave at least of a trial that they do not
#: predict, and at most of each other.
LEAVES = 0.5
#: What positions in other units are multiplied by, of hinges and of slides.
ANGLES = {"degrees": 1.0 / DEGREES, "turns": 2.0 * np.pi}
LENGTHS = {"mm": 1e-3}

Suspects = Mapping[int, Prediction]


@dataclass(frozen=True)
class Fault:
    """What is wrong in one trial."""

    trial: int
    column: str
    why: str
    #: How far the other trials are from the declared model: the logarithm of their gain.
    others_off: float


def check_odd_trials(recording: Recording) -> None:
    """Refuse a session in which one trial has a column in another unit, or two exchanged.

    The other trials predict little of it as it is, nearly all of it once that is mended, and each
    other. Efforts are in another unit beyond what links and loads may differ by. Two trials can
    only say that they disagree: the one is named that is farther from the declared model.

    Raises:
        SessionError: names the trial's file and the joint's column.
    """
    tables = {joint: effort_table(recording, joint) for joint in recording.joints}
    every = {joint: predictions(recording, joint) for joint in recording.joints}
    found: list[Fault] = []
    for number in range(len(recording.session.trials)):
        moved = {j: one for j, trials in every.items() for one in trials if one.trial == number}
        suspects = {
            joint: one
            for joint, one in moved.items()
            if _stands_out(tables[joint], one, every[joint])
        }
        found += _in_another_unit(recording, tables, suspects)
        found += _exchanged(recording, tables, suspects, moved)
    if found:
        worst = min(found, key=lambda fault: fault.others_off)
        raise fault(recording.session.trials[worst.trial], worst.why, worst.column)


def _stands_out(table: np.ndarray, one: Prediction, trials: list[Prediction]) -> bool:
    """Whether the others predict little of a trial, and each other."""
    own = one.coefficients(table)
    if left_of(table[one.rows], own) < LEAVES:
        return False
    others = [other for other in trials if np.any(other.rows & one.others)]
    return all(left_of(table[other.rows], own) < LEAVES for other in others)


def _in_another_unit(
    recording: Recording, tables: Mapping[int, np.ndarray], suspects: Suspects
) -> Iterator[Fault]:
    for joint, one in suspects.items():
        name, hinge = recording.name(joint), recording.is_hinge(joint)
        where = recording.session.trials[one.trial].label
        predicted, effort = _predicted(tables[joint], one)
        times = float(predicted @ effort) / max(float(predicted @ predicted), 1e-300)
        rest, spread = effort - times * predicted, effort - effort.mean()
        explained = float(rest @ rest) < TURNED_LEAVES * float(spread @ spread)
        if explained and (times > HEAVIEST or 0.0 < times < 1.0 / HEAVIEST):
            there = times > 1.0
            near = units_near(times if there else 1.0 / times) if hinge else []
            unit = f"is its unit {near[0]}" if near else "what is its unit"
            size = f"{times:.4g} times" if there else f"1/{1.0 / times:.4g} of"
            why = (
                f"is in {where} {size} what the other trials predict of {name}: {unit} "
                f"{'there' if there else 'in the others'}? Efforts are in {'Nm' if hinge else 'N'}"
            )
            yield Fault(one.trial, f"{name}.effort", why, _off(tables, {joint: one}))
        for unit, scale in (ANGLES if hinge else LENGTHS).items():
            motion = np.ones_like(recording.position)
            motion[recording.trial == one.trial, joint] = scale
            table = effort_table(scaled(recording, motion), joint)
            if one.left(table) < TURNED_LEAVES:
                why = (
                    f"looks like {unit} in {where}: so taken, {name} needs the effort that the "
                    "other trials predict, and as recorded it does not; positions are in "
                    f"{'radians' if hinge else 'metres'}"
                )
                yield Fault(one.trial, f"{name}.position", why, _off(tables, {joint: one}))


def _exchanged(
    recording: Recording, tables: Mapping[int, np.ndarray], suspects: Suspects, moved: Suspects
) -> Iterator[Fault]:
    for pair in combinations(moved, 2):
        # A joint beyond two parallel ones feels their sum, whichever is which.
        odd = [joint for joint in pair if joint in suspects]
        both = {joint: moved[joint] for joint in pair}
        trial = next(iter(both.values())).trial
        rows = recording.trial == trial
        ways = []
        if len(odd) == 2:
            ways.append(("effort", with_efforts_exchanged(recording, pair, rows)))
        if odd:
            ways.append(("position", with_motions_exchanged(recording, pair, rows)))
        for column, other in ways:
            left = [one.left(effort_table(other, joint)) for joint, one in both.items()]
            if max(left) < TURNED_LEAVES:
                first, second = (recording.name(joint) for joint in pair)
                why = (
                    f"looks exchanged with that of {second} in "
                    f"{recording.session.trials[trial].label}: the other way round the other "
                    "trials predict the efforts of both, and as recorded they do not; exchange "
                    f"the columns of {column} there, or in the others"
                )
                yield Fault(trial, f"{first}.{column}", why, _off(tables, both))


def _predicted(table: np.ndarray, one: Prediction) -> tuple[np.ndarray, np.ndarray]:
    """Return the effort that the other trials predict in a trial, and the recorded one, (r,)."""
    own = table[one.rows]
    return own[:, :-1] @ one.coefficients(table), own[:, -1]


def _off(tables: Mapping[int, np.ndarray], ones: Suspects) -> float:
    """Return how far the other trials are from the declared model: the logarithm of their gain."""
    gains = [max(one.coefficients(tables[j])[0], 1e-300) for j, one in ones.items()]
    return float(np.abs(np.log(gains)).max())
