"""Further recordings of two real arms: what is named, and how true it is.

`python -m benchmarks.closeloop.unseen FOLDER`

FOLDER is a clone of github SedkiLmm/dynamic-identification (MIT licence). It holds recordings of
the UR10e of Mamedov and Mikhel 2020 and of a Kinova Gen3, each joint alone and all together, with
torque by current and, in one recording, by torque sensors. Nine of the UR10e's were used while this
was built, of which three are here: two joints alone, and the first pose's pushes. Its URDF is
looked for where `tests.testbed.sessions.recordings` says.
"""

import argparse
import json
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.closeloop.arms import print_arm, write_session
from benchmarks.machine import describe_machine
from tests.testbed.sessions.recordings import measured_folder, ur10e_columns

#: Bands in which errors are compared, Hz.
UR10E_BAND, GEN3_BAND = 8.0, 10.0
WEIGHT = {"name": "weight", "body": "wrist_3_link"}
#: Further recordings of the UR10e, by session: file, role, and what else is said of the trial.
UR10E_SESSIONS: Mapping[str, Sequence[tuple[str, dict[str, Any]]]] = {
    "2.805 kg in another trajectory; the log begins with damaged lines": (
        ("identification_data/ur-20_02_19_15harm50sec", {}),
        (
            "identification_data/ur-20_02_19_15harm50secLoad",
            {"payload": WEIGHT, "from": 3049.0, "to": 3200.0},
        ),
        ("identification_data/ur-20_02_12-40sec_12harm", {}),
        ("identification_data/ur-20_02_12-50sec_12harm", {"role": "holdout"}),
    ),
    "a load that is not told, three weeks earlier": (
        ("identification_data/ur-20_01_31-unload", {}),
        ("identification_data/ur-20_01_31-load", {"payload": WEIGHT}),
        ("identification_data/ur-20_02_05-20sec_12harm", {}),
        ("identification_data/ur-20_02_05-20sec_8harm", {"role": "holdout"}),
    ),
    "a file named load_2600": (
        ("identification_data/ur-20_01_31-unload", {}),
        ("identification_data/ur-20_01_13-load_2600", {"payload": WEIGHT}),
        ("identification_data/ur-20_02_05-20sec_12harm", {}),
        ("identification_data/ur-20_02_05-20sec_8harm", {"role": "holdout"}),
    ),
    "each joint alone, other poses held out": (
        *((f"jointwise_motion/ur-20_01_22-joint_{number}", {}) for number in range(1, 7)),
        ("validation_data/ur-20_01_17-ptp_10_points", {"role": "holdout"}),
    ),
    "somebody pushes, first pose": (
        ("identification_data/ur-20_02_05-20sec_12harm", {}),
        ("collision/ur-20_01_22-push_pose_1", {}),
        ("identification_data/ur-20_02_05-20sec_8harm", {"role": "holdout"}),
    ),
    "somebody pushes, second pose": (
        ("identification_data/ur-20_02_05-20sec_12harm", {}),
        ("collision/ur-20_01_22-push_pose_2", {}),
        ("identification_data/ur-20_02_05-20sec_8harm", {"role": "holdout"}),
    ),
}
#: The Gen3's links as its maker publishes them (MuJoCo Menagerie, kinova_gen3): place and turn of
#: the frame, mass, centre of mass, principal axes and moments.
GEN3 = """
0 0 .15643  -3.67321e-06 1 0 0  1.3773  -2.3e-05 -.010364 -.07336
  .707051 .0451246 -.0453544 .704263  .00488868 .00457 .00135132
0 .005375 -.12838  .707105 .707108 0 0  1.1636  -4.4e-05 -.09958 -.013278
  .482348 .516286 -.516862 .483366  .0113017 .011088 .00102532
0 -.21038 -.006375  .707105 -.707108 0 0  1.1636  -4.4e-05 -.006641 -.117892
  .706144 .0213722 -.0209128 .707437  .0111633 .010932 .00100671
0 .006375 -.21038  .707105 .707108 0 0  .9302  -1.8e-05 -.075478 -.015006
  .483678 .515961 -.515859 .483455  .00834839 .008147 .000598606
0 -.20843 -.006375  .707105 -.707108 0 0  .6781  1e-06 -.009432 -.063883
  .703558 .0707492 -.0707492 .703558  .00165901 .001596 .000346988
0 .00017505 -.10593  .707105 .707108 0 0  .6781  1e-06 -.045483 -.00965
  .44426 .550121 -.550121 .44426  .00170087 .001641 .00035013
0 -.10593 -.00017505  .707105 -.707108 0 0  .364  -9.3e-05 .000132 -.022905
  -.0368025 .719402 -.0444884 .69219  .00024027 .000222769 .000213961
"""
GRIPPER = {"name": "tool", "body": "link7"}
TRAJECTORIES = ("Trajectory1", "RecordTrajectory_quadratic", "RunTrajectory1")


def write_more_ur10e(
    folder: Path, source: Path, recordings: Sequence[tuple[str, dict[str, Any]]]
) -> None:
    """Write a session of further recordings of the UR10e."""
    measured = measured_folder()
    if measured is None:
        raise SystemExit("no URDF of the UR10e: set REHYB_MEASURED")
    folder.mkdir(parents=True)
    shutil.copy(measured / "ur10e" / "ur10e.urdf", folder / "robot.urdf")
    trials = []
    for path, more in recordings:
        shutil.copy(source / f"data/ur5/{path}.csv", folder)
        trials.append({"file": f"{Path(path).name}.csv", **more})
    content = {"schema": 1, "model": "robot.urdf", "columns": {"map": ur10e_columns()}}
    (folder / "session.json").write_text(json.dumps(content | {"trials": trials}))


def write_gen3(
    folder: Path, source: Path, trials: Sequence[dict[str, Any]], effort: str, joints: range
) -> None:
    """Write a session of the Kinova Gen3, whose logs count milliseconds.

    Args:
        folder: new.
        source: the clone.
        trials: with the path of a file below `data/kinova`.
        effort: name of the columns: by current, or by the sensors at the joints' outputs.
        joints: numbers of those that have an effort.
    """
    folder.mkdir(parents=True)
    (folder / "gen3.xml").write_text(gen3())
    columns: dict[str, Any] = {"time": {"from": "Time", "scale": 1e-3}}
    for number in range(1, 8):
        columns[f"joint{number}.position"] = f"Position{number}"
        if number in joints:
            columns[f"joint{number}.effort"] = f"{effort}{number}"
    for trial in trials:
        path = source / "data/kinova" / trial["file"]
        shutil.copy(path, folder)
        trial["file"] = path.name
    write_session(folder, "gen3.xml", trials)
    content = json.loads((folder / "session.json").read_text())
    (folder / "session.json").write_text(json.dumps(content | {"columns": {"map": columns}}))


def gen3() -> str:
    """Return the Gen3 as MJCF."""
    bodies, numbers = "", np.array(GEN3.split()).reshape(7, -1)
    for number, row in enumerate(numbers, start=1):
        words = [" ".join(part) for part in np.split(row, [3, 7, 8, 11, 15])]
        place, turn, mass, centre, axes, moments = words
        bodies += (
            f"<body name='link{number}' pos='{place}' quat='{turn}'>"
            f"<joint name='joint{number}' axis='0 0 1'/><inertial mass='{mass}' pos='{centre}' "
            f"quat='{axes}' diaginertia='{moments}'/>"
        )
    return f"<mujoco><worldbody>{bodies}{'</body>' * 7}</worldbody></mujoco>"


def gen3_sessions() -> dict[str, tuple[list[dict[str, Any]], str, range]]:
    """Return sessions of the Gen3: trials, columns of efforts, and their joints."""
    run = "identification_data/RunTrajectory1.csv"
    alone = [f"jointwise_motion/joint_{number}_trapez.csv" for number in range(1, 8)]
    ends = (0.0, 0.647, 1.294, 1.941)
    thirds = [
        {"file": run, "from": a, "to": b, "group": str(a), "payload": GRIPPER}
        for a, b in pairwise(ends)
    ]
    thirds[1]["role"] = "holdout"
    together = [{"file": f"identification_data/{name}.csv"} for name in TRAJECTORIES]
    together[-1]["role"] = "holdout"
    return {
        "each joint alone in one direction, by current, trajectories held out": (
            [
                *({"file": path} for path in alone),
                *({**trial, "role": "holdout"} for trial in together),
            ],
            "TorqueCur",
            range(1, 8),
        ),
        "each joint alone and trajectories, by current": (
            [*({"file": path} for path in alone), *together],
            "TorqueCur",
            range(1, 8),
        ),
        "a tool nobody declared, by the joints' torque sensors": (thirds, "TorqueSm", range(2, 8)),
    }


def beside_sensors(source: Path) -> list[str]:
    """Return what lies between the Gen3's currents and its torque sensors, a line for each joint.

    Friction and inertia of motor and gear: a constant, velocity and acceleration fitted to their
    difference where the joint moves, by least squares, with no model of the arm at all.
    """
    table = np.genfromtxt(
        source / "data/kinova/identification_data/RunTrajectory1.csv", delimiter=",", names=True
    )
    lines = []
    for number in range(2, 8):
        position = np.convolve(table[f"Position{number}"], np.ones(41) / 41, mode="same")
        velocity = np.gradient(position, 1e-3)
        acceleration = np.gradient(np.convolve(velocity, np.ones(41) / 41, mode="same"), 1e-3)
        moving = np.abs(velocity) > 0.1
        moving[:50] = moving[-50:] = False
        columns = np.column_stack([np.ones(len(velocity)), velocity, acceleration])[moving]
        between = (table[f"TorqueCur{number}"] - table[f"TorqueSm{number}"])[moving]
        level, damping, inertia = np.linalg.lstsq(columns, between, rcond=None)[0]
        lines.append(f"joint{number}: {level:.2f} Nm, {damping:.2f} Nm s/rad, {inertia:.2f} kg m2")
    return lines


def events_of(report: Path) -> list[str]:
    """Return the events of a report, a line each."""
    found = json.loads((report / "report.json").read_text())["unexplained"]
    return [
        f"{joint}: {event['file']}, {event['from']:.2f} to {event['to']:.2f} s, "
        f"{event['peak']:.1f} {entry['unit']}"
        for joint, entry in found.items()
        for event in entry["events"]
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("source", metavar="FOLDER", type=Path)
    source = parser.parse_args().source
    print(describe_machine())
    with tempfile.TemporaryDirectory(prefix="rehyb-unseen-") as name:
        for place, (title, recordings) in enumerate(UR10E_SESSIONS.items()):
            own = Path(name) / f"ur10e_{place}"
            write_more_ur10e(own / "session", source, recordings)
            print_arm(f"UR10e, {title}", own / "session", own / "out", UR10E_BAND)
            print("".join(f"  event at {line}\n" for line in events_of(own / "out")), end="")
        for place, (title, arguments) in enumerate(gen3_sessions().items()):
            own = Path(name) / f"gen3_{place}"
            write_gen3(own / "session", source, *arguments)
            print_arm(f"Kinova Gen3, {title}", own / "session", own / "out", GEN3_BAND)
            print_values(own / "out")
    print("\nKinova Gen3, between currents and sensors, least squares (Coulomb, viscous, rotor):")
    print("\n".join(f"  {line}" for line in beside_sensors(source)))


def print_values(report: Path) -> None:
    """Print what a report says of friction, offsets and inertia."""
    content = json.loads((report / "report.json").read_text())
    for effect in content["effects"]:
        for key, entry in effect["parameters"].items():
            if entry["value"] is not None and entry["ci90"] is not None:
                low, high = entry["ci90"]
                print(
                    f"  {effect['name']} of {effect['joint']}: {key} {entry['value']:.3g} "
                    f"({low:.3g} to {high:.3g}) {entry['unit']}"
                )


if __name__ == "__main__":
    main()
