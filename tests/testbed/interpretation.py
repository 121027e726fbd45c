"""A measured session as a clinic would record it, of a simulated movement."""

import json
from pathlib import Path

import numpy as np

from sim.assessment.record import Record

JOINTS = ("J1", "J2", "J3", "J4")


def written_session(
    folder: Path, record: Record, *, without: str = "", model: str = "nominal"
) -> Path:
    """Write a session of one trial into a folder, and return that.

    Args:
        folder: empty.
        record: of an assessment.
        without: what is left of columns whose names end so.
        model: declared of the robot.
    """
    columns = {"time": record.time}
    for i, joint in enumerate(JOINTS):
        columns[f"{joint}.position"] = record.theta[:, i]
        columns[f"{joint}.velocity"] = record.theta_velocity[:, i]
        columns[f"{joint}.effort"] = record.motor_torque[:, i]
    columns = {
        name: values for name, values in columns.items() if not name.endswith(without or "~")
    }
    table = np.column_stack(list(columns.values()))
    np.savetxt(
        folder / "down.csv",
        table,
        delimiter=",",
        header=",".join(columns),
        comments="",
        fmt="%.12g",
    )
    said = {"schema": 1, "model": model, "trials": [{"file": "down.csv", "label": "down"}]}
    (folder / "session.json").write_text(json.dumps(said))
    return folder
