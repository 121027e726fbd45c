"""The report as one page that needs nothing else: tables, and pictures drawn into it.

Its tables are in `analysis/reports/templates/close_loop.html`.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.closeloop.identification.balance.trial_error import TrialError
from analysis.closeloop.report.answer import Answer
from analysis.closeloop.report.preview import LABEL, legend_above, name_axes, preview, remarks
from analysis.reports.html import data_uri, render
from sim.pictures.figures import even_panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_POINTS = 4000
MAX_TRIALS = 12
EVENT, UNCHANGED = "event", "before = after: nothing is repaired"

VERDICTS = {
    "adequate": "Nothing is missing: the residual of the declared model is at its floor.",
    "effect_found": "What the declared model lacked was found and added.",
    "unexplained": "Something is left that no catalogued effect explains.",
    "not_identifiable": "An effect is there, but these trials cannot name it.",
}


def write_page(path: Path, found: Answer) -> None:
    """Write the report as HTML with its pictures inside."""
    recording = found.recording
    page = render(
        "close_loop.html",
        title=f"Closing the loop: {found.report['session']['folder']}",
        verdict=VERDICTS[found.report["verdict"]],
        report=found.report,
        most_trials=MAX_TRIALS,
        evidence={
            recording.device.joints[joint]: {
                "signals": _image(_evidence(found, joint)),
                "trials": _image(_trials(found, joint)),
            }
            for joint in recording.joints
        },
        trials=[
            {
                "label": trial.label,
                "role": trial.role,
                "noticed": remarks(recording, number),
                "picture": _image(preview(recording, number)) if number < MAX_TRIALS else "",
            }
            for number, trial in enumerate(recording.session.trials)
        ],
    )
    path.write_text(page, encoding="utf-8")


def _image(figure: "Figure") -> str:
    return data_uri(figure, "png", dpi=90)


def _models(found: Answer) -> list[tuple[list[TrialError], str, str]]:
    """Return the errors to draw, each with its name and colour: one where nothing is repaired."""
    pairs = zip(found.before, found.after, strict=True)
    if all(np.array_equal(before.predicted, after.predicted) for before, after in pairs):
        return [(found.before, UNCHANGED, "tab:red")]
    return [(found.before, "before", "tab:red"), (found.after, "after", "tab:blue")]


def _evidence(found: Answer, joint: int) -> "Figure":
    """Draw a joint's low-passed residual over its velocity, position and acceleration."""
    recording = found.recording
    name = recording.name(joint)
    angle, unit = recording.device.angle_unit(name), recording.device.unit(name)
    figure, panels = even_panels(1, 3, width=10.0, height=3.6, labelled=LABEL)
    signals = (
        (f"velocity, {angle}/s", recording.velocity),
        (f"position, {angle}", recording.position),
        (f"acceleration, {angle}/s²", recording.acceleration),
    )
    models = _models(found)
    for errors, word, colour in models:
        residual = _low_passed(found, errors, joint)
        step = max(1, len(residual) // MAX_POINTS)
        for axes, (_, signal) in zip(panels[0], signals, strict=True):
            axes.plot(
                signal[::step, joint], residual[::step], ".", ms=1.5, color=colour, label=word
            )
    for axes, (label, _) in zip(panels[0], signals, strict=True):
        axes.axhline(0, color="0.7", lw=0.5, zorder=0)
        name_axes(axes, label, f"residual, {unit}")
    legend_above(panels[0, -1], panels[0, 0].lines[: len(models)])
    return figure


def _low_passed(found: Answer, errors: Sequence[TrialError], joint: int) -> np.ndarray:
    """Return a joint's residual as the fit sees it, Nm or N; NaN where it has no effort, (n,)."""
    recording = found.recording
    residual = np.full(len(recording.time), np.nan)
    for error in errors:
        if error.joint == joint:
            rows = recording.trial == error.trial
            residual[rows] = np.interp(recording.time[rows], error.time, error.residual)
    return np.where(np.isnan(residual), np.nan, recording.filtered(np.nan_to_num(residual)))


def _trials(found: Answer, joint: int) -> "Figure":
    """Draw a joint's residual over the time of each trial, with its events."""
    models = _models(found)
    own = [
        [error for error in errors if error.joint == joint][:MAX_TRIALS] for errors, _, _ in models
    ]
    count = len(own[0])
    figure, panels = even_panels(count, 1, width=10.0, height=1.8 * count, labelled=LABEL)
    unit = found.recording.device.unit(found.recording.name(joint))
    bands = []
    for axes, *errors in zip(panels[:, 0], *own, strict=True):
        trial = found.recording.session.trials[errors[0].trial]
        # The edge keeps a short event in sight.
        bands += [
            axes.axvspan(event["from"], event["to"], fc="gold", ec="gold", alpha=0.5, label=EVENT)
            for event in _events(found, errors[0])
        ]
        for error, (_, word, colour) in zip(errors, models, strict=True):
            step = max(1, len(error.time) // MAX_POINTS)
            axes.plot(error.time[::step], error.residual[::step], color=colour, lw=0.6, label=word)
        axes.set_title(f"{trial.label} ({trial.role})", fontsize=9, loc="left")
        name_axes(axes, "time, s", f"residual, {unit}")
    legend_above(panels[0, 0], [*panels[0, 0].lines, *bands[:1]])
    return figure


def _events(found: Answer, error: TrialError) -> list[dict[str, Any]]:
    """Return the events of a joint in a trial; a file may hold several trials."""
    recording = found.recording
    file = recording.session.trials[error.trial].file
    entry = found.report["unexplained"].get(recording.name(error.joint), {"events": []})
    return [
        event
        for event in entry["events"]
        if event["file"] == file
        and event["from"] <= error.time[-1]
        and event["to"] >= error.time[0]
    ]
