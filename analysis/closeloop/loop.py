"""Close the loop on a session: read, trace, repair, and write the report's four files."""

import csv
import json
import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from errno import ENOTDIR
from pathlib import Path
from typing import Any

import numpy as np

from analysis.closeloop.contract import REPORT_FILES, Verdict
from analysis.closeloop.errors import naming_unsolvable
from analysis.closeloop.identification.arms.skew import (
    ALONE,
    synchronised,
    synchronised_limb,
    tells_time,
)
from analysis.closeloop.identification.balance.model import Model, impedances
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.balance.sticking import driven, samples_step
from analysis.closeloop.identification.balance.trial_error import TrialError
from analysis.closeloop.identification.findings import Carried, Event, Outcome, Trace
from analysis.closeloop.identification.guessed import doubtful_guesses
from analysis.closeloop.identification.interface import beyond_interface
from analysis.closeloop.identification.loads.carried import supposing_loads
from analysis.closeloop.identification.loads.lone_joint import supposing_lone_loads
from analysis.closeloop.identification.loads.unlike import supposing_held_out
from analysis.closeloop.identification.tracing import trace
from analysis.closeloop.identification.winding import wound_up
from analysis.closeloop.judgement.agreement import agreed
from analysis.closeloop.judgement.events import Standing, find_events, spared, standing_out
from analysis.closeloop.judgement.identified import hidden_effects
from analysis.closeloop.judgement.loads import unnamed_loads
from analysis.closeloop.judgement.outcome import outcome_of, takes_too_little
from analysis.closeloop.judgement.structure import structures
from analysis.closeloop.load import load_session
from analysis.closeloop.misdeclared import doubtful_gravity
from analysis.closeloop.report.answer import Answer
from analysis.closeloop.report.confirmation import confirm, unconfirmed
from analysis.closeloop.report.json_report import json_report
from analysis.closeloop.report.page import write_page
from analysis.closeloop.report.plain import finite
from analysis.closeloop.report.repaired import repaired_model
from analysis.closeloop.report.still import still_answer
from analysis.closeloop.session.files import SESSION_FILE
from analysis.closeloop.session.reading import said_of_unread
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.runs import TRAVEL
from analysis.closeloop.session.stretches import without_forgotten
from analysis.closeloop.units import doubtful_units

#: Time that a joint moves by itself, s, before a fit says anything of it, unless it goes far; or
#: else it leaves its hold for so long, s, in so many blocks of time, in the mean over so many at
#: least: its motor perturbs a limb. (The mean, while looking at five real ankles.)
MOVES, MOVES_OUT, PERTURBED = 1.0, 0.2, 12


def analyse(folder: Path, progress: Callable[[str], None] = lambda _: None) -> Answer:
    """Find out what the declared model of the session in `folder` lacks.

    Raises:
        SessionError: the session cannot be analysed.
    """
    progress("reading")
    recording = load_session(folder)
    if _rests(recording):
        return still_answer(recording, find_events(Model(recording), recording))
    recording, skewed = synchronised(recording)
    recording = supposing_held_out(supposing_loads(supposing_lone_loads(recording)))
    found = trace(recording, progress)
    if any(step.taken.candidate.effect.remembers for step in found.steps):
        seen = without_forgotten(recording)
        if seen is not recording:
            recording, found = seen, trace(seen, _again(progress, "without what follows gaps"))
    found, late = _synchronised(found, progress)
    recording, skewed = (found.rows.recording, late) if late else (recording, skewed)
    progress("torque that is local in time")
    standing, loads = _events(found, recording)
    whole = fitted = recording
    if standing.doubted and recording.limbs:
        # What is missing leaves so much that pushes pass for it, and is not found for them. (A
        # stranger's: of 217 beside a load or an end of range 11 were told.)
        without = spared(recording, (*standing.told, *standing.doubted))
        supposed = trace(without, _again(progress, "without what stands out"))
        again, further = _events(supposed, recording)
        if again.told and not again.doubted:
            found, standing, loads, fitted = supposed, again, further, without
    events = standing.told
    if events:
        # What somebody pushed is no reason to name an effect, nor to bend a stiffness.
        recording = spared(fitted, events)
        if _rests(recording):
            return still_answer(recording, events)
        named = _named(found)
        found = trace(recording, _again(progress, "without what is local in time"))
        if _named(found) != named:
            # What rings on a spring that only now has its name stood out before it had.
            events = _events(found, whole)[0].told
            recording = spared(fitted, events)
            found = trace(recording, _again(progress, "with events of the repaired model"))
        loads = unnamed_loads(wound_up(found))
    progress("errors and intervals")
    found = beyond_interface(found)
    if impedances(*found.fits[0]):
        # A limb is what it is; values of a robot are for a file in which friction turns at once.
        found = wound_up(found)
    found = agreed(found)
    found = replace(found, notes=(*found.notes, skewed)) if skewed else found
    outcome = _outcome(found, events, loads)
    if why := takes_too_little(outcome):
        outcome = _outcome(found.without_names(why), events, loads)
    return Answer(
        report=json_report(outcome),
        recording=recording,
        before=outcome.recorded.before,
        after=outcome.recorded.after,
    )


def _again(progress: Callable[[str], None], why: str) -> Callable[[str], None]:
    """Return what tells of a search that is repeated, and why it is."""
    return lambda what: progress(f"{what} (again, {why})")


def _outcome(found: Trace, events: Sequence[Event], loads: Sequence[Carried]) -> Outcome:
    hidden = hidden_effects(*found.fits[1], found.rows)
    return outcome_of(found, events, loads, structures(found.model, found.rows), hidden)


def _events(found: Trace, recording: Recording) -> tuple[Standing, tuple[Carried, ...]]:
    """Return what stands out of a traced recording, and the loads that no trial names."""
    known = wound_up(found)
    loads = unnamed_loads(known)
    # What a load takes is no push, and a push beside it is not seen before the load is known.
    carrying = {load.trial for load in loads if not load.fitted}
    # Beside an effect that cannot be told for sure, too: that is where pushes have to be known.
    every = standing_out(known.fit_of_steps[0], recording)
    told = tuple(event for event in every.told if event.trial not in carrying)
    return replace(every, told=told), loads


def _synchronised(found: Trace, progress: Callable[[str], None]) -> tuple[Trace, str]:
    """Return the trace of a limb at the times of its efforts, and a sentence of it; or as it is."""
    again = _again(progress, "with efforts and positions of one moment")
    if found.steps and not tells_time(found.model):
        # What is late in a log was compliance of clean limbs, and then late no more.
        taken = found.declared_score.loss - found.score.loss
        shifted, late = synchronised_limb(found.without_names(""), ALONE * taken)
        if late:
            return trace(shifted, again), late
    shifted, late = synchronised_limb(found)
    return (trace(shifted, again), late) if late else (found, "")


def _named(found: Trace) -> set[tuple[str, int]]:
    return {step.key for step in found.steps}


def _rests(recording: Recording) -> bool:
    """Whether no joint moves long enough for a fit: it is held, and pushed now and then at most."""
    if recording.still:
        return True
    rows = select_rows(recording, recording.fit_trials)
    for joint in rows.joints:
        samples = rows.samples[joint]
        period = samples_step(samples) / recording.rate
        own = samples[driven(recording, joint, samples)]
        if len(own) * period >= MOVES:
            return False
        if len(own) and np.ptp(recording.position[own, joint]) >= TRAVEL:
            return False
        seconds = np.bincount(rows.block[rows.parts[joint]]) * period
        # Random steps last as long as their motor takes for them, and differ.
        many = int(np.count_nonzero(seconds)) >= PERTURBED
        if many and float(seconds.sum()) >= PERTURBED * MOVES_OUT:
            return False
    return True


@naming_unsolvable(SESSION_FILE)
def close_loop(
    folder: Path, out: Path, progress: Callable[[str], None] = lambda _: None
) -> dict[str, Any]:
    """Analyse the session in `folder` and write `REPORT_FILES` to `out`; return the report.

    Everything is made beside `out` first: after an error nothing is there.

    Raises:
        SessionError: the session cannot be analysed.
        OSError: `out` cannot be written.
    """
    if out.exists() and not out.is_dir():
        raise NotADirectoryError(ENOTDIR, "is a file, not a folder for the report", str(out))
    found = analyse(folder, progress)
    report = found.report
    for trial in found.recording.session.trials:
        report["warnings"] += [f"{trial.file}: {repair}" for repair in trial.repairs]
    report["warnings"] += said_of_unread(found.recording.session.unknown)
    report["warnings"] += doubtful_units(found.recording)
    report["warnings"] += doubtful_gravity(found.recording)
    report["warnings"] += doubtful_guesses(found.recording)
    xml, elements, warnings = repaired_model(found.recording.device, report)
    for effect, element in zip(report["effects"], elements, strict=False):
        effect["mujoco_element"] = element
    report["warnings"] += warnings
    if report["verdict"] == Verdict.EFFECT_FOUND:
        progress("the repaired model in simulation")
        confirmation, simulation = confirm(found.recording, report, xml)
        repaired = {effect["joint"] for effect in report["effects"]}
        report["warnings"] += unconfirmed(confirmation, repaired)
        report["confirmation"] = finite(confirmation)
        report["simulation"] = simulation
    progress("report")
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=out.parent, prefix=".close-loop-") as scratch:
        fresh = Path(scratch)
        (fresh / "report.json").write_text(
            json.dumps(report, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
        )
        (fresh / "model_after.xml").write_text(xml)
        write_residuals(fresh / "residuals.csv", found)
        write_page(fresh / "report.html", found)
        out.mkdir(exist_ok=True)
        for name in REPORT_FILES:
            shutil.move(str(fresh / name), str(out / name))
    return report


def write_residuals(path: Path, found: Answer) -> None:
    """Write effort and residual before and after of every trial, raw samples."""
    recording = found.recording
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["file", "role", "joint", "time", "effort", "before", "after"])
        after = {(error.trial, error.joint): error for error in found.after}
        for error in found.before:
            trial = recording.session.trials[error.trial]
            other: TrialError = after[error.trial, error.joint]
            name = recording.name(error.joint)
            table = np.column_stack([error.time, error.effort, error.residual, other.residual])
            for row in table:
                writer.writerow([trial.file, trial.role, name, *(f"{x:.6g}" for x in row)])
