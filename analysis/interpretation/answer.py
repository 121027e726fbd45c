"""The answer to a recording: K_h and D_h with intervals, what they are made of, what to do next."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.interpretation.bank.bank import PLACES, Bank
from analysis.interpretation.errors import InterpretationError
from analysis.interpretation.inference.features import RECORDED
from analysis.interpretation.inference.interpreter import LEAST_CONTACT, Interpreter, Known
from analysis.interpretation.inference.posterior import TARGETS, Posterior
from analysis.interpretation.inference.rows import targets_of
from analysis.interpretation.inference.view import View
from analysis.interpretation.plan import (
    Step,
    half_width_after,
    parts,
    shortest_plan,
    steps,
)
from analysis.interpretation.recording import Recording
from analysis.interpretation.strange import contrary, unfamiliar
from sim.models import WINDOWS
from sim.robot.device import NESM

#: What is said of a recording that is unlike the bank's.
ADVICE = (
    "close the loop first (`rehyb close-loop`): it names what the recording has and the bank "
    "lacks; declare it, or build a bank whose population has it"
)
OTHER_DEVICE = (
    f"banks are of the {NESM.name} alone: the intervals are the population's own and say nothing "
    "of this recording; what its declared model lacks, `rehyb close-loop` finds of any robot"
)
MORE_CONTACT = (
    f"build the bank with {LEAST_CONTACT} or more --contact-rows: until then the intervals are the "
    "population's own"
)
#: Why a strange recording has no plan.
NO_PLAN = "the recording is not familiar, and no measurement on the patient mends that"
#: `muscle_model`: whose muscles an answer holds for.
ANY, BANKS = "any", "the bank's"
PROBABILITIES = np.array([0.05, 0.25, 0.5, 0.75, 0.95])


@dataclass(frozen=True, kw_only=True)
class Question:
    """What is asked of a recording."""

    recording: Recording
    known: tuple[Known, ...] = ()
    #: Half width of K's 90 % interval that is wanted, Nm/rad.
    tolerance: float | None = None

    def __post_init__(self) -> None:
        names = [one.name for one in self.known]
        for name in names:
            if names.count(name) > 1:
                raise InterpretationError(f"{name} is known twice: say it once")
        for one in self.known:
            if not (np.isfinite(one.value) and np.isfinite(one.sd) and one.sd > 0.0):
                raise InterpretationError(
                    f"{one.name} is known as a value and a positive standard deviation, "
                    f"not {one.value:g}:{one.sd:g}"
                )
        if self.tolerance is not None and not 0.0 < self.tolerance < np.inf:
            raise InterpretationError(f"a tolerance is positive, not {self.tolerance:g}")


def interpret(bank: Bank, question: Question) -> dict[str, Any]:
    """Answer a question from a bank.

    Returns:
        As JSON; stiffness and damping in the restoring sense.

    Raises:
        InterpretationError: the recording or a known value cannot be used.
    """
    if not bank.fitted:
        raise InterpretationError("this bank was never learnt from: `rehyb bank build` does both")
    interpreter = Interpreter.read(bank)
    recording, known = question.recording, question.known
    common = {
        "bank": bank.id,
        "recording": recording.source,
        "convention": "restoring",
        "known": [vars(one) for one in known],
    }
    if recording.device != NESM.name:
        return common | _unknown(
            bank, question, f"it was recorded by {recording.device}, and the bank is of {NESM.name}"
        )
    if recording.differs is not None:
        other = f"the declared robot is not the bank's {NESM.name}: {recording.differs}"
        return common | _unknown(bank, question, other)
    if 0 < len(bank.contact) < LEAST_CONTACT:
        few = (
            f"this bank has {len(bank.contact)} recordings with contact, too few to learn what "
            "contact changes"
        )
        return common | _unknown(bank, question, few, MORE_CONTACT)
    values = recording.values()
    view, by_sets = interpreter.look(values), interpreter.look_by_sets(values)
    why = unfamiliar(bank, interpreter, recording, values) or contrary(interpreter, by_sets, known)
    posterior = interpreter.infer(view, known)
    offered = steps(interpreter, known)
    after = {step.factor: half_width_after(interpreter, view, known, (step,)) for step in offered}
    now = posterior.half_width()
    shares = parts(interpreter, view, known)
    return (
        common
        | _beliefs(posterior, values)
        | {
            "familiar": why is None,
            "why_not": why,
            "muscle_model": ANY if interpreter.any_muscles else BANKS,
            "if_muscles_of_bank": _beliefs(interpreter.infer(by_sets, known), values)
            if interpreter.any_muscles
            else None,
            "parts": [{"name": name, "share": share} for name, share in shares.items()],
            "next": [
                _said(step, after[step.factor])
                for step in sorted(offered, key=lambda step: after[step.factor])
                if after[step.factor] < now
            ],
            "tolerance": _tolerance(interpreter, view, question, offered, now, why),
            "regression": {
                "affine": -float(values[RECORDED.index("affine_stiffness")]),
                "paper": -float(values[RECORDED.index("paper_stiffness")]),
            },
            "advice": [*_notes(recording), *([] if why is None else [ADVICE])],
        }
    )


def _notes(recording: Recording) -> Iterator[str]:
    """Yield what was done to a recording, and what of it was left out."""
    if recording.replaced:
        listed = ", ".join(f"{count} of the {name}" for name, count in recording.replaced.items())
        yield f"single samples far from their neighbours were replaced by the median: {listed}"
    if recording.unused:
        listed = ", ".join(recording.unused)
        yield f"{listed} of session.json: not used here; what is known of the wearer is `--known`"


def _said(step: Step, width: float) -> dict[str, Any]:
    unit = "" if step.unit == "1" else f" {step.unit}"
    return {
        "do": f"measure {step.factor} to {step.to:g}{unit}: {step.how}",
        "factor": step.factor,
        "to": step.to,
        "minutes": step.minutes,
        "half_width_after": width,
    }


def _tolerance(
    interpreter: Interpreter,
    view: View,
    question: Question,
    offered: list[Step],
    now: float,
    why: str | None,
) -> dict[str, Any] | None:
    """Say whether the interval is inside a tolerance, and else the shortest plan that makes it."""
    if question.tolerance is None:
        return None
    inside = why is None and now <= question.tolerance
    found: dict[str, Any] = {"value": question.tolerance, "inside": inside, "plan": None}
    if inside:
        return found
    if why is not None:
        return found | {"why_no_plan": NO_PLAN}
    known = question.known
    plan = shortest_plan(interpreter, view, known, offered, question.tolerance)
    if plan is None:
        found["all_steps"] = half_width_after(interpreter, view, known, tuple(offered))
        return found
    done, width = plan
    found["plan"] = {
        "steps": [
            _said(step, half_width_after(interpreter, view, known, done[: number + 1]))
            for number, step in enumerate(done)
        ],
        "minutes": sum(step.minutes for step in done),
        "half_width_after": width,
    }
    return found


def _beliefs(posterior: Posterior, values: np.ndarray) -> dict[str, Any]:
    """Return stiffness, damping and stiffness over the angle, each with its intervals."""
    quantiles = posterior.quantiles(PROBABILITIES)
    angle = values[:WINDOWS]
    travel = angle[0] + np.array(list(PLACES.values())) * (angle[-1] - angle[0])
    over = [
        {"share_of_travel": share, "angle": float(at)} | _entry(quantiles[:, 2 + i], "Nm/rad")
        for i, (share, at) in enumerate(zip(PLACES.values(), travel, strict=True))
    ]
    return {
        "stiffness": _entry(quantiles[:, 0], "Nm/rad"),
        "damping": _entry(quantiles[:, 1], "Nm s/rad"),
        "stiffness_over_angle": over,
        "half_width": posterior.half_width(),
    }


def _entry(quantiles: np.ndarray, unit: str) -> dict[str, Any]:
    low90, low50, median, high50, high90 = map(float, quantiles)
    return {
        "median": median,
        "interval50": [low50, high50],
        "interval90": [low90, high90],
        "unit": unit,
    }


def _unknown(
    bank: Bank, question: Question, why: str, advice: str = OTHER_DEVICE
) -> dict[str, Any]:
    """Answer of a recording that cannot be compared: what the population alone says."""
    truths = np.sort(targets_of(bank.bushing), axis=0)
    count = len(TARGETS)
    prior = Posterior(centre=np.zeros(count), spread=np.ones(count), scores=truths)
    tolerance = None
    if question.tolerance is not None:
        tolerance = {
            "value": question.tolerance,
            "inside": False,
            "plan": None,
            "why_no_plan": NO_PLAN,
        }
    nothing = np.full(WINDOWS, np.nan)
    found = _beliefs(prior, nothing)
    for entry in found["stiffness_over_angle"]:
        entry["angle"] = None
    return found | {
        "familiar": False,
        "why_not": why,
        "muscle_model": BANKS,
        "if_muscles_of_bank": None,
        "parts": [],
        "next": [],
        "tolerance": tolerance,
        "regression": None,
        "advice": [*_notes(question.recording), advice],
    }
