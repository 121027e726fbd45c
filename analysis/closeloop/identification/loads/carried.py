"""What a trial carries though nobody said so, looked for before anything else.

A movement without and with a tool in the hand: free links take the half of it in either recording,
and friction of every kind the rest. So every fitted trial is asked, beside plain friction and free
links, whether a load of its own takes most of what is left of it. A load that is found is fitted as
one that the trial named (Swevers, Verdonck and De Schutter 2007 identify it from what it adds to
the bare arm's torque), and the report asks for it.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from analysis.closeloop.identification.arms.agreed import MOST, SEVERAL, shared_by_joints
from analysis.closeloop.identification.arms.links import last_links, links_of
from analysis.closeloop.identification.arms.ordinary import with_ordinary
from analysis.closeloop.identification.arms.robot import weighed_by
from analysis.closeloop.identification.arms.whole_fit import Fitted, WholeFit
from analysis.closeloop.identification.balance.declared import declared_model, load_about, naming
from analysis.closeloop.identification.balance.model import with_independent
from analysis.closeloop.identification.balance.regression import compare, select_rows
from analysis.closeloop.session.contents import HungLoad
from analysis.closeloop.session.recording import Recording
from sim.effects.laws.inertia import MOST_LOAD


def supposing_loads(recording: Recording) -> Recording:
    """Return the recording with the loads named that fitted trials seem to carry.

    Only beside a trial that carries less: what every trial carries is the robot's own. A robot of
    one joint is asked by more (`lone_joint`).
    """
    trials = recording.session.trials
    asked = [number for number in recording.fit_trials if trials[number].payload is None]
    if len(recording.joints) < SEVERAL or recording.limbs or len(asked) < 2:
        return recording
    found: dict[int, HungLoad] = {}
    for body in last_links(recording).values():
        for numbers, share in _carriers(recording, body, asked):
            name = "of trial " + ", ".join(str(number + 1) for number in numbers)
            found |= dict.fromkeys(numbers, HungLoad(name=name, body=body, supposed=share))
    return naming(recording, found)


def _carriers(
    recording: Recording, body: str, asked: Sequence[int]
) -> Iterator[tuple[list[int], float]]:
    """Yield trials that carry one load, and the part of what is left of them that it takes."""
    own = {n: HungLoad(name=f"of trial {n + 1}", body=body) for n in asked}
    # Every trial that may carry something alone is left out by halves.
    named = naming(recording, own)
    rows = select_rows(named, named.fit_trials)
    bare = declared_model(recording, select_rows(recording, recording.fit_trials))
    model = with_ordinary(replace(bare, recording=named), rows)
    rows, links = weighed_by(model, rows), links_of(named)
    # With a load in every trial nothing holds the links: how firmly is asked without.
    strength = WholeFit(model, rows, links).strength
    for load in own.values():
        model = with_independent(model, load_about(named, load, np.zeros(3)), rows)
    fit = WholeFit(model, rows, links, strength=strength)
    numbers = {load: number for number, load in own.items()}
    terms = {
        numbers[term.load]: place
        for place, term in enumerate(fit.model.terms)
        if term.load in numbers
    }
    rest = [place for place in range(len(fit.model.terms)) if place not in terms.values()]
    before, after, taken = _missed(fit, rest, terms)
    if len(taken) > 1 and _are_one(fit, rest, after, [own[number] for number in taken]):
        yield taken, _share(fit, before, after, taken)
        return
    for number in taken:
        yield [number], _share(fit, before, after, [number])


def _missed(
    fit: WholeFit, rest: Sequence[int], terms: Mapping[int, int]
) -> tuple[Fitted, Fitted, list[int]]:
    """Return fits without and with loads, and the trials whose loads left-out rows miss.

    Beside free links a load is what a trial carries more than the one that carries least. Each goes
    without which most of its trial is predicted as well.

    Args:
        fit: with a load in every trial that is asked.
        rest: numbers of the model's other terms.
        terms: number of the term of each trial's load.
    """

    def beside(loaded: Iterable[int]) -> Fitted:
        return fit.with_links([*rest, *(terms[number] for number in loaded)])

    before, every = beside(()), beside(terms)
    if not any(_share(fit, before, every, [number]) > MOST for number in terms):
        return before, before, []
    others = [[number for number in terms if number != least] for least in terms]
    taken, after = min(((own, beside(own)) for own in others), key=lambda both: both[1].loss)
    while taken:
        without = {number: beside([n for n in taken if n != number]) for number in taken}
        missed = {
            number: _share(fit, fitted, after, [number])
            if _weighs(fit, terms[number], after) and shared_by_joints(fitted, after, fit.rows)
            else 0.0
            for number, fitted in without.items()
        }
        least = min(taken, key=missed.__getitem__)
        if missed[least] > MOST:
            break
        taken, after = [number for number in taken if number != least], without[least]
    return before, after, taken


def _weighs(fit: WholeFit, place: int, fitted: Fitted) -> bool:
    """Whether a load has a mass that the arm may carry, within its reach."""
    term, recording = fit.model.terms[place], fit.model.recording
    own = dict(zip(term.kept, fitted.coefficients[fit.owner == place], strict=True))
    mass = own.get(0, 0.0)
    far = float(np.linalg.norm([own.get(number, 0.0) for number in (1, 2, 3)]))
    return bool(
        0.0 < mass <= MOST_LOAD * recording.mass and far <= mass * recording.reach(term.joint)
    )


def _share(fit: WholeFit, without: Fitted, beside: Fitted, trials: Sequence[int]) -> float:
    """Return the part of what is left of some trials that a fit with a load takes away.

    None unless it takes most of it at several joints: at one, in a short movement, anything does.
    """
    rows = fit.rows
    of_block = np.zeros(len(without.losses), dtype=int)
    of_block[rows.block] = rows.trial
    own = np.isin(of_block, trials)
    left, still = (
        np.bincount(rows.joint_of_block[own], fitted.losses[own]) for fitted in (without, beside)
    )
    if np.sum(still < (1.0 - MOST) * left) < SEVERAL:
        return 0.0
    return 1.0 - float(still.sum() / left.sum())


def _are_one(fit: WholeFit, rest: Sequence[int], apart: Fitted, loads: Sequence[HungLoad]) -> bool:
    """Whether one load in the place of several predicts as well."""
    named = fit.model.recording
    one = replace(loads[0], name="one")
    trials = named.session.trials
    there = {n: one for n, trial in enumerate(trials) if trial.payload in loads}
    term = load_about(naming(named, there), one, np.zeros(3))
    others = tuple(fit.model.terms[place] for place in rest)
    model = with_independent(replace(fit.model, terms=others), term, fit.rows)
    both = WholeFit(model, fit.rows, fit.links, strength=fit.strength)
    lost, error = compare(both.with_links(range(len(model.terms))).losses, apart.losses)
    return lost <= error
