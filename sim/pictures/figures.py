"""Pictures of one assessment: the trial as curves, and the arm in the exoskeleton."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sim.assessment.assess import Assessment, fit_record, inferred_torques

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def new_figure(*, width: float, height: float) -> "Figure":
    """Return an empty figure (inches) that draws to a file without a display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


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
