"""Wrong zeros of encoders: the links are elsewhere than thought, which every joint feels."""

from collections.abc import Collection, Iterator

from analysis.closeloop.identification.arms.agreed import better_for_all, shared_by_joints
from analysis.closeloop.identification.arms.links import Links
from analysis.closeloop.identification.arms.whole_fit import WholeFit
from analysis.closeloop.identification.balance.model import Candidate, Model, evaluate
from analysis.closeloop.identification.balance.regression import Rows, Score, compare
from analysis.closeloop.identification.candidates import tried_alone
from sim.effects.catalogue import BY_NAME

ZERO = BY_NAME["position_offset"]
#: What a zero does where a trial moves one joint and holds the others.
IMITATE = ("torque_offset", "torque_gain", "added_inertia")


def with_zeros(model: Model, rows: Rows, links: Links) -> Model:
    """Add wrong zeros one at a time, if left-out groups of no joint speak against.

    Before other links are thought of: ten parameters a link do most of what a zero does. A load
    that explains more goes first.
    """
    while True:
        current = evaluate(model, rows)
        found = [(m, s) for m, s in _zeros(model, rows) if shared_by_joints(current, s, rows)]
        if not found:
            return model
        best, score = min(found, key=lambda pair: pair[1].loss)
        loads = WholeFit(model, rows, links).loads()
        if min((load.loss for load in loads), default=score.loss) < score.loss:
            return model
        model = best


def for_offsets(model: Model, rows: Rows) -> Model:
    """Put one wrong zero in the place of all offsets, gains and inertias, if it predicts as well.

    Where a trial moves one joint, a wrong zero of another is an offset or a gain of the first, and
    beside those it has nothing to show. In the place of a single one it has to predict better.
    """
    gone = [candidate for candidate in model.effects if candidate.effect.name in IMITATE]
    bare = model.keeping(lambda candidate: candidate not in gone)
    found = list(_zeros(bare, rows)) if gone else []
    if not found:
        return model
    best, score = min(found, key=lambda pair: pair[1].loss)
    better, error = compare(evaluate(model, rows).losses, score.losses)
    return best if better > (error if len(gone) == 1 else -error) else model


def for_rare(model: Model, rows: Rows, rare: Collection[tuple[str, int]]) -> Model:
    """Put a wrong zero in the place of what is rare at one joint, if left-out groups prefer it.

    Beside nothing a little one gains less than a name has to, and backlash or a coupling of the
    joint that shows it most then stands for it.
    """
    for candidate in model.effects:
        if candidate.key not in rare or candidate.effect.rubs:
            continue
        current, zeros = evaluate(model, rows), _zeros(model.without(candidate), rows)
        found = [(m, s) for m, s in zeros if better_for_all(current, s, rows)]
        if found:
            model, _ = min(found, key=lambda pair: pair[1].loss)
    return model


def _zeros(model: Model, rows: Rows) -> Iterator[tuple[Model, Score]]:
    """Yield the model with a wrong zero of each joint that has none yet."""
    recording = model.recording
    there = model.declared | {candidate.key for candidate in model.effects}
    for joint in rows.joints:
        zero = Candidate(effect=ZERO, joint=joint)
        if zero.key in there:
            continue
        found = tried_alone(model, rows, zero) if ZERO.applies(recording, joint) else None
        if found is not None:
            yield found
