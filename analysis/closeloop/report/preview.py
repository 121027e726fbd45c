"""What was recorded, trial by trial: a picture of the signals, and what is noticed in them."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from analysis.closeloop.session.recording import Recording
from intake.words import counted
from sim.pictures.figures import even_panels

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_POINTS = 3000
#: Room for the name of the axis below a panel, inches.
LABEL = 0.2
#: Spread of the sampling steps over their median from which on it is reported.
JITTER = 0.05
#: A signal of so few different values is a coarse one.
COARSE = 200
#: Share of the time at rest, or of the travel in the rarer direction, that is reported.
RESTING, ONE_WAY = 0.5, 0.05


def remarks(recording: Recording, number: int) -> list[str]:
    """Return what is noticed in the signals of one trial, in sentences.

    None of it is an error: gaps are left out, a jittered clock is evened, and a rest is no motion.
    """
    trial = recording.session.trials[number]
    pieces = recording.pieces_of(number)
    found = []
    steps = np.diff(trial.time)
    step = float(np.median(steps))
    used = sum(float(recording.time[p][-1] - recording.time[p][0]) for p in pieces)
    left_out = float(trial.time[-1] - trial.time[0]) - used
    if not pieces:
        found.append("is not used: no half second without a gap")
    elif len(pieces) > 1 or left_out > 0.5:
        parts = counted(len(pieces), "stretch is", "stretches are")
        found.append(f"has gaps: {parts} used, of {used:.1f} s in all")
    even = steps[steps < 5.0 * step]
    if float(even.std()) > JITTER * step:
        found.append(
            f"has a jittered clock: steps of {1e3 * step:.3g} ms vary by "
            f"{100 * float(even.std()) / step:.0f} %"
        )
    for joint in recording.joints:
        name = recording.name(joint)
        if f"{name}.effort" not in trial.columns:
            found.append(f"has no effort of {name}")
            continue
        levels = np.unique(trial.columns[f"{name}.effort"])
        if len(levels) < COARSE:
            unit = recording.device.unit(name)
            found.append(
                f"has a coarse effort of {name}: {len(levels)} values, "
                f"{float(np.diff(levels).min()):.2g} {unit} apart"
            )
        if pieces:
            found += _motion(recording, joint, pieces)
    return found


def _motion(recording: Recording, joint: int, pieces: list[slice]) -> list[str]:
    name = recording.name(joint)
    velocity = np.concatenate([recording.velocity[p, joint] for p in pieces])
    rest = float(np.concatenate([recording.resting(joint, p) for p in pieces]).mean())
    ways = np.maximum(velocity, 0.0).sum(), np.maximum(-velocity, 0.0).sum()
    found = []
    if rest > RESTING:
        found.append(f"rests {100 * rest:.0f} % of the time at {name}")
    if min(ways) < ONE_WAY * max(ways):
        found.append(f"moves {name} in one direction only")
    return found


def preview(recording: Recording, number: int) -> "Figure":
    """Draw position, velocity and effort of the analysed joints over one trial's time."""
    trial = recording.session.trials[number]
    joints = recording.joints
    figure, panels = even_panels(
        len(joints), 3, width=10.0, height=2.0 * len(joints), labelled=LABEL
    )
    pieces = recording.pieces_of(number)
    every = max(1, len(trial.time) // MAX_POINTS)
    for row, joint in zip(panels, joints, strict=True):
        name = recording.name(joint)
        angle, unit = recording.device.angle_unit(name), recording.device.unit(name)
        signals = (
            ("position", angle, recording.position),
            ("velocity", f"{angle}/s", recording.velocity),
            ("effort", unit, recording.effort),
        )
        for axes, (word, measure, smooth) in zip(row, signals, strict=True):
            raw = trial.columns.get(f"{name}.{word}")
            if raw is not None:
                axes.plot(trial.time[::every], raw[::every], color="0.7", lw=1.0, label="recorded")
            for piece in pieces:
                clock = recording.time[piece]
                axes.plot(clock, smooth[piece, joint], color="tab:blue", lw=0.8, label="analysed")
            name_axes(axes, "time, s", f"{word}, {measure}")
        row[0].set_title(name, fontsize=9, loc="left")
    # Every joint has a position; a stretch after a gap is a further line of the same name.
    legend_above(panels[0, -1], panels[0, 0].lines[:2])
    return figure


def name_axes(axes: "Axes", across: str, up: str) -> None:
    """Give the axes of a panel their names, each with its unit."""
    axes.set_xlabel(across, fontsize=9)
    axes.set_ylabel(up, fontsize=9)
    axes.tick_params(labelsize=8)


def legend_above(axes: "Axes", shown: Sequence["Artist"]) -> None:
    """Name what is shown in a row above a panel at its right end, where it hides nothing."""
    axes.legend(
        handles=list(shown),
        ncols=len(shown),
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        borderaxespad=0.1,
        markerscale=6,
        frameon=False,
        fontsize=9,
    )
