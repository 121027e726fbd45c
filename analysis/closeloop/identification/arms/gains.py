"""One wrong motor constant that was taken for the ordinary effects of a joint, or for a load.

About an upright axis inertia and friction are all that a motor has to do, and a gain is the same as
other inertia and friction: then both are said.
"""

import numpy as np

from analysis.closeloop.identification.arms.agreed import SHARED
from analysis.closeloop.identification.balance.declared import placed
from analysis.closeloop.identification.balance.luck import MIN_LATER_GAIN
from analysis.closeloop.identification.balance.model import Model, evaluate, gain
from analysis.closeloop.identification.balance.regression import Rows, Score, compare
from analysis.closeloop.identification.balance.terms import Candidate
from analysis.closeloop.identification.candidates import tried_alone
from analysis.closeloop.identification.findings import Option
from analysis.closeloop.identification.nameable import one_way
from analysis.closeloop.identification.selection import EQUAL_SHARE
from sim.effects.catalogue import BY_NAME
from sim.effects.effect import Effect
from sim.effects.laws.drive import AnyGain
from sim.effects.laws.inertia import OWN_INERTIA, PlacedPayload

GAIN, INERTIA = BY_NAME["torque_gain"], BY_NAME["added_inertia"]
ANY_GAIN, PAYLOAD = AnyGain(), BY_NAME["payload"]
COULOMB, OFFSET = BY_NAME["coulomb_friction"], BY_NAME["torque_offset"]
#: Gains of all joints are one if they differ by no more than this share.
ALIKE = 0.05


def with_gains(model: Model, rows: Rows) -> Model:
    """Put a gain in the place of what a joint was given before one was asked for.

    What is ordinary is asked of every joint at once, before anything else. Together inertia,
    friction and a load do most of what a gain does, and beside them a gain has nothing to show. So
    it is tried in their place: of the joint's own, then of these and what all joints share.
    It has to predict left-out groups better; where it stands for several, as well is enough. The
    joint at which it predicts best is the first: beside a load that stands for its gain, others
    seem wrong.
    """
    while True:
        found = [one for joint in rows.joints if (one := _gain_at(model, rows, joint))]
        if not found:
            return _without_needless(model, rows)
        model, _ = min(found, key=lambda one: one[1].loss)


def _without_needless(model: Model, rows: Rows) -> Model:
    """Take out gains, and what was asked for before them, that are not missed beside loads."""
    gained = any(candidate.effect is GAIN for candidate in model.effects)
    for candidate in model.effects if gained else ():
        if candidate.effect in (GAIN, OFFSET, INERTIA):
            rest = placed(model.without(candidate), rows)
            gain, error = compare(evaluate(rest, rows).losses, evaluate(model, rows).losses)
            if gain <= error:
                model = rest
    return model


def _gain_at(model: Model, rows: Rows, joint: int) -> tuple[Model, Score] | None:
    """Return the model with a gain of one joint in the place of what it may stand for, or None."""
    gain = Candidate(effect=GAIN, joint=joint)
    if not GAIN.applies(model.recording, joint) or gain.key in _keys(model):
        return None
    shared = [c for c in model.effects if c.effect.name in SHARED]
    own = [c for c in model.effects if c.joint == joint and c not in shared]
    rest = model.keeping(lambda other: other not in own)
    # An inertia of its load's own may stand for a part of it, too.
    either = [(len(own), rest)] if own or _has_inertia(model, joint) else []
    if shared:
        either.append((len(own) + len(shared), rest.keeping(lambda other: other not in shared)))
    changed = (_instead(model, rows, beside, gain, of=of) for of, beside in either)
    return next((one for one in changed if one is not None), None)


def _has_inertia(model: Model, joint: int) -> bool:
    """Whether a load hangs at a joint that has an inertia of its own."""
    loads = [term for term in model.terms if isinstance(term.effect, PlacedPayload)]
    return any(OWN_INERTIA in load.kept for load in loads if load.joint == joint)


def gain_of_all(model: Model, coefficients: np.ndarray, rows: Rows) -> float | None:
    """Return the gain that was found of every joint alike; None if there is none.

    It cannot be told from links of that part of their declared mass.
    """
    if len(rows.joints) < 2 or not {(GAIN.name, j) for j in rows.joints} <= _keys(model):
        return None
    gains = [gain(model, coefficients, joint) for joint in rows.joints]
    mean = float(np.mean(gains))
    return mean if np.ptp(gains) < ALIKE * mean else None


def untold_gain(model: Model, coefficients: np.ndarray, rows: Rows) -> tuple[str, ...]:
    """Say what a gain of every joint may be."""
    found = gain_of_all(model, coefficients, rows)
    if found is None:
        return ()
    return (
        f"every joint has a torque_gain of about {found:.2f}: efforts in another unit, currents "
        f"times a wrong factor, or links of {1.0 / found:.2f} times their declared mass; check the "
        "factor first, or hold a known mass still",
    )


def _keys(model: Model) -> set[tuple[str, int]]:
    return model.declared | {candidate.key for candidate in model.effects}


def _instead(
    model: Model, rows: Rows, rest: Model, gain: Candidate, *, of: int
) -> tuple[Model, Score] | None:
    """Return `rest` with the gain in the place of the `of` effects it lacks, if it is as good.

    In the place of none it is a later effect.
    """
    found = tried_alone(rest, rows, gain)
    if found is None:
        return None
    before = evaluate(model, rows)
    better, error = compare(before.losses, found[1].losses)
    least = {0: max(error, MIN_LATER_GAIN * before.loss), 1: error}.get(of, -error)
    return found if better > least else None


def alike(option: Option, rest: Model, rows: Rows) -> tuple[Option, ...]:
    """Return inertia in the place of a gain, or a gain in that of inertia, if it does as well.

    Of a joint that moves in one direction only, an offset in the place of friction, too; of a
    robot's one joint, a gain in that of a payload, or a payload in a gain's.

    Args:
        option: what was found.
        rest: its model without it.
        rows: the samples to fit.
    """
    twins = {GAIN: INERTIA, INERTIA: GAIN}
    if one_way(rows, option.candidate.joint):
        twins |= {COULOMB: OFFSET}
    found = _as_well(option, twins.get(option.candidate.effect), rest, rows)
    return (*found, *gain_or_payload(option, rest, rows)) if len(rows.joints) == 1 else found


def gain_or_payload(option: Option, rest: Model, rows: Rows) -> tuple[Option, ...]:
    """Return a gain in the place of a payload of a robot's one joint, or a payload in a gain's.

    Beside friction that is not there yet, one of them may seem the better; arguments as of `alike`.
    A gain may be as far from one as the load is heavy.
    """
    twins = {GAIN: PAYLOAD, PAYLOAD: ANY_GAIN}
    return _as_well(option, twins.get(option.candidate.effect), rest, rows)


def _as_well(option: Option, effect: Effect | None, rest: Model, rows: Rows) -> tuple[Option, ...]:
    """Return another effect of the same joint in the place of an option, if it does as well."""
    joint = option.candidate.joint
    if effect is None or not effect.applies(rest.recording, joint):
        return ()
    twin = Candidate(effect=effect, joint=joint)
    found = None if twin.key in _keys(rest) else tried_alone(rest, rows, twin)
    if found is None:
        return ()
    model, score = found
    lost, error = compare(score.losses, option.score.losses)
    if lost > max(error, EQUAL_SHARE * option.gain):
        return ()
    gain, error = compare(evaluate(rest, rows).losses, score.losses)
    return (Option(candidate=twin, model=model, score=score, gain=gain, z=gain / error),)
