"""Friction that is larger when slow, told where a joint that moves quickly turns around.

A joint passes the speeds at which Stribeck's excess is lost in some hundredths of a second before
it turns and after. Bristles bend there before it slides again (Dahl 1968), and a law that turns
with the velocity leaves more of a reversal than the excess is: so those rows are left out
(`sliding`), and with them all that shows the excess. Free to wind up over any mixture of ways it
predicts left-out rows worse than it did. Here friction winds up as a single bristle does, whose
level goes by the speed (LuGre; Canudas de Wit, Olsson, Astrom and Lischinsky 1995, A new model for
control of systems with friction): one way, and the excess comes on both sides of a turn, where
bristles leave something only after it.
"""

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from analysis.closeloop.identification.arms.motors import MOTOR
from analysis.closeloop.identification.balance.luck import (
    ALONE_Z,
    LARGE_GAIN,
    least_gain,
    more_than_luck,
)
from analysis.closeloop.identification.balance.model import (
    Candidate,
    Model,
    Term,
    evaluate,
    one_joint,
    unfitted,
    with_independent,
)
from analysis.closeloop.identification.balance.regression import (
    Rows,
    Score,
    Variant,
    compare,
    score,
)
from analysis.closeloop.identification.candidates import with_law
from analysis.closeloop.identification.findings import Grown, Option, Step
from analysis.closeloop.identification.holding import with_missed
from analysis.closeloop.identification.nameable import beyond_physics
from sim.effects.catalogue import BY_NAME
from sim.effects.laws.friction import slowness
from sim.effects.motion import PRESLIDING_SHARE, RecordedJoint

STRIBECK, COULOMB = BY_NAME["stribeck_friction"], BY_NAME["coulomb_friction"]
VISCOUS = BY_NAME["viscous_friction"]
#: Speeds at which the excess may be lost, over the top speed.
SPEEDS = np.geomspace(0.01, 0.4, 12)
#: Ways over which a bristle bends, over the longest that is presliding, and how: as a spring that
#: then yields, or less and less (Dahl 1968). (Ways an octave apart gave two of four
#: arms of an opponent an excess a quarter too large: a third of one was set while looking at them.)
WAYS, EXPONENTS = np.geomspace(1.0 / 64.0, 1.0, 19), (1.0, 0.0)
#: Steps from the best speed, and from the best way, at which both are asked once more. (That they
#: are was set while looking at eight arms of an opponent; how finely, at an elbow of ours, of whose
#: excess a quarter of a step left a tenth.)
FINER = np.linspace(-0.9, 0.9, 13)
NOTE = (
    "stribeck_friction of {}: where it turns, friction winds up over {:.2g} {} and is larger when "
    "slow; what is fitted beside it allows for the winding, model_after.xml does not"
)


@dataclass(frozen=True)
class Peak:
    """Friction that winds up and is larger when slow, beside the same without an excess."""

    plain: Score
    peaked: Score

    @property
    def way(self) -> float:
        """Over which it winds up, rad or m."""
        return self.peaked.variant.theta["way"]


def with_peak_at_turns(
    grown: Grown, rows: Rows, every: Rows
) -> tuple[Grown, Rows, tuple[str, ...]]:
    """Put Stribeck friction in the place of Coulomb's where a joint's turns show an excess.

    Args:
        grown: the model with its effects.
        rows: the samples that it was fitted to.
        every: the samples with those that were left out since friction is not known there.

    Returns:
        The model, the samples with those that it knows the friction of, and a sentence for each
        joint of which it was changed.
    """
    every = every.reweighted(
        {joint: 1.0 / float(rows.weight[rows.parts[joint]][0]) for joint in rows.joints}
    )
    found = {joint: _peak(grown, every.of_joint(joint), joint) for joint in rows.joints}
    known: tuple[int, ...] = ()
    notes: tuple[str, ...] = ()
    for joint, peak in found.items():
        if peak is None:
            continue
        shown = with_turns(rows, every, (*known, joint))
        changed = _with_excess(grown, shown, joint, peak)
        if changed is not None:
            grown = with_missed(changed, Candidate(effect=VISCOUS, joint=joint), shown)
            known = (*known, joint)
            unit = "rad" if rows.recording.is_hinge(joint) else "m"
            notes += (NOTE.format(rows.recording.name(joint), peak.way, unit),)
    return grown, with_turns(rows, every, known) if known else rows, notes


def with_turns(rows: Rows, every: Rows, joints: Collection[int]) -> Rows:
    """Return the rows with all that there are of some joints."""
    kept = np.zeros(len(every.weight), dtype=bool)
    for joint in every.joints:
        own = np.isin(every.samples[joint], rows.samples[joint])
        kept[every.parts[joint]] = own | (joint in joints)
    return every.where(kept)


def _peak(grown: Grown, rows: Rows, joint: int) -> Peak | None:
    """Return what the turns of a joint with plain friction show of an excess; None if nothing.

    Args:
        grown: the model with its effects.
        rows: all samples of the joint.
        joint: its number.
    """
    model = one_joint(grown.model, grown.score.coefficients, joint)
    coulomb = Candidate(effect=COULOMB, joint=joint)
    rubbing = [term.candidate for term in model.terms if term.rubs]
    beside = any(t.effect is MOTOR and joint in t.columns for t in grown.model.terms)
    if rubbing != [coulomb] or beside or rows.recording.device.friction[joint]:
        return None
    recorded = unfitted(rows.recording, joint)
    rest = _damped(model.without(coulomb), rows, joint)
    base, lower = rest.base(rows)
    target = rest.target(rows)

    def fitted(variants: list[Variant]) -> Score:
        return score(rows, target, base, lower, variants, (0.0,))

    bends = list(product(WAYS * PRESLIDING_SHARE * recorded.travel[1], EXPONENTS))
    plain, peaked = map(fitted, _variants(rest, rows, recorded, bends, SPEEDS))
    worse, better = plain.losses, peaked.losses
    # No error of smoothing has the form: where a joint turns it takes of an acceleration, which is
    # as if less held the joint before the turn, and an excess is more.
    least = least_gain(rows, joint, worse, better, in_form=True)
    # Little is an error of form: no joint's bristles are quite this one.
    least = max(LARGE_GAIN * plain.loss, least)
    shown = plain.loss - peaked.loss > least
    shown = shown and more_than_luck(worse, better, rows.fold_of_block, ALONE_Z)
    if not shown:
        return None
    about = peaked.variant.theta
    bends = [(about["way"] * float((WAYS[1] / WAYS[0]) ** by), about["exponent"]) for by in FINER]
    speeds = about["speed"] * (SPEEDS[1] / SPEEDS[0]) ** FINER
    return Peak(plain, fitted(_variants(rest, rows, recorded, bends, speeds)[1]))


def _damped(model: Model, rows: Rows, joint: int) -> Model:
    """Return the model with damping, which a level between slow and fast may have hidden."""
    columns = VISCOUS.columns(unfitted(rows.recording, joint), {})
    return with_independent(model, Term(joint=joint, columns=columns), rows)


def _variants(
    rest: Model,
    rows: Rows,
    joint: RecordedJoint,
    bends: Iterable[tuple[float, float]],
    speeds: np.ndarray,
) -> tuple[list[Variant], list[Variant]]:
    """Return friction that winds up by each way and exponent: without an excess, and with each."""
    slow = [_slowness(joint, speed) for speed in speeds]
    plain, peaked = [], []
    for way, exponent in bends:
        wound = joint.wound(way, exponent)
        columns = np.stack([wound, *(wound * part for part in slow)], axis=1)
        stacked = rows.stack(rest.transformed({joint.number: columns}), columns.shape[1])
        theta = {"way": float(way), "exponent": exponent}
        plain.append(Variant(theta=theta, columns=stacked[:, :1], kept=(0,)))
        for number, speed in enumerate(speeds, 1):
            beside = {**theta, "speed": float(speed)}
            peaked.append(Variant(theta=beside, columns=stacked[:, [0, number]], kept=(0, 1)))
    return plain, peaked


def _slowness(joint: RecordedJoint, speed: float) -> np.ndarray:
    """Return 1 at rest and 0 when fast, (n,), about a speed over the top speed."""
    values = STRIBECK.fixed(joint, {"speed": speed})
    return np.asarray(slowness(values, joint))


def _further(joint: RecordedJoint, way: float, exponent: float) -> np.ndarray:
    """Return how the state of a bristle changes with the way over which it bends, (n,)."""
    step = 2.0**0.25
    return np.asarray(joint.wound(way * step, exponent) - joint.wound(way / step, exponent))


def _with_excess(grown: Grown, rows: Rows, joint: int, peak: Peak) -> Grown | None:
    """Return the model with friction that is larger when slow and winds up; None if it cannot be.

    What winds up beside the law has no name, as elsewhere (`winding`).
    """
    coulomb, stribeck = (Candidate(effect=effect, joint=joint) for effect in (COULOMB, STRIBECK))
    (turning,) = [t.theta["smooth"] for t in grown.model.terms if t.candidate == coulomb]
    found = peak.peaked.variant.theta
    theta = {"smooth": min(turning, 0.4 * found["speed"]), "speed": found["speed"]}
    recorded = unfitted(rows.recording, joint)
    model = with_law(grown.model.without(coulomb), stribeck, theta, rows, recorded)
    if model is None or model.terms[-1].kept != (0, 1):
        return None
    sign = model.terms[-1].columns[joint][:, :1]
    # What the law lacks where it has not slid yet, of its level and of its excess.
    lacks = (recorded.wound(found["way"], found["exponent"]) - sign[:, 0])[:, None]
    slow = _slowness(recorded, found["speed"])
    # The way is an estimate, too: else intervals would be of who knows it.
    further = _further(recorded, found["way"], found["exponent"])[:, None]
    both = np.stack([np.ones_like(slow), slow], axis=1)
    winding = Term(joint=joint, columns={joint: np.hstack([lacks * both, further * both])})
    model = with_independent(model, winding, rows)
    fitted = evaluate(model, rows)
    if beyond_physics(model, fitted, stribeck) or not _slides(model, stribeck, rows):
        return None
    gain, error = compare(peak.plain.losses, peak.peaked.losses)
    taken = Option(
        candidate=stribeck,
        model=model,
        score=fitted,
        gain=gain,
        z=gain / error,
        replaced=frozenset({coulomb.key}),
    )
    step = Step(taken=taken, equals=(), options=(), before=peak.plain.loss)
    others = tuple(other for other in grown.steps if other.key != coulomb.key)
    return Grown(model, fitted, (*others, step))


def _slides(model: Model, candidate: Candidate, rows: Rows) -> bool:
    """Whether a law's excess gains more than luck beside all that may wind up.

    Else it is of the winding's form, which no bristle here has quite.
    """
    joint = candidate.joint
    model = _damped(model, rows, joint)
    (law,) = [term for term in model.terms if term.candidate == candidate]
    level = replace(law, columns={joint: law.columns[joint][:, :1]}, kept=(0,))
    without = replace(model, terms=tuple(level if term is law else term for term in model.terms))
    worse, better = (evaluate(one, rows).losses for one in (without, model))
    return more_than_luck(worse, better, rows.fold_of_block, ALONE_Z)
