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

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from analysis.closeloop.identification.balance.luck import (
    ALONE_Z,
    LARGE_GAIN,
    least_gain,
    more_than_luck,
)
from analysis.closeloop.identification.balance.model import (
    Model,
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
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.identification.findings import Grown, Option, Step
from analysis.closeloop.identification.friction.settling import BEGUN, POWERS, settled
from analysis.closeloop.identification.friction.settling import SPEEDS as LOST
from analysis.closeloop.identification.holding import with_missed
from analysis.closeloop.identification.nameable import beyond_physics, with_law
from sim.effects.catalogue import BY_NAME
from sim.effects.effect import Theta
from sim.effects.laws.friction import GAUSSIAN, slowness
from sim.effects.motion import PRESLIDING_SHARE, RecordedJoint

STRIBECK, COULOMB = BY_NAME["stribeck_friction"], BY_NAME["coulomb_friction"]
VISCOUS = BY_NAME["viscous_friction"]
MOTOR = BY_NAME["coupled_motor"]
#: Speeds at which the excess may be lost, over the top speed.
SPEEDS = np.geomspace(0.01, 0.4, 12)
#: Ways over which a bristle bends, over the longest that is presliding, and how: as a spring that
#: then yields, or less and less (Dahl 1968). (Ways an octave apart gave two of four
#: arms of an opponent an excess a quarter too large: a third of one was set while looking at them.)
WAYS, EXPONENTS = np.geomspace(1.0 / 64.0, 1.0, 19), (1.0, 0.0)
#: How a bristle's way goes with the level, as above; and with it, where its stiffness is constant.
FORMS: tuple[Theta, ...] = ({"exponent": 0.0, "ratio": 0.0}, {"exponent": 1.0, "ratio": 0.5})
#: Least and most of what there is more when slow, over the level.
RATIOS = (0.02, 5.0)
#: Steps that show what another way, or ratio, would do.
STEP = 2.0**0.25
NOTE = (
    "stribeck_friction of {}: where it turns, friction winds up over {:.2g} {} and is larger when "
    "slow; what is fitted beside it allows for the winding, model_after.xml does not"
)


@dataclass(frozen=True)
class Peak:
    """Friction that winds up and is larger when slow, beside the same without an excess."""

    plain: Score
    peaked: Score
    #: Non-linear parameters that it was shown with, of those that were asked first.
    shown: Theta
    #: What it was found in the place of.
    replaced: Candidate

    @property
    def theta(self) -> Theta:
        """Its non-linear parameters."""
        return self.peaked.variant.theta


def with_peak_at_turns(
    grown: Grown, rows: Rows, every: Rows
) -> tuple[Grown, Rows, tuple[str, ...]]:
    """Put Stribeck friction in the place of Coulomb's where a joint's turns show an excess.

    And in the place of Stribeck friction that was found without them: it is known better with them.

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
            notes += (NOTE.format(rows.recording.name(joint), peak.theta["way"], unit),)
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
    rubbing = [term for term in model.terms if term.rubs]
    beside = any(t.effect is MOTOR and joint in t.columns for t in grown.model.terms)
    if len(rubbing) != 1 or beside or rows.recording.device.friction[joint]:
        return None
    there = rubbing[0].candidate
    if there is None or there.effect not in (COULOMB, STRIBECK):
        return None
    recorded = unfitted(rows.recording, joint)
    rest = _damped(model.without(there), rows, joint)
    base, lower = rest.base(rows)
    target = rest.target(rows)

    def fitted(variants: list[Variant]) -> Score:
        return score(rows, target, base, lower, variants, (0.0,))

    bends = list(product(WAYS * PRESLIDING_SHARE * recorded.travel[1], EXPONENTS))
    plain, peaked = map(fitted, _variants(rest, rows, recorded, bends))
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
    about = {**rubbing[0].theta, **peaked.variant.theta}
    bare = model.without(there)
    found = _sharpened(bare, rows, recorded, [about])
    # Damping, another power, or both may be what another speed is, too: the less is the answer.
    for one, powers in ((rest, ()), (bare, BEGUN), (rest, BEGUN)):
        if one.terms == bare.terms and not powers:
            continue
        begun = [{**about, "power": power} for power in powers] or [about]
        other = _sharpened(one, rows, recorded, begun)
        if more_than_luck(found.losses, other.losses, rows.fold_of_block, ALONE_Z):
            found = other
    if there.effect is STRIBECK:
        # Friction that does not wind up is known already, and bristles are another form.
        turning = evaluate(model, rows).losses
        if not more_than_luck(turning, found.losses, rows.fold_of_block, ALONE_Z):
            return None
    return Peak(plain, found, about, there)


def _sharpened(rest: Model, rows: Rows, joint: RecordedJoint, begun: Sequence[Theta]) -> Score:
    """Return friction that winds up and has the excess that fits best, of either form.

    Where a search begins at several powers, that of the loss is fitted, too.
    """
    base, lower = rest.base(rows)
    target, found = rest.target(rows), []
    for form in FORMS:
        theta = _settled(rest, rows, joint, [{**one, **form} for one in begun])
        theta = {**theta, "smooth": min(theta["smooth"], 0.4 * theta["speed"])}
        stacked = rows.stack(rest.transformed(STRIBECK.columns(joint, theta)), 2)
        variant = Variant(theta=theta, columns=stacked, kept=(0, 1))
        found.append(score(rows, target, base, lower, [variant], (0.0,)))
    return min(found, key=lambda one: one.sse)


def _settled(rest: Model, rows: Rows, joint: RecordedJoint, begun: Sequence[Theta]) -> Theta:
    """Return the way, the speed and the power of an excess that fit best together."""
    longest = PRESLIDING_SHARE * joint.travel[1]
    limits = {"speed": LOST, "way": (WAYS[0] * longest, WAYS[-1] * longest)}
    if len(begun) > 1:
        limits["power"] = POWERS
    if begun[0]["exponent"]:
        limits["ratio"] = RATIOS

    def columns(theta: Theta) -> np.ndarray:
        return STRIBECK.columns(joint, theta)[joint.number]

    return settled(rest, rows, columns, (0.0, 0.0), begun, limits)


def _damped(model: Model, rows: Rows, joint: int) -> Model:
    """Return the model with damping, which a level between slow and fast may have hidden."""
    columns = VISCOUS.columns(unfitted(rows.recording, joint), {})
    return with_independent(model, Term(joint=joint, columns=columns), rows)


def _variants(
    rest: Model,
    rows: Rows,
    joint: RecordedJoint,
    bends: Iterable[tuple[float, float]],
) -> tuple[list[Variant], list[Variant]]:
    """Return friction that winds up by each way and exponent: without an excess, and with each."""
    falls: list[Theta] = [{"speed": float(speed), "power": GAUSSIAN} for speed in SPEEDS]
    slow = [np.asarray(slowness(STRIBECK.fixed(joint, fall), joint)) for fall in falls]
    plain, peaked = [], []
    for way, exponent in bends:
        wound = joint.wound(way, exponent)
        columns = np.stack([wound, *(wound * part for part in slow)], axis=1)
        stacked = rows.stack(rest.transformed({joint.number: columns}), columns.shape[1])
        theta = {"way": float(way), "exponent": exponent, "ratio": 0.0}
        plain.append(Variant(theta=theta, columns=stacked[:, :1], kept=(0,)))
        for number, fall in enumerate(falls, 1):
            peaked.append(
                Variant(theta={**theta, **fall}, columns=stacked[:, [0, number]], kept=(0, 1))
            )
    return plain, peaked


def _with_excess(grown: Grown, rows: Rows, joint: int, peak: Peak) -> Grown | None:
    """Return the model with friction that is larger when slow and winds up; None if it cannot be.

    What its bristles bend unlike has no name, as elsewhere (`winding`).
    """
    stribeck, theta = Candidate(effect=STRIBECK, joint=joint), peak.theta
    recorded = unfitted(rows.recording, joint)
    rest = grown.model.without(peak.replaced)
    model = with_law(rest, stribeck, theta, rows, recorded)
    if model is None or model.terms[-1].kept != (0, 1):
        return None
    model = with_independent(model, _bent_otherwise(recorded, theta, peak), rows)
    fitted = evaluate(model, rows)
    if beyond_physics(model, fitted, stribeck):
        return None
    # What is fitted closely may be of any form: both have to show it.
    if not all(_slides(rest, stribeck, one, rows) for one in (peak.shown, theta)):
        return None
    gain, error = compare(peak.plain.losses, peak.peaked.losses)
    taken = Option(
        candidate=stribeck,
        model=model,
        score=fitted,
        gain=gain,
        z=gain / error,
        replaced=frozenset({peak.replaced.key}),
    )
    step = Step(taken=taken, equals=(), options=(), before=peak.plain.loss)
    others = tuple(other for other in grown.steps if other.key != peak.replaced.key)
    return Grown(model, fitted, (*others, step))


def _bent_otherwise(joint: RecordedJoint, theta: Theta, peak: Peak) -> Term:
    """Return what bristles that are not quite those of a law add to its torque.

    They may bend less, or over another way; the way and the ratio are estimates, too: else
    intervals would be of who knows them.
    """
    own = peak.peaked.coefficients[-2:]

    def torque(**changed: float) -> np.ndarray:
        columns = STRIBECK.columns(joint, {**theta, **changed})[joint.number]
        return np.asarray(columns @ own)

    bent = [torque(way=theta["way"] * STEP) - torque(way=theta["way"] / STEP)]
    if theta["exponent"]:
        bent.append(torque(ratio=theta["ratio"] * STEP) - torque(ratio=theta["ratio"] / STEP))
    turning = {name: theta[name] for name in ("smooth", "speed", "power")}
    bent.append(torque() - STRIBECK.columns(joint, turning)[joint.number] @ own)
    return Term(joint=joint.number, columns={joint.number: np.stack(bent, axis=1)})


def _slides(rest: Model, candidate: Candidate, theta: Theta, rows: Rows) -> bool:
    """Whether a law's excess gains more than luck beside all that may wind up.

    Else it is of the winding's form, which no bristle here has quite.
    """
    number, joint = candidate.joint, unfitted(rows.recording, candidate.joint)
    turning = {name: theta[name] for name in ("smooth", "speed", "power")}
    law = STRIBECK.columns(joint, turning)[number]
    lacks = STRIBECK.columns(joint, theta)[number] - law
    longer, shorter = (
        STRIBECK.columns(joint, {**theta, "way": theta["way"] * by})[number]
        for by in (STEP, 1.0 / STEP)
    )
    winding = Term(joint=number, columns={number: np.hstack([lacks, longer - shorter])})

    def losses(columns: int) -> np.ndarray:
        own = Term(joint=number, columns={number: law[:, :columns]})
        model = with_independent(_damped(rest, rows, number), own, rows)
        return evaluate(with_independent(model, winding, rows), rows).losses

    return more_than_luck(losses(1), losses(2), rows.fold_of_block, ALONE_Z)
