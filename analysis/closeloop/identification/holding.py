"""Names that do not hold: of a size that may be none, or of one size here and another there.

A late motor is late at every frequency of the motion, or it is none.

A robot is recorded in closed loop. A torque that nobody knows of (a tremor, a person's push) moves
the joint, and the controller answers: effort and motion are then related by the controller, and a
fit takes some of that for a late motor, or for inertia (Ljung 1999, System Identification, section
13.4; Forssell and Ljung 1999, Closed-loop identification revisited). What passes the motion on like
a linear filter has one size at every frequency; what the controller does in the band of a
disturbance does not go on into the band of the motion. So the octave in which such an effect
explains most is left out, and its size is asked for again.
"""

from collections.abc import Callable, Iterator

import numpy as np

from analysis.closeloop.identification.balance.declared import PLACED
from analysis.closeloop.identification.balance.luck import ALONE_Z, MIN_GAIN, more_than_luck
from analysis.closeloop.identification.balance.model import Model, evaluate, prediction
from analysis.closeloop.identification.balance.presence import surely_there
from analysis.closeloop.identification.balance.regression import Rows, compare
from analysis.closeloop.identification.balance.terms import Candidate, kept_columns
from analysis.closeloop.identification.balance.uncertainty import leave_out
from analysis.closeloop.identification.candidates import tried_alone
from analysis.closeloop.identification.findings import Grown, Option, Step
from analysis.closeloop.identification.spectrum import below
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME, LINK_INERTIA
from sim.effects.laws.inertia import LEAST_LOAD

DAMPING, ELASTIC = "viscous_friction", BY_NAME["series_elasticity"]
#: Least upper edge of an octave, Hz.
LOWEST = 0.5
#: How far an effect's size elsewhere may be from that of the whole fit, over it: of what is late,
#: and of what else filters the motion, since smoothing it takes more of the quick part; and how
#: many standard errors a difference has to be. Set on tremors and on limbs with such an effect,
#: tuning limbs 15005 to 16105 of the unkind bench.
OFF_LATE, OFF, ERRORS = 0.25, 0.5, 3.0
#: Least power of an effect elsewhere, over that in its octave, below which only rounding is left.
LEAST = 1e-9


def held_in_octaves(
    grown: Grown, rows: Rows, *, damped: bool = False
) -> tuple[Grown, tuple[str, ...]]:
    """Take out what filters the motion and has another size elsewhere, the last found first.

    Of other effects, what else is missing yet may differ from octave to octave.

    Args:
        grown: the model with its effects.
        rows: the samples that were fitted.
        damped: whether damping beside friction is expected, as of a robot's joint, and stays: what
            friction leaves where it turns lies in other octaves than what only damping explains.

    Returns:
        The model with the effects that stay, and a sentence for each that went.
    """

    def fails(grown: Grown) -> Step | None:
        asked = (s for s in reversed(grown.steps) if not (damped and _rubs_besides(grown, s)))
        return next((step for step in asked if _differs(grown, step, rows)), None)

    return _without(
        grown,
        rows,
        fails,
        "it would have another size at one frequency than at the others, as the controller's "
        "answer to an unknown torque has",
    )


def determined(grown: Grown, rows: Rows) -> tuple[Grown, tuple[str, ...]]:
    """Take out effects that may be nothing (`surely_there`), the least sure first.

    What lowers the error is no reason to name a cause as long as its own size does not show it.
    What joints share is judged by its own intervals (`arms.spread`); a load without a mass is none,
    wherever it hangs. Arguments and result are those of `held_in_octaves`.
    """
    return _without(grown, rows, lambda grown: _least_sure(grown, rows), "its size may be zero")


def _least_sure(grown: Grown, rows: Rows) -> Step | None:
    """Return the step whose effect is nearest to nothing; None if all are surely there."""
    for step in grown.steps:
        if _placed(step) and _mass(grown, step) < LEAST_LOAD:
            return step
    own = [step for step in grown.steps if not _shared(step)]
    if not own:
        return None
    fits = leave_out(grown.model, rows, grown.score.coefficients, form_free=False)
    sure = {
        step.key: surely_there(fits, grown.model, grown.score.coefficients, step.taken.candidate)
        for step in own
    }
    least = min(own, key=lambda step: sure[step.key])
    return least if sure[least.key] <= 1.0 else None


def _shared(step: Step) -> bool:
    """Whether a step is what all joints of an arm agree on."""
    return step.key[0] == LINK_INERTIA or _placed(step)


def _placed(step: Step) -> bool:
    """Whether a step is a load that joints share; a limb's may be less than nothing."""
    return step.taken.candidate.effect is PLACED


def _mass(grown: Grown, step: Step) -> float:
    """Return the mass of a load, kg."""
    for term, own in grown.model.split(grown.score.coefficients):
        if term.candidate == step.taken.candidate and 0 in term.kept:
            return float(own[term.kept.index(0)])
    return 0.0


def _without(
    grown: Grown, rows: Rows, failing: Callable[[Grown], Step | None], why: str
) -> tuple[Grown, tuple[str, ...]]:
    """Take out what fails, fitting the others anew each time, and say so."""
    notes: list[str] = []
    while (gone := failing(grown)) is not None:
        candidate = gone.taken.candidate
        where = rows.recording.name(candidate.joint)
        notes.append(f"{candidate.effect.name} of {where} is not added: {why}")
        model = grown.model.without(candidate)
        before, left = grown, tuple(step for step in grown.steps if step is not gone)
        grown = _with_simpler(Grown(model, evaluate(model, rows), left), candidate, rows)
        grown, unmissed = _without_unmissed(grown, before, candidate.joint, rows)
        notes += unmissed
    return grown, tuple(notes)


def _without_unmissed(
    grown: Grown, before: Grown, joint: int, rows: Rows
) -> tuple[Grown, list[str]]:
    """Take out what a joint's left-out rows missed only beside an effect that has gone since.

    It made up for what that one did. (A time delay that answered a vibration left a damping of less
    than none behind: an opponent's arm.)
    """
    notes = []
    for step in grown.steps:
        candidate = step.taken.candidate
        if candidate.joint != joint or _shared(step):
            continue
        if _missed(before, candidate, rows) and not _missed(grown, candidate, rows):
            model = grown.model.without(candidate)
            left = tuple(other for other in grown.steps if other is not step)
            grown = Grown(model, evaluate(model, rows), left)
            name = f"{candidate.effect.name} of {rows.recording.name(joint)}"
            notes.append(f"{name} is not added: trials that it was not fitted to do not miss it")
    return grown, notes


def _missed(grown: Grown, candidate: Candidate, rows: Rows) -> bool:
    """Whether left-out rows of its joint miss an effect by more than luck, and not too little."""
    own = rows.joint_of_block == candidate.joint
    worse = evaluate(grown.model.without(candidate), rows).losses[own]
    return _better(worse, grown.score.losses[own], rows.fold_of_block[own])


def _better(worse: np.ndarray, better: np.ndarray, folds: np.ndarray) -> bool:
    """Whether some losses of blocks are lower by more than luck, and not by too little."""
    sure = more_than_luck(worse, better, folds, ALONE_Z)
    return sure and compare(worse, better)[0] > MIN_GAIN * float(worse.sum())


def _with_simpler(grown: Grown, gone: Candidate, rows: Rows) -> Grown:
    """Add the first of the simpler effects that one which went contains, if left-out rows miss it.

    That nobody can tell what a joint's friction goes with is no reason to leave it without any.
    """
    for name in gone.effect.includes:
        more = with_missed(grown, Candidate(effect=BY_NAME[name], joint=gone.joint), rows)
        if more is not grown:
            return more
    return grown


def with_missed(grown: Grown, candidate: Candidate, rows: Rows) -> Grown:
    """Add an effect if left-out rows of its joint miss it by more than luck; else as it was."""
    known = grown.model.declared | {other.key for other in grown.model.effects}
    found = None if candidate.key in known else tried_alone(grown.model, rows, candidate)
    if found is None:
        return grown
    model, score = found
    own = rows.joint_of_block == candidate.joint
    worse, better = grown.score.losses[own], score.losses[own]
    if not _better(worse, better, rows.fold_of_block[own]):
        return grown
    gain, error = compare(worse, better)
    taken = Option(candidate=candidate, model=model, score=score, gain=gain, z=gain / error)
    step = Step(taken=taken, equals=(), options=(), before=float(worse.sum()))
    return Grown(model, score, (*grown.steps, step))


def _rubs_besides(grown: Grown, step: Step) -> bool:
    """Whether a step is damping, and its joint has friction too."""
    candidate = step.taken.candidate
    rubbing = [term.joint for term in grown.model.terms if term.rubs]
    return candidate.effect.name == DAMPING and candidate.joint in rubbing


def _differs(grown: Grown, step: Step, rows: Rows) -> bool:
    candidate = step.taken.candidate
    if not candidate.effect.filters or candidate not in grown.model.effects:
        return False
    found = size_elsewhere(grown.model, candidate, rows)
    if found is None:
        return False
    size, error = found
    return abs(size - 1.0) > max(OFF_LATE if candidate.effect.channel else OFF, ERRORS * error)


def size_elsewhere(model: Model, candidate: Candidate, rows: Rows) -> tuple[float, float] | None:
    """Return an effect's size outside of the octave in which it explains most.

    All coefficients of its joint are fitted again with it. Springs swing against each other: of
    several the torque is asked of all of them, at the joint of this one.

    Args:
        model: with the effect; fitted to the rows.
        candidate: the effect and its joint.
        rows: the samples that were fitted.

    Returns:
        The size over that of the whole fit, and its standard error; None if no octave is left out,
        or nothing of the effect is left elsewhere.
    """
    joint, recording = candidate.joint, rows.recording
    expected = _expected(model, rows, joint)
    together = {candidate, *(c for c in model.effects if c.effect is candidate.effect is ELASTIC)}
    rest = model.keeping(lambda other: other not in together)
    torque = expected - _expected(rest, rows, joint)
    left = np.nan_to_num(recording.effort[:, joint] - expected)
    others = np.column_stack([np.empty((len(left), 0)), *_columns(rest, joint)])
    samples, block = rows.samples[joint], rows.block[rows.parts[joint]]
    # What only the effect explains, over all of the motion.
    own = torque - others @ np.linalg.lstsq(others[samples], torque[samples])[0]
    powers = {
        edge: float(np.sum(_octave(own[:, None], edge, recording)[samples] ** 2))
        for edge in _upper_edges(recording)
    }
    if not any(powers.values()):
        return None
    most = max(powers, key=lambda edge: powers[edge])
    columns = np.column_stack([own, left, others])
    elsewhere = (columns - _octave(columns, most, recording))[samples]
    beside = elsewhere[:, 2:]
    elsewhere = elsewhere[:, :2] - beside @ np.linalg.lstsq(beside, elsewhere[:, :2])[0]
    torque, rest = elsewhere.T
    power = float(torque @ torque)
    if power <= LEAST * powers[most]:
        return None
    further = float(torque @ rest) / power
    blocks = np.bincount(block, torque * (rest - further * torque))
    return 1.0 + further, float(np.sqrt(blocks @ blocks)) / power


def _columns(model: Model, joint: int) -> Iterator[np.ndarray]:
    """Yield what the terms of a model bring to a joint, low-passed, (n, k) each."""
    for term in model.terms:
        if joint in term.columns:
            own = {joint: kept_columns(term)[joint]}
            yield model.recording.filtered(model.transformed(own)[joint])


def _upper_edges(recording: Recording) -> Iterator[float]:
    """Yield where octaves end, Hz, by half octaves down from where nothing is left.

    A strong line just above the fit's cutoff is in the fit, too: the low-pass is no wall.
    """
    edge = 2.0 * recording.sampling.fit_cutoff
    while edge >= LOWEST:
        yield edge
        edge /= np.sqrt(2.0)


def _octave(columns: np.ndarray, edge: float, recording: Recording) -> np.ndarray:
    """Return the octave below a frequency, Hz, of columns, (n, k)."""
    upper, lower = (
        below(columns, hertz, recording.rate, recording.slices) for hertz in (edge, edge / 2.0)
    )
    return np.asarray(upper - lower)


def _expected(model: Model, rows: Rows, joint: int) -> np.ndarray:
    torque = prediction(model, evaluate(model, rows).coefficients)[:, [joint]]
    return rows.recording.filtered(torque)[:, 0]
