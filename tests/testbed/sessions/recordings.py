"""Sessions made of real recordings: a positioning axis with a worn screw, and healthy elbows.

They are not part of the repository: REHYB_MEASURED names their folder, or they lie in
`shared/measured` beside or above the checkout.
"""

import csv
import json
import os
import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np


def measured_folder() -> Path | None:
    """Return where the recordings are, or None."""
    if named := os.environ.get("REHYB_MEASURED"):
        return Path(named)
    root = Path(__file__).resolve().parents[3]
    places = (parent / "shared" / "measured" for parent in (root, *root.parents))
    return next((place for place in places if place.is_dir()), None)


def write_emps(folder: Path, measured: Path, joint: str, declared: tuple[str, ...] = ()) -> None:
    """Write a session of the positioning axis with `joint` attributes declared to a new folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("train", "test_pulses"):
        table = np.loadtxt(measured / "emps" / f"emps_{name}.csv", delimiter=",", skiprows=1)
        np.savetxt(
            folder / f"{name}.csv",
            table[:, [0, 2, 4]],
            delimiter=",",
            header="time,slide.position,slide.effort",
            comments="",
            fmt="%.9g",
        )
    (folder / "device.xml").write_text(
        f'<mujoco><worldbody><body name="carriage"><joint name="slide" type="slide" axis="1 0 0" '
        f'{joint}/><geom type="box" size=".1 .1 .1" mass="95.1"/></body></worldbody></mujoco>'
    )
    session = {
        "schema": 1,
        "model": "device.xml",
        "declared_effects": [{"effect": effect, "joint": "slide"} for effect in declared],
        "trials": [{"file": "train.csv"}, {"file": "test_pulses.csv", "role": "holdout"}],
    }
    (folder / "session.json").write_text(json.dumps(session))


def write_elbows(folder: Path, measured: Path) -> None:
    """Write a session of constant-velocity stretches of healthy elbows to a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    path = measured / "elbow_stretch" / "healthy_constant_velocity.csv"
    with path.open() as file:
        rows = list(csv.DictReader(file))
    trials, clock = [], 0.0
    for name in dict.fromkeys(row["trial"] for row in rows):
        table = np.array(
            [
                [clock + float(r["t_s"]), np.radians(float(r["angle_deg"])), float(r["torque_Nm"])]
                for r in rows
                if r["trial"] == name
            ]
        )
        clock = table[-1, 0] + 2.0
        header = "time,elbow.position,elbow.effort"
        np.savetxt(folder / f"{name}.csv", table, delimiter=",", header=header, comments="")
        trials.append({"file": f"{name}.csv", "group": name})
    (folder / "device.xml").write_text(
        '<mujoco><option gravity="0 0 0"/><worldbody><body name="forearm"><joint name="elbow" '
        'axis="0 0 1"/><geom type="capsule" fromto="0 0 0 .25 0 0" size=".03" mass="0.001"/>'
        "</body></worldbody></mujoco>"
    )
    session = {
        "schema": 1,
        "model": "device.xml",
        "declared_effects": [{"effect": "viscoelastic_joint", "joint": "elbow"}],
        "trials": trials,
    }
    (folder / "session.json").write_text(json.dumps(session))


#: Joints of the UR10e, and what its controller says of torque over current, Nm/A.
UR10E = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
UR10E_GAINS = (11.976, 11.976, 9.839, 10.763, 10.763, 10.69)


def ur10e_columns() -> dict[str, object]:
    """Return which column of a log of the UR10e is which signal."""
    columns: dict[str, object] = {"time": 1}
    for number, (joint, gain) in enumerate(zip(UR10E, UR10E_GAINS, strict=True)):
        columns[f"{joint}.position"] = 2 + number
        columns[f"{joint}.effort"] = {"from": 14 + number, "scale": gain}
    return columns


def write_ur10e(folder: Path, measured: Path, roles: Mapping[str, str], load: str = "") -> None:
    """Write a session of the UR10e, from its bare URDF and the drives' currents, to a folder.

    Args:
        folder: new.
        measured: where the recordings are.
        roles: of each recording by its name without `.csv`.
        load: the recording with the payload at the flange, if it is one of them.
    """
    folder.mkdir(parents=True, exist_ok=True)
    source = measured / "ur10e"
    shutil.copy(source / "ur10e.urdf", folder / "robot.urdf")
    trials = []
    for name, role in roles.items():
        shutil.copy(source / f"{name}.csv", folder)
        trial: dict[str, object] = {"file": f"{name}.csv", "role": role}
        if name == load:
            trial["payload"] = {"name": "weight", "body": "wrist_3_link"}
        trials.append(trial)
    session = {
        "schema": 1,
        "model": "robot.urdf",
        "columns": {"map": ur10e_columns()},
        "trials": trials,
    }
    (folder / "session.json").write_text(json.dumps(session))
