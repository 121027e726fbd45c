"""How far effects that the trials do not tell could move a stiffness.

Each effect of the catalogue that is neither declared nor found is fitted beside the model. The
interval that stiffness then has says how far the effect could move it without being seen: where an
effect imitates stiffness, damping and neutral angle together, the interval is wide, however small
the residual is. Its covariance is clustered by seconds (Liang and Zeger 1986, Longitudinal data
analysis using generalized linear models). An effect that the declared unknowns take in whole
wherever the joint goes (an offset, viscosity, a spring) is part of what they are called and moves
nothing. Nor does one that contradicts the model's file, as another gravity does.
"""

from collections.abc import Iterator

import numpy as np
from scipy.stats import norm

from analysis.closeloop.identification.balance.least_squares import keep_independent
from analysis.closeloop.identification.balance.model import Model, estimate_of, impedances
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.candidates import candidates, has_ground
from analysis.closeloop.identification.findings import Hidden
from analysis.closeloop.identification.growing.freed import freed
from sim.effects.effect import Columns, Effect
from sim.effects.laws.elastic import Viscoelastic
from sim.effects.motion import RecordedJoint

#: Largest torque that an effect which nobody saw is credited with, over the joint's effort.
MOST = 0.2
#: Root mean square of a column below which only rounding is left of it.
NOTHING = 1e-9
#: Least share of a column's power that the model may leave of it to show how large it is.
LEAST_OWN = 1e-8
#: Variants of an effect's non-linear parameters that are tried.
VARIANTS = 7


def hidden_effects(
    model: Model, coefficients: np.ndarray, rows: Rows
) -> dict[int, tuple[Hidden, ...]]:
    """Return, per joint with a declared impedance, how far unseen effects could move its stiffness.

    Args:
        model: declared or repaired.
        coefficients: its fit.
        rows: the samples that were fitted.

    Returns:
        For every such joint the effects, the one that could move most first.
    """
    limbs = impedances(model, coefficients)
    if not limbs:
        return {}
    declared = {(d.effect, d.joint) for d in model.recording.session.declared}
    known = {candidate.key for candidate in model.effects}
    ground = known | {term.at.key for term in model.terms if term.effect is not None}
    estimate = estimate_of(model, coefficients)
    # What was found may make room for it by another form: a softer cuff for a gain. And a load
    # beside its line is nearly a spring: that of another place takes a gain in whole, or a cubic
    # spring, however little of its own slope shows. (Opponents': K was 128 % off, and sure of it.)
    free = freed(model, coefficients, rows, LEAST_OWN)
    found: dict[int, list[Hidden]] = {joint: [] for joint in limbs}
    for candidate in candidates(model.recording):
        effect, joint = candidate.effect, candidate.joint
        named = (effect.name, model.recording.name(joint)) in declared or candidate.key in known
        if joint not in limbs or effect.channel or effect.contradicts:
            continue
        if named or effect.name in _covered(model, joint):
            continue
        if not has_ground(candidate, ground):
            continue
        if any(candidate.replaces(c) and not candidate.includes(c) for c in model.effects):
            # It would take the place of what was found.
            continue
        stiffness = _stiffness(model, coefficients, joint)
        if stiffness is None:
            continue
        recorded = RecordedJoint(model.recording, joint, estimate)
        reaches = [
            _reach(free, rows, stiffness, effect, columns)
            for columns in _variants(effect, recorded)
            if columns
        ]
        # By all of it at most: then nothing is known of it.
        reach = min(abs(stiffness[1]), max(reaches, default=0.0))
        if reach > 0.0:
            found[joint].append(Hidden(effect=effect, by=reach))
    return {joint: tuple(sorted(own, key=lambda one: -one.by)) for joint, own in found.items()}


def _covered(model: Model, joint: int) -> set[str]:
    """Return the simpler effects that those of the model hold."""
    here = [t.effect for t in model.terms if t.effect is not None and t.joint == joint]
    return {name for effect in here for name in effect.includes}


def _variants(effect: Effect, joint: RecordedJoint) -> Iterator[Columns]:
    """Yield an effect's columns over its non-linear parameters, a few of the likely ones."""
    thetas = [theta for theta in effect.thetas(joint) if not effect.unlikely(joint, theta)]
    step = max(1, -(-len(thetas) // VARIANTS))
    for theta in thetas[step // 2 :: step]:
        yield effect.columns(joint, theta)


def _reach(
    model: Model,
    rows: Rows,
    stiffness: tuple[int, float],
    effect: Effect,
    columns: Columns,
) -> float:
    """Return how far an effect could move a joint's stiffness and not be seen, Nm/rad or N/m.

    Args:
        model: the effect is not in it; what is may change its form.
        rows: the samples that were fitted.
        stiffness: where it is among the model's coefficients, and its value.
        effect: in question.
        columns: of one variant of it.
    """
    base, _ = model.base(rows)
    place, value = stiffness
    width = next(iter(columns.values())).shape[1]
    stacked = rows.stack(model.transformed(columns), width)
    # Of what nearly all is imitated the rest may still show how large it is: but for a gain, and
    # beside what was found, whose law is never quite its own. (Three of an opponent's limbs, with
    # a wrong name and K 9 to 32 % off, decided that.)
    untold = effect.scales_effort or model.effects
    least_own = Effect.least_own if untold else LEAST_OWN
    table, kept = keep_independent(base, stacked, least_own)
    table = np.column_stack([base, table])
    # What a fit without a column makes of the most that it may be.
    joint = next(iter(columns))
    torque = MOST * float(np.sqrt(rows.effort_power(joint)))
    size = np.sqrt((stacked**2).sum(axis=0))
    # Rounding is no torque: what a zero does to a device that no gravity pulls.
    size = np.where(size > NOTHING * np.sqrt(len(stacked)), size, np.inf)
    most = torque / size * np.abs(np.linalg.lstsq(base, stacked, rcond=None)[0][place])
    dropped = [number for number in range(width) if number not in kept]
    least = float(max(most[dropped], default=0.0))
    if dropped and effect.scales_effort:
        # A gain divides the whole balance, and with it stiffness.
        gains = [effect.gain(np.array([share])) for share in (-MOST, MOST)]
        least = abs(value) * max(abs(gain - 1.0) for gain in gains)
    if not kept:
        return least
    bread = np.linalg.pinv(table.T @ table)
    target = model.target(rows)
    beside = bread @ (table.T @ target)
    _, seconds = np.unique(rows.block, return_inverse=True)
    count = int(seconds.max()) + 1
    largest = float(most[list(kept)].sum())
    if count <= table.shape[1]:
        return max(least, largest)
    scores = np.zeros((count, table.shape[1]))
    np.add.at(scores, seconds, table * (target - table @ beside)[:, None])
    own = slice(base.shape[1], None)
    gain, slope = effect.gain(beside[own]), np.zeros(len(beside))
    slope[place] = gain
    for number in range(base.shape[1], len(beside)):
        step = np.zeros(len(beside))
        step[number] = 1e-6 * (1.0 + abs(beside[number]))
        change = effect.gain((beside + step)[own]) - gain
        slope[number] = beside[place] * change / step[number]
    spread = slope @ bread @ scores.T
    error = float(np.sqrt(count / (count - table.shape[1]) * (spread @ spread)))
    moved = abs(float(beside[place]) * gain - value) + float(norm.ppf(0.95)) * error
    return max(least, moved if effect.scales_effort else min(moved, largest))


def _stiffness(model: Model, coefficients: np.ndarray, joint: int) -> tuple[int, float] | None:
    """Return where among the model's coefficients the stiffness of a joint is, and its value."""
    start = 0
    for term in model.terms:
        if isinstance(term.effect, Viscoelastic) and term.joint == joint:
            # The first of the term's columns is the position.
            return (start, float(coefficients[start])) if term.kept[:1] == (0,) else None
        start += len(term.kept)
    return None
