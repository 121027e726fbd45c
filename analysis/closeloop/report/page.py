"""The report as one page that needs nothing else: tables, and pictures drawn into it.

Its tables are in `analysis/reports/templates/close_loop.html`.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.closeloop.report.answer import Answer
from analysis.closeloop.report.preview import preview, remarks
from analysis.reports.html import data_uri, render
from sim.pictures.figures import even_panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_POINTS = 4000
MAX_TRIALS = 12

VERDICTS = {
    "adequate": "Nothing is missing: the residual of the declared model is at its floor.",
    "effect_found": "The declared model lacked an effect; it was found and added.",
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


def _evidence(found: Answer, joint: int) -> "Figure":
    recording = found.recording
    figure, panels = even_panels(1, 3, width=10.0, height=3.4, labelled=0.2)
    velocity, position, acceleration = panels[0]
    signals = (
        (velocity, recording.velocity, "velocity"),
        (position, recording.position, "position"),
        (acceleration, recording.acceleration, "acceleration"),
    )
    for errors, colour, label in (
        (found.before, "tab:red", "before"),
        (found.after, "tab:blue", "after"),
    ):
        residual = np.full(len(recording.time), np.nan)
        for error in errors:
            if error.joint == joint:
                rows = recording.trial == error.trial
                residual[rows] = np.interp(recording.time[rows], error.time, error.residual)
        residual = recording.filtered(np.nan_to_num(residual))
        step = max(1, len(residual) // MAX_POINTS)
        for axes, signal, _ in signals:
            axes.plot(
                signal[::step, joint], residual[::step], ".", ms=1.5, color=colour, label=label
            )
    for axes, _, name in signals:
        axes.set_xlabel(name)
        axes.axhline(0, color="0.7", lw=0.5)
    velocity.set_ylabel("residual")
    velocity.legend(frameon=False, markerscale=6)
    return figure


def _trials(found: Answer, joint: int) -> "Figure":
    pairs = [(b, a) for b, a in zip(found.before, found.after, strict=True) if b.joint == joint][
        :MAX_TRIALS
    ]
    figure, panels = even_panels(len(pairs), 1, width=10.0, height=1.5 * len(pairs))
    for axes, (before, after) in zip(panels[:, 0], pairs, strict=True):
        step = max(1, len(before.time) // MAX_POINTS)
        trial = found.recording.session.trials[before.trial]
        for event in _events(found, joint, trial.file):
            axes.axvspan(event["from"], event["to"], color="gold", alpha=0.4, lw=0)
        axes.plot(before.time[::step], before.residual[::step], color="tab:red", lw=0.6)
        axes.plot(after.time[::step], after.residual[::step], color="tab:blue", lw=0.6)
        axes.set_title(f"{trial.label} ({trial.role})", fontsize=8, loc="left")
        axes.tick_params(labelsize=7)
    return figure


def _events(found: Answer, joint: int, file: str) -> list[dict[str, Any]]:
    """Return the events of a joint in a file."""
    entry = found.report["unexplained"].get(found.recording.name(joint), {"events": []})
    return [event for event in entry["events"] if event["file"] == file]
