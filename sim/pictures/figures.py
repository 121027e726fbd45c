"""Pictures of one assessment: the trial as curves, and the arm in the exoskeleton."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sim.assessment.assess import Assessment, fit_record, inferred_torques

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Room beside every panel of `even_panels` for ticks, labels and a title, inches.
LEFT, RIGHT, BELOW, ABOVE = 0.68, 0.08, 0.28, 0.22


def new_figure(*, width: float, height: float) -> "Figure":
    """Return an empty figure (inches) that draws to a file without a display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def even_panels(
    rows: int, columns: int, *, width: float, height: float, labelled: float = 0.0
) -> tuple["Figure", Any]:
    """Return a figure (inches) of panels of one size, and its axes, (rows, columns).

    Room for labels is given, not found: of many panels, finding it takes longer than drawing them.

    Args:
        rows: of panels.
        columns: of panels.
        width: of the figure.
        height: of the figure.
        labelled: height of what stands below the ticks of every panel.
    """
    figure = new_figure(width=width, height=height)
    figure.set_layout_engine(None)
    below = BELOW + labelled
    own_width, own_height = width / columns - LEFT - RIGHT, height / rows - below - ABOVE
    figure.subplots_adjust(
        left=LEFT / width,
        right=1.0 - RIGHT / width,
        bottom=below / height,
        top=1.0 - ABOVE / height,
        wspace=(LEFT + RIGHT) / own_width,
        hspace=(below + ABOVE) / own_height,
    )
    return figure, figure.subplots(rows, columns, squeeze=False)


def assessment_figure(assessment: Assessment, path: Path) -> Path:
    """Draw angles, torques, regression and contact forces of a recorded assessment; return `path`.

    Raises:
        ValueError: the assessment failed before its movement ended, so that there is no record.
    """
    record = assessment.record
    if record is None:
        raise ValueError(
            f"nothing was recorded: the assessment ended as {assessment.outcome} "
            f"({assessment.reason})"
        )
    inferred, _ = inferred_torques(record)
    estimate, truth = fit_record(record)["affine"]
    exo_angle, human_angle = record.theta[:, record.exo_joint], record.q[:, record.joint]
    theta, q = np.degrees(exo_angle), np.degrees(human_angle)
    figure = new_figure(width=10.0, height=7.0)
    angles, torques, scatter, forces = (figure.add_subplot(2, 2, i) for i in (1, 2, 3, 4))

    angles.plot(record.time, np.degrees(record.reference), "--", color="0.5", label="reference")
    angles.plot(record.time, theta, color="tab:blue", label="exoskeleton θ")
    angles.plot(record.time, q, color="tab:red", label="human q")
    angles.set(title="Joint angle", ylabel="angle (degrees)")

    torques.plot(record.time, inferred, color="tab:blue", label="inferred (equation 20)")
    torques.plot(record.time, record.human_torque, color="tab:red", label="human")
    motor = record.motor_torque[:, record.exo_joint]
    torques.plot(record.time, motor, color="0.5", linewidth=1, label="motor")
    torques.set(title="Torque about the joint", ylabel="torque (Nm)")

    scatter.plot(theta, inferred, color="tab:blue", label="inferred against θ")
    scatter.plot(q, record.human_torque, color="tab:red", label="human against q")
    for fit, angle, torque, colour, name in (
        (estimate, exo_angle, inferred, "tab:blue", "estimate"),
        (truth, human_angle, record.human_torque, "tab:red", "true"),
    ):
        ends = np.array([angle.min(), angle.max()])
        line = torque.mean() + fit.stiffness * (ends - angle.mean())
        label = f"{name} $K_h$ {fit.stiffness:.2f} Nm/rad"
        scatter.plot(np.degrees(ends), line, ":", color=colour, label=label)
    seen = "What the regression sees (velocity's share not drawn)"
    scatter.set(title=seen, xlabel="angle (degrees)", ylabel="torque (Nm)")

    for column, name in enumerate(("upper arm", "forearm")):
        forces.plot(record.time, record.loads.contact_force[:, column], label=name)
    forces.set(title="Force of cuff and strap on the arm", ylabel="resultant (N)")
    for axes in (angles, torques, forces):
        axes.set_xlabel("time since the movement began (s)")
    for axes in (angles, torques, scatter, forces):
        axes.legend(frameon=False, fontsize=8)
    figure.suptitle(f"Assessment: {assessment.outcome}")
    figure.savefig(path)
    return path
