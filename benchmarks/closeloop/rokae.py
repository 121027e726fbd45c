"""Two arms of Rokae with torque sensors in seven joints, from their makers' bare URDF.

Public recordings: github NKU-ZiXuan/xMate7p_dyn_ident (three trajectories of 20 s at 50 Hz; no
commercial use), whose notebook says what its fit of all base parameters leaves, and
FrankJIE09/Dynamics_identification_Frank (an AR5 at a wall, 60 s at 50 Hz), with the friction that
its author found.
"""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np

from analysis.closeloop.load import load_session
from analysis.closeloop.session.signals import rms
from benchmarks.closeloop.arms import read_residuals, write_session, write_table

#: What the authors' least squares of base parameters, friction and rotors leaves of the effort, %.
XMATE_LEFT = (3.04, 3.84)
#: The AR5's joints, and the Coulomb friction that its author found, Nm.
AR5 = tuple(f"AR5-5_07R-W4C4A2_joint_{number}" for number in range(1, 8))
AR5_COULOMB = (0.287, 0.284, 0.284, 0.498, 0.154, 0.440, 0.102)
#: Seconds that are fitted of its 60.
AR5_SPLIT = 40.0


def write_xmate(folder: Path, source: Path) -> None:
    """Write the xMate7p's three trajectories: one to fit, two held out."""
    folder.mkdir()
    data, joints = source / "data", [f"joint{number}" for number in range(1, 8)]
    columns = ["time", *(f"{n}.{what}" for what in ("position", "effort") for n in joints)]
    trials: list[dict[str, Any]] = []
    for number in (1, 2, 3):
        (log,) = (data / "recdata").glob(f"50Hz 1*/xMate7p_traj{number}_results.csv")
        table = np.loadtxt(log, delimiter=",")
        table = np.column_stack([np.arange(len(table)) / 50.0, table[:, :7], table[:, 21:]])
        write_table(folder / f"{number}.csv", columns, table)
        trials.append({"file": f"{number}.csv"} | ({"role": "holdout"} if number > 1 else {}))
    shutil.copy(data / "robotparams/XM7p/urdf/XM7p.urdf", folder / "robot.urdf")
    write_session(folder, "robot.urdf", trials)


def print_relative(folder: Path) -> None:
    """Print the error of raw samples over the effort, of all joints together, by held-out trial.

    Away from the ends as its authors measure, 3 s after the start and 1 s before the end.
    """
    after = read_residuals(folder / "out/residuals.csv", load_session(folder))["after"]
    said = []
    for trial in sorted({error.trial for error in after}):
        own = [error for error in after if error.trial == trial]
        begun, ended = own[0].time[[0, -1]]
        inside = [e.where((e.time > begun + 3.0) & (e.time < ended - 1.0)) for e in own]
        left = rms(np.concatenate([error.residual for error in inside]))
        said.append(f"{100 * left / rms(np.concatenate([error.effort for error in inside])):.2f}")
    fitted = " and ".join(f"{share:.2f}" for share in XMATE_LEFT)
    print(f"  of the effort {' and '.join(said)} % are left, of their own fit {fitted} %")


def write_ar5(folder: Path, source: Path, *, gravity: bool) -> None:
    """Write the AR5's trajectory; its end is held out.

    Args:
        folder: of the session.
        source: a clone of the repository.
        gravity: whether the session says how the arm hangs; its URDF stands upright.
    """
    folder.mkdir()
    log = source / "src/config/dynamics_identification_data_real.csv"
    table = np.loadtxt(log, delimiter=",", skiprows=1)
    table = np.column_stack([table[:, :8], table[:, 22:]])
    columns = ["time", *(f"{joint}.{what}" for what in ("position", "effort") for joint in AR5)]
    write_table(folder / "motion.csv", columns, table)
    shutil.copy(source / "urdf/AR5-5_07R-W4C4A2.urdf", folder / "robot.urdf")
    later = {"file": "motion.csv", "from": AR5_SPLIT + 0.01, "role": "holdout"}
    write_session(folder, "robot.urdf", [{"file": "motion.csv", "to": AR5_SPLIT}, later])
    if gravity:
        path = folder / "session.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | {"gravity": [9.81, 0, 0]}))
