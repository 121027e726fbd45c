"""Human ankles that a servo steps at random: are reflexes found, and what stiffness is left?

`python -m benchmarks.closeloop.ankles FOLDER`

FOLDER is a clone of github reklab/reklab_public (R. E. Kearney, McGill University; GPL-2). It holds
five recordings of 60 s of a healthy subject's ankle, while dorsi- or plantarflexors are contracted:
position and torque in a stiff servo that steps by 0.06 rad (Kearney, Stein and Parameswaran 1997).
Three quarters are fitted, the last one is held out.
"""

import argparse
import csv
import json
import struct
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat
from scipy.signal import butter, sosfiltfilt

from analysis.closeloop.loop import close_loop
from benchmarks.machine import describe_machine

FILE = "stiffnessID/experimental_data.mat"
#: In the order of the file: muscles that are contracted, as its demonstrations call the records.
RECORDS = ("z_df", "z_pf", "z_df2", "z_df3", "z_pf2")
RATE, SAMPLES, PARTS = 1000.0, 60_000, 4
#: Of a foot and its pedal about the ankle, kg m2: a guess, as whoever declares it makes one.
INERTIA = 0.0075
#: Low-pass of the motion in least squares, Hz, and speed over which its friction turns, rad/s.
BAND, TURNS = 50.0, 0.02


def records(path: Path) -> list[np.ndarray]:
    """Return every record of the file, (n, 2): position, rad, and torque, Nm.

    They are held in objects of MATLAB classes, which SciPy returns as they are stored.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        stored = loadmat(path)["__function_workspace__"].tobytes()
    # The dimensions of a matrix, an empty name, and doubles that follow.
    mark = struct.pack("<IIiiIIII", 5, 8, SAMPLES, 2, 1, 0, 9, 16 * SAMPLES)
    found, place = [], stored.find(mark)
    while place >= 0:
        place += len(mark)
        found.append(np.frombuffer(stored, "<f8", 2 * SAMPLES, place).reshape(2, -1).T)
        place = stored.find(mark, place)
    return found


def write_session(folder: Path, record: np.ndarray) -> None:
    """Write a record as a session of four trials, with the torque that the servo takes."""
    time = np.arange(SAMPLES) / RATE
    table = np.column_stack([time, record[:, 0], -record[:, 1]])
    trials = []
    for number, part in enumerate(np.array_split(table, PARTS)):
        name = f"part{number + 1}.csv"
        header = "time,ankle.position,ankle.effort"
        np.savetxt(folder / name, part, delimiter=",", header=header, comments="", fmt="%.9g")
        trials.append({"file": name, "role": "holdout" if number == PARTS - 1 else "fit"})
    (folder / "device.xml").write_text(
        '<mujoco><option gravity="0 0 0"/><worldbody><body><joint name="ankle" axis="0 0 1"/>'
        f'<inertial pos="0 0 0" mass="1" diaginertia="{INERTIA} {INERTIA} {INERTIA}"/></body>'
        "</worldbody></mujoco>"
    )
    session = {
        "schema": 1,
        "model": "device.xml",
        "declared_effects": [{"effect": "viscoelastic_joint", "joint": "ankle"}],
        "sensors": {"ankle.effort": {"calibrated": True}},
        "trials": trials,
    }
    (folder / "session.json").write_text(json.dumps(session))


def least_squares(record: np.ndarray) -> float:
    """Return the held-out error of stiffness, viscosity, inertia, offset and friction, Nm."""
    low = butter(4, BAND, fs=RATE, output="sos")
    position = sosfiltfilt(low, record[:, 0])
    velocity = np.gradient(position, 1.0 / RATE)
    columns = np.column_stack(
        [
            position,
            velocity,
            np.gradient(velocity, 1.0 / RATE),
            np.ones(SAMPLES),
            np.tanh(velocity / TURNS),
        ]
    )
    fitted = SAMPLES * (PARTS - 1) // PARTS
    found = np.linalg.lstsq(columns[:fitted], -record[:fitted, 1])[0]
    return float(np.sqrt(np.mean((-record[fitted:, 1] - columns[fitted:] @ found) ** 2)))


def errors(path: Path) -> tuple[float, float]:
    """Return the held-out errors of the declared and the repaired model, of all samples, Nm."""
    with path.open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["role"] == "holdout"]
    before, after = (np.array([float(row[name]) for row in rows]) for name in ("before", "after"))
    return float(np.sqrt(np.nanmean(before**2))), float(np.sqrt(np.nanmean(after**2)))


def print_answer(name: str, report: dict[str, Any], plain: float, out: Path) -> None:
    before, after = errors(out / "residuals.csv")
    print(f"\n{name}: {report['verdict']}")
    print("  held-out error: declared, least squares, closed loop")
    print(f"  {before:.3f} {plain:.3f} {after:.3f} Nm" + ("" if after <= plain else "  WORSE"))
    for effect in report["effects"]:
        print(f"  {effect['name']}")
        for key, entry in effect["parameters"].items():
            value = "not determined" if entry["value"] is None else f"{entry['value']:.4g}"
            low, high = entry["ci90"] or (np.nan, np.nan)
            print(f"    {key:20s} {value} [{low:.4g}, {high:.4g}] {entry['unit']}")
    for joint, impedance in report["impedance"].items():
        own = impedance["stiffness"]
        told = report["identified"][joint]["stiffness"]
        low, high = own["ci90_after"]
        print(
            f"  stiffness {own['before']:.1f} -> {own['after']:.1f} [{low:.1f}, {high:.1f}] "
            f"Nm/rad, {'identified' if told else 'not identified'}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("folder", type=Path, help="clone of reklab_public")
    path = parser.parse_args().folder / FILE
    print(describe_machine())
    for name, record in zip(RECORDS, records(path), strict=True):
        with tempfile.TemporaryDirectory(prefix="rehyb-ankles-") as scratch:
            folder = Path(scratch)
            write_session(folder, record)
            report = close_loop(folder, folder / "out")
            print_answer(name, report, least_squares(record), folder / "out")


if __name__ == "__main__":
    main()
