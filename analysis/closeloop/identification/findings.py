"""What is found of a session: options, steps, what splines explain, the trace, its outcome."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from analysis.closeloop.contract import Verdict
from analysis.closeloop.identification.balance.model import Model, impedances
from analysis.closeloop.identification.balance.regression import Rows, Score
from analysis.closeloop.identification.balance.terms import Candidate, Channel, Term
from analysis.closeloop.identification.balance.trial_error import TrialError
from analysis.closeloop.identification.spectrum import Peak
from sim.effects.effect import Effect, Theta

#: An error that is so many times the floor is not at it: floors of one channel that come from
#: repeats and from above the band differ by as much on real robots (docs/measurements).
AT_FLOOR = 2.0
#: Share of a stiffness by which an effect that nobody saw may move it.
TELLING = 0.05
#: A model and its coefficients.
Fit = tuple[Model, np.ndarray]


@dataclass(frozen=True, kw_only=True)
class Explainable:
    """What splines explain beyond a model."""

    #: Held-out loss of the model alone and with every spline, on the same scattered folds.
    model_loss: float
    splines_loss: float
    #: Gain over its standard error.
    z: float
    #: The same by ranks, whatever share of the gain a few blocks hold.
    rank_z: float
    #: Signals that explain most of it, best first, with their share of the gain.
    depends_on: tuple[tuple[str, float], ...]
    #: Root mean square per joint that the splines leave (low-passed, in the joint's unit).
    noise: Mapping[int, float]

    @property
    def remains(self) -> float:
        """Loss that the model leaves and splines explain."""
        return self.model_loss - self.splines_loss


@dataclass(frozen=True, kw_only=True)
class Option:
    """One candidate beside the model it was tried on."""

    candidate: Candidate
    model: Model
    score: Score
    gain: float
    z: float
    #: Why it may not be named here; empty if it may.
    refused: str = ""
    #: Simpler effects of the model that it takes the place of.
    replaced: frozenset[tuple[str, int]] = frozenset()
    #: Other effects that it does it with.
    beside: tuple[Candidate, ...] = ()

    @property
    def theta(self) -> Theta:
        """Its non-linear parameters in the model."""
        parts: list[Term | Channel] = [*self.model.terms, *self.model.channels]
        return next(part.theta for part in parts if part.candidate == self.candidate)


@dataclass(frozen=True, kw_only=True)
class Step:
    """One effect added: the option taken, its equals, and every option for the report."""

    taken: Option
    equals: tuple[Option, ...]
    options: tuple[Option, ...]
    #: Held-out loss of the model without the effect.
    before: float

    @property
    def key(self) -> tuple[str, int]:
        """Name and joint of the effect taken."""
        return self.taken.candidate.key

    def share(self, option: Option) -> float:
        """Return the share of the held-out loss that an option takes away."""
        return option.gain / max(self.before, 1e-300)

    @property
    def p_value(self) -> float:
        """Chance of the gain taken by luck, over all candidates tried."""
        return float(min(1.0, max(len(self.options), 1) * norm.sf(self.taken.z)))


def exchanged(model: Model, taken: Option, option: Option) -> Model:
    """Return a model with an effect that was taken replaced by an option's."""
    for candidate in (taken.candidate, *taken.beside):
        model = model.without(candidate)
    others = (option.candidate, *option.beside)
    return replace(
        model,
        terms=(*model.terms, *(t for t in option.model.terms if t.candidate in others)),
        channels=(*model.channels, *(c for c in option.model.channels if c.candidate in others)),
    )


@dataclass(frozen=True)
class Grown:
    """A model that effects were added to, and how."""

    model: Model
    score: Score
    steps: tuple[Step, ...] = ()


def standing(model: Model, score: Score) -> tuple[Step, ...]:
    """Return a step for each effect that stands in a model before others are tried."""
    return tuple(
        Step(
            taken=Option(candidate=candidate, model=model, score=score, gain=0.0, z=0.0),
            equals=(),
            options=(),
            before=score.loss,
        )
        for candidate in model.effects
    )


@dataclass(frozen=True, kw_only=True)
class Trace:
    """What tracing found."""

    rows: Rows
    declared: Model
    declared_score: Score
    model: Model
    score: Score
    steps: tuple[Step, ...]
    verdict: Verdict
    #: Splines beyond the declared and beyond the final model.
    explainable_before: Explainable
    explainable_after: Explainable
    notes: tuple[str, ...] = ()
    #: The model with the effects of the steps, where they are shown but repair nothing.
    supposed: Fit | None = None

    @property
    def fits(self) -> tuple[Fit, Fit]:
        """The declared and the final model, each with its coefficients."""
        return (
            (self.declared, self.declared_score.coefficients),
            (self.model, self.score.coefficients),
        )

    @property
    def fit_of_steps(self) -> Fit:
        """The model that holds the effects of the steps: not the final one if none is named."""
        return self.supposed or self.fits[1]

    def without_names(self, note: str) -> "Trace":
        """Return the trace of a residual that no effect may be named for."""
        return replace(
            self,
            verdict=Verdict.UNEXPLAINED,
            model=self.declared,
            score=self.declared_score,
            steps=(),
            supposed=None,
            explainable_after=self.explainable_before,
            notes=(*self.notes, note),
        )


@dataclass(frozen=True, kw_only=True)
class Event:
    """Torque at a joint from one moment to another, s on the session's clock."""

    trial: int
    joint: int
    begin: float
    end: float
    #: Largest low-passed residual, with its sign, Nm or N.
    peak: float


@dataclass(frozen=True, kw_only=True)
class Carried:
    """A load that one trial seems to carry though it names none; with halves of 90 % intervals."""

    trial: int
    body: str
    #: Number of the joint that moves it.
    joint: int
    #: Mass, kg, then place in the body's frame, m; (4,) each.
    value: np.ndarray
    half: np.ndarray
    #: Mass times place, kg m; (3,) each.
    moments: np.ndarray
    half_moments: np.ndarray
    #: Numbers of mass and coordinates that some joint feels.
    felt: tuple[int, ...]
    #: Of what is left of the trial without it, the part that it takes.
    share: float
    #: Whether it was fitted as if the trial had named it.
    fitted: bool = False


@dataclass(frozen=True, kw_only=True)
class Floor:
    """Root mean square of a channel's noise over raw samples, Nm or N, and where it is from."""

    value: float
    source: str


@dataclass(frozen=True, kw_only=True)
class Structure:
    """A signal that a joint's residual goes with."""

    signal: str
    #: Root mean square of what it explains beyond chance, Nm or N (low-passed).
    rms: float
    p_value: float


@dataclass(frozen=True, kw_only=True)
class ByTrial:
    """A limb's stiffness in every fitted trial."""

    #: Root mean square of what it explains, Nm or N (low-passed).
    rms: float
    #: Nm/rad or N/m, by the number of the trial.
    stiffness: Mapping[int, float]


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """An effect that nobody saw, and how far it could move a joint's stiffness all the same."""

    effect: Effect
    #: Nm/rad or N/m.
    by: float


@dataclass(frozen=True, kw_only=True)
class Errors:
    """Errors of the same trials under the declared and under the final model."""

    before: list[TrialError]
    after: list[TrialError]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """The trace of a session, what it amounts to, and how well the models predict."""

    trace: Trace
    #: The trace's, unless an oscillation is left in a residual that seemed adequate.
    verdict: Verdict
    fit: Errors
    #: Of the trials with the role holdout, or of each group predicted from the others.
    holdout: Errors
    #: Whether it is the latter, for want of holdouts.
    left_out: bool
    #: Lines and bands in the spectrum of each joint's final residual.
    oscillations: Mapping[int, list[Peak]]
    #: Noise of each joint's effort channel; a joint may have none.
    floors: Mapping[int, Floor]
    #: Signals that the final residual goes with, and torque that is local in time.
    structures: Mapping[int, list[Structure]]
    #: Joints of limbs whose stiffness differs from trial to trial.
    by_trial: Mapping[int, ByTrial]
    events: Sequence[Event]
    #: Loads that trials carry without naming them.
    loads: Sequence[Carried]
    #: Per joint with a declared impedance, effects that nobody saw and could move its stiffness.
    hidden: Mapping[int, Sequence[Hidden]]
    #: Root mean square that the final model leaves of each joint in motion below the fit's cutoff,
    #: apart from events, Nm or N.
    left: Mapping[int, float]
    #: Joints with declared unknowns that the fitted trials do not determine, and the held-out do.
    unsettled: Sequence[int]

    def over_floor(self, joint: int) -> float | None:
        """Return a joint's error over its floor; None if it has no floor.

        Above the fit's cutoff the floor itself stands in for the error: nothing is compared there.
        """
        floor, sampling = self.floors.get(joint), self.trace.rows.recording.sampling
        if floor is None or joint not in self.left:
            return None
        beyond = 1.0 - min(1.0, 2.0 * sampling.fit_cutoff / sampling.recorded)
        return float(np.sqrt((self.left[joint] / floor.value) ** 2 + beyond))

    def identified(self, joint: int) -> bool:
        """Whether no effect that nobody saw could move a stiffness by more than `TELLING` of it."""
        stiffness = impedances(*self.trace.fits[1])[joint]["stiffness"]
        return all(one.by <= TELLING * abs(stiffness) for one in self.hidden[joint])

    @property
    def recorded(self) -> Errors:
        """Errors of every trial once: those that were fitted, then the holdouts."""
        trials = self.trace.rows.recording.session.trials
        if all(trial.role == "fit" for trial in trials):
            return self.fit
        return Errors(
            before=self.fit.before + self.holdout.before, after=self.fit.after + self.holdout.after
        )
