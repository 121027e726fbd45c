"""The report as one page that needs nothing else: tables, and pictures drawn into it."""

import base64
import io
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.closeloop.report.answer import Answer
from analysis.closeloop.report.preview import preview, remarks
from sim.pictures.figures import new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_POINTS = 4000
MAX_TRIALS = 12

STYLE = """body{font:15px/1.5 system-ui,sans-serif;max-width:60em;margin:2em auto;padding:0 1em;
color:#222}table{border-collapse:collapse;margin:.8em 0}
td,th{padding:.2em .8em;border-bottom:1px solid #ddd;text-align:left}img{max-width:100%}
.verdict{font-size:1.4em}.muted{color:#666}"""

VERDICTS = {
    "adequate": "Nothing is missing: the residual of the declared model is at its floor.",
    "effect_found": "The declared model lacked an effect; it was found and added.",
    "unexplained": "Structure is left that no catalogued effect explains.",
    "not_identifiable": "An effect is there, but these trials cannot name it.",
}


def write_page(path: Path, found: Answer) -> None:
    """Write the report as HTML with its pictures inside."""
    report = found.report
    parts = [
        f"<p class=verdict>{escape(VERDICTS[report['verdict']])}</p>",
        _effects(report),
        _errors(report),
        _impedance(report),
        _confirmation(report),
        _unexplained(report),
        _list("What to record next", report["advice"]),
        _list("Warnings", report["warnings"]),
    ]
    for joint in found.recording.joints:
        name = found.recording.device.joints[joint]
        parts.append(f"<h2>Evidence: {escape(name)}</h2>")
        parts.append(_picture(_evidence(found, joint), f"residual of {name} against its signals"))
        parts.append(_picture(_trials(found, joint), f"residual of {name} per trial"))
    parts.append(_diagnostics(report))
    parts.append(_ladder(report))
    parts.append(_signals(found))
    title = f"Closing the loop: {escape(report['session']['folder'])}"
    path.write_text(
        f"<!doctype html><html lang=en><meta charset=utf-8><title>{title}</title>"
        f"<style>{STYLE}</style><body><h1>{title}</h1>{''.join(parts)}</body></html>\n",
        encoding="utf-8",
    )


def _table(head: list[str], rows: list[list[Any]]) -> str:
    cells = "".join(f"<th>{escape(cell)}" for cell in head)
    body = "".join("<tr>" + "".join(f"<td>{escape(_text(c))}" for c in row) for row in rows)
    return f"<table><tr>{cells}{body}</table>"


def _text(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list):
        return ", ".join(_text(item) for item in value)
    return str(value)


def _effects(report: dict[str, Any]) -> str:
    parts = []
    for effect in report["effects"]:
        evidence = effect["evidence"]
        parts.append(
            f"<h2>{escape(effect['name'])} at {escape(effect['joint'])}</h2>"
            f"<p>{escape(evidence['signature'])}. It explains "
            f"{100 * evidence['holdout_gain']:.0f} % of the held-out residual "
            f"(p {evidence['p_value']:.1g}).</p>"
        )
        parts.append(
            _table(
                ["parameter", "value", "90 % interval", "unit"],
                [[k, p["value"], p["ci90"], p["unit"]] for k, p in effect["parameters"].items()],
            )
        )
        if effect["indistinguishable_from"]:
            parts.append(
                f"<p>Looks the same in these trials: "
                f"{escape(', '.join(effect['indistinguishable_from']))}. "
                f"To tell them apart: {escape(_text(effect['separating_trial']))}.</p>"
            )
        parts.append(f"<p class=muted>In MuJoCo: {escape(effect['mujoco_element'])}</p>")
    return "".join(parts)


def _errors(report: dict[str, Any]) -> str:
    rows = [
        [where, joint, e["before"], e["after"], e["floor"], e["unit"]]
        for where, joints in report["error"].items()
        for joint, e in joints.items()
    ]
    return "<h2>Error</h2>" + _table(["trials", "joint", "before", "after", "floor", "unit"], rows)


def _impedance(report: dict[str, Any]) -> str:
    rows = [
        [joint, name, v["before"], v["ci90_before"], v["after"], v["ci90_after"], v["unit"]]
        for joint, values in report["impedance"].items()
        for name, v in values.items()
    ]
    head = ["joint", "", "before", "90 % interval", "after", "90 % interval", "unit"]
    return "<h2>Impedance (restoring)</h2>" + _table(head, rows) if rows else ""


def _confirmation(report: dict[str, Any]) -> str:
    keys = ("feedback_before", "feedback_after", "unit")
    more = ("deviation_before", "deviation_after", "deviation_unit")
    rows = [
        [joint, *(entry[key] for key in (*keys, *more))]
        for joint, entry in report.get("confirmation", {"joints": {}})["joints"].items()
    ]
    head = ["joint", "feedback before", "after", "unit", "deviation before", "after", "unit"]
    return "<h2>Simulated in closed loop</h2>" + _table(head, rows) if rows else ""


def _diagnostics(report: dict[str, Any]) -> str:
    rows = [
        [joint, signal, share, after["depends_on"][signal]]
        for joint, entry in report["diagnostics"].items()
        for before, after in [(entry["before"], entry["after"])]
        for signal, share in before["depends_on"].items()
    ]
    head = ["joint", "signal", "share of the residual's variance before", "after"]
    return "<h2>What the residual goes with</h2>" + _table(head, rows) if rows else ""


def _unexplained(report: dict[str, Any]) -> str:
    rows = [
        [joint, e["rms"], e["unit"], e["depends_on"], e["band_hz"]]
        for joint, e in report["unexplained"].items()
    ]
    head = ["joint", "rms", "unit", "depends on", "band, Hz"]
    return "<h2>Unexplained</h2>" + _table(head, rows) if rows else ""


def _list(title: str, lines: list[str]) -> str:
    items = "".join(f"<li>{escape(line)}" for line in lines)
    return f"<h2>{title}</h2><ul>{items}</ul>" if lines else ""


def _ladder(report: dict[str, Any]) -> str:
    parts = []
    for number, rungs in enumerate(report["ladder"], start=1):
        rows = [
            [r["name"], r["joint"], 100 * r["holdout_gain"], r["z"], r["refused"]]
            for r in rungs[:15]
        ]
        head = ["candidate", "joint", "held-out gain, %", "gain / its error", "refused because"]
        parts.append(f"<h2>Candidates for effect {number}</h2>" + _table(head, rows))
    return "".join(parts)


def _signals(found: Answer) -> str:
    """Draw what was recorded, and say what is noticed in it."""
    recording = found.recording
    parts = ["<h2>What was recorded</h2>"]
    for number, trial in enumerate(recording.session.trials):
        noticed = remarks(recording, number)
        parts.append(f"<h3>{escape(trial.label)} ({escape(trial.role)})</h3>")
        if noticed:
            parts.append("<ul>" + "".join(f"<li>{escape(line)}" for line in noticed) + "</ul>")
        if number < MAX_TRIALS:
            parts.append(_picture(preview(recording, number), f"signals of {trial.label}"))
    return "".join(parts)


def _evidence(found: Answer, joint: int) -> "Figure":
    recording = found.recording
    figure = new_figure(width=10.0, height=3.4)
    velocity, position, acceleration = (figure.add_subplot(1, 3, i) for i in (1, 2, 3))
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
    figure = new_figure(width=10.0, height=1.3 * len(pairs) + 0.5)
    for number, (before, after) in enumerate(pairs, start=1):
        axes = figure.add_subplot(len(pairs), 1, number)
        step = max(1, len(before.time) // MAX_POINTS)
        axes.plot(before.time[::step], before.residual[::step], color="tab:red", lw=0.6)
        axes.plot(after.time[::step], after.residual[::step], color="tab:blue", lw=0.6)
        trial = found.recording.session.trials[before.trial]
        axes.set_title(f"{trial.label} ({trial.role})", fontsize=8, loc="left")
        axes.tick_params(labelsize=7)
    return figure


def _picture(figure: "Figure", alternative: str) -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=90)
    content = base64.b64encode(buffer.getvalue()).decode()
    return f'<p><img alt="{escape(alternative)}" src="data:image/png;base64,{content}"></p>'
