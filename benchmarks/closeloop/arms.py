"""Whole arms: held-out errors of every joint next to a least-squares fit of the same samples.

`python -m benchmarks.closeloop.arms [--panda FOLDER] [--pendulum FOLDER]`

The UR10e's recordings are where `tests.testbed.sessions.recordings` finds them. The other two are
public: github marcocognetti/FrankaEmikaPandaDynModel (Gaz et al. 2019) and
dfki-ric-underactuated-lab/double_pendulum, each named by the folder of a clone. Thresholds were set
while looking at the UR10e and the positioning axis (`benchmarks.closeloop.recordings`), never at
these two.
"""

import argparse
import csv
import json
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from analysis.closeloop.identification.balance.accuracy import raw_errors
from analysis.closeloop.identification.balance.trial_error import TrialError
from analysis.closeloop.load import load_session
from analysis.closeloop.loop import close_loop
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.signals import lowpass, rms
from benchmarks.machine import describe_machine
from tests.testbed.sessions.recordings import measured_folder, write_ur10e

#: Band in which errors are compared, Hz.
BAND = {"UR10e": 8.0, "Panda": 5.0, "Double pendulum": 8.0}
#: Width of the step of the reference's friction, over the root mean square of the velocity.
STEP = 0.02
#: The Panda's links as Gaz et al. 2019 retrieved them: place of the joint, quarter turns about x,
#: mass, centre of mass, inertia about it (xx, yy, zz, xy, xz, yz).
PANDA = """
0 0 .333  0 4.970684 .003875 .002081 -.04762 .70337 .70661 .009117 -.000139 .006772 .019169
0 0 0 -1 0.646926 -.003141 -.02872 .003495 .007962 .02811 .025995 -.003925 .010254 .000704
0 -.316 0 1 3.228604 .027518 .039252 -.066502 .037242 .036155 .01083 -.004761 -.011396 -.012805
.0825 0 0 1 3.587895 -.05317 .104419 .027454 .025853 .019552 .028323 .007796 -.001332 .008641
-.0825 .384 0 -1 1.225946 -.011953 .041065 -.038437 .035549 .029474 .008627 -.002117 -.004037 2e-4
0 0 0  1 1.666555 .060149 -.014117 -.010517 .001964 .004354 .005433 .000109 -.001158 .000341
.088 0 0  1 0.735522 .010517 -.004252 .061597 .012516 .010027 .004815 -.000428 -.001196 -.000741
"""


def panda_links(prefix: str) -> str:
    """Return the Panda as MJCF, with its joints numbered after a prefix."""
    bodies = ""
    for number, line in enumerate(PANDA.split("\n")[1:-1], start=1):
        x, y, z, turn, mass, *rest = line.split()
        bodies += (
            f"<body name='link{number}' pos='{x} {y} {z}' quat='1 {turn} 0 0'>"
            f"<joint name='{prefix}{number}' axis='0 0 1'/><inertial mass='{mass}' "
            f"pos='{' '.join(rest[:3])}' fullinertia='{' '.join(rest[3:])}'/>"
        )
    return (
        "<mujoco><compiler balanceinertia='true'/><worldbody>"
        f"{bodies}{'</body>' * 7}</worldbody></mujoco>"
    )


def write_panda(folder: Path, source: Path) -> None:
    """Write the Panda's exciting trajectory: 14 s to fit, the last 7 s held out."""
    log = source / "matlab/data/Exciting_Traj/Trajectory_1/rbt_log"
    clock, position, effort = (
        np.loadtxt(log / f"exciting_traj_{name}.txt") for name in ("time", "positions", "torques")
    )
    joints = [f"joint{number}" for number in range(1, 8)]
    table = np.column_stack([clock, position.reshape(-1, 7), effort.reshape(-1, 7)])
    names = ["time", *(f"{j}.position" for j in joints), *(f"{j}.effort" for j in joints)]
    write_table(folder / "trajectory.csv", names, table)
    (folder / "panda.xml").write_text(panda_links("joint"))
    write_session(
        folder,
        "panda.xml",
        [
            {"file": "trajectory.csv", "to": 14.0},
            {"file": "trajectory.csv", "from": 14.001, "role": "holdout"},
        ],
    )


def write_pendulum(folder: Path, source: Path) -> None:
    """Write the double pendulum's trajectories: four to fit, two held out."""
    log = source / "data/experiment_records/design_C.0/20220914/sys_id"
    trials = []
    for number in range(6):
        name = f"trajectory_{number:02d}.csv"
        with (log / name).open() as file:
            rows = list(csv.DictReader(file))
        signals = ("time", "pos_meas1", "pos_meas2", "tau_meas1", "tau_meas2")
        table = np.array([[float(row[signal]) for signal in signals] for row in rows])
        table[:, 0] += 100.0 * number
        names = ["time", "Joint1.position", "Joint2.position", "Joint1.effort", "Joint2.effort"]
        write_table(folder / name, names, table[np.append(True, np.diff(table[:, 0]) > 0)])
        trials.append({"file": name, "role": "fit" if number < 4 else "holdout"})
    model = "data/system_identification/identified_parameters/design_C.0/model_3.1/acrobot.urdf"
    # The file names its world without declaring it.
    urdf = (source / model).read_text().replace("<joint ", '<link name="world"/><joint ', 1)
    (folder / "pendulum.urdf").write_text(urdf)
    write_session(folder, "pendulum.urdf", trials)


def write_table(path: Path, names: Sequence[str], table: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(path, table, delimiter=",", header=",".join(names), comments="", fmt="%.9g")


def shorten(folder: Path, seconds: float, write: Callable[[Path], None]) -> None:
    """Write a session of logs without a header of which every trial ends after some seconds."""
    write(folder)
    content = json.loads((folder / "session.json").read_text())
    for trial in content["trials"]:
        with (folder / trial["file"]).open() as file:
            trial["to"] = float(next(csv.reader(file))[0]) + seconds
    (folder / "session.json").write_text(json.dumps(content))


def write_session(folder: Path, model: str, trials: Sequence[dict[str, Any]]) -> None:
    content = {"schema": 1, "model": model, "trials": list(trials)}
    (folder / "session.json").write_text(json.dumps(content))


def least_squares(recording: Recording) -> np.ndarray:
    """Return the effort of the declared chain with offset, viscous and Coulomb friction fitted.

    Joint by joint, over every low-passed sample of the trials that may be fitted, (n, joints).
    """
    predicted = np.full_like(recording.position, np.nan)
    fitted = np.isin(recording.trial, recording.fit_trials)
    for joint in recording.joints:
        v = recording.velocity[:, joint]
        sign = np.tanh(v / (STEP * rms(v)))
        columns = np.column_stack([np.ones(len(v)), v, sign])
        smooth = recording.filtered(columns)[fitted]
        residual = recording.effort - recording.filtered(recording.rigid)
        found = np.linalg.lstsq(smooth, residual[fitted, joint], rcond=None)[0]
        predicted[:, joint] = recording.rigid[:, joint] + columns @ found
    return predicted


def in_band(errors: Sequence[TrialError], joint: int, band: float, rate: float) -> float:
    """Return the root mean square of one joint's error below `band` Hz."""
    parts = []
    for error in errors:
        if error.joint == joint:
            even = np.arange(error.time[0], error.time[-1], 1.0 / rate)
            left = np.interp(even, error.time, error.residual)
            parts.append(lowpass(left, band, rate)[int(rate / band) : -int(rate / band)])
    return rms(np.concatenate(parts))


def held_out_errors(
    recording: Recording, residuals: Path, band: float
) -> dict[str, tuple[float, float, float]]:
    """Return the error of every joint in held-out trials, below `band` Hz, in its own unit.

    As declared, of a least-squares fit, and with the loop closed.

    Args:
        recording: the session.
        residuals: what its analysis wrote, `residuals.csv`.
        band: in Hz.
    """
    holdouts = tuple(
        number for number, trial in enumerate(recording.session.trials) if trial.role == "holdout"
    )
    after = read_residuals(residuals, recording)
    simple = raw_errors(recording, least_squares(recording), holdouts)
    rate = recording.sampling.recorded
    return {
        recording.name(joint): (
            in_band(after["before"], joint, band, rate),
            in_band(simple, joint, band, rate),
            in_band(after["after"], joint, band, rate),
        )
        for joint in recording.joints
    }


def print_arm(title: str, folder: Path, out: Path, band: float) -> None:
    """Close the loop on a session and print errors below `band` Hz, names and payloads."""
    recording = load_session(folder)
    started = time.perf_counter()
    report = close_loop(folder, out)
    seconds = time.perf_counter() - started
    print(f"\n{title}: {report['verdict']}, {seconds:.0f} s", flush=True)
    print(f"  held-out error below {band:g} Hz: declared, least squares, closed loop")
    for name, values in held_out_errors(recording, out / "residuals.csv", band).items():
        mark = "" if values[2] <= values[1] else "  WORSE than least squares"
        names = [e["name"] for e in report["effects"] if e["joint"] == name]
        print(
            f"  {name:20s} {values[0]:7.3f} {values[1]:7.3f} {values[2]:7.3f} "
            f"{recording.device.unit(name)}{mark}  {', '.join(names)}"
        )
    for entry in report["declared"]:
        mass, place = (entry["parameters"][name] for name in ("mass", "position"))
        if mass["value"] is None:
            continue
        at = ", ".join("not known" if way is None else f"{way:.3f}" for way in place["value"])
        low, high = mass["ci90"]
        print(
            f"  payload {entry['name']}: {mass['value']:.3f} kg ({low:.3f} to {high:.3f}) "
            f"at ({at}) m of {entry['body']}"
        )
    for line in report["warnings"]:
        print(f"  {line}")


def read_residuals(path: Path, recording: Recording) -> dict[str, list[TrialError]]:
    """Return the errors of held-out trials before and after as the report's file has them."""
    with path.open() as file:
        rows = list(csv.DictReader(file))
    found: dict[str, list[TrialError]] = {"before": [], "after": []}
    for number, trial in enumerate(recording.session.trials):
        for joint in recording.joints:
            own = [
                [float(row[key]) for key in ("time", "effort", "before", "after")]
                for row in rows
                if row["role"] == "holdout"
                and row["file"] == trial.file
                and row["joint"] == recording.name(joint)
            ]
            if own and trial.role == "holdout":
                clock, effort, *left = np.array(own).T
                for word, residual in zip(("before", "after"), left, strict=True):
                    found[word].append(
                        TrialError(
                            trial=number,
                            joint=joint,
                            time=clock,
                            effort=effort,
                            predicted=effort - residual,
                        )
                    )
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--panda", type=Path)
    parser.add_argument("--pendulum", type=Path)
    chosen = parser.parse_args()
    sessions: dict[str, Callable[[Path], None]] = {}
    measured = measured_folder()
    if measured is not None:
        test = {"unloaded_20s_7harm": "holdout"}
        fit = {"pair_unloaded": "fit", "unloaded_20s_10harm": "fit"}
        bare = partial(write_ur10e, measured=measured, roles=fit | test)
        sessions["UR10e, bare URDF"] = bare
        sessions["UR10e, 60 s of it"] = partial(shorten, seconds=20.0, write=bare)
        roles = {"pair_unloaded": "fit", "pair_loaded": "fit", "unloaded_20s_10harm": "fit"}
        sessions["UR10e, 2.805 kg at the flange"] = partial(
            write_ur10e, measured=measured, roles=roles | test, load="pair_loaded"
        )
    if chosen.panda is not None:
        sessions["Panda"] = partial(write_panda, source=chosen.panda)
    if chosen.pendulum is not None:
        sessions["Double pendulum"] = partial(write_pendulum, source=chosen.pendulum)
    if not sessions:
        sys.exit("no recordings: set REHYB_MEASURED, or name --panda or --pendulum")
    print(describe_machine())
    for title, write in sessions.items():
        with tempfile.TemporaryDirectory(prefix="rehyb-arms-") as name:
            write(Path(name) / "session")
            print_arm(title, Path(name) / "session", Path(name) / "out", BAND[title.split(",")[0]])


if __name__ == "__main__":
    main()
