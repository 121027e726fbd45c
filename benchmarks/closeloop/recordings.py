"""What closing the loop finds in real recordings, and its errors next to published ones.

`python -m benchmarks.closeloop.recordings`, where the recordings are
(`tests.testbed.sessions.recordings`).
"""

import sys
import tempfile
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from analysis.closeloop.loop import close_loop
from benchmarks.machine import describe_machine
from tests.testbed.sessions.recordings import measured_folder, write_elbows, write_emps

#: What is declared of the axis; published values of Janot, Gautier and Brunot 2019.
FITTED = ("coulomb_friction", "viscous_friction", "torque_offset")
PUBLISHED = 'frictionloss="20.39" damping="203.5"'


def print_report(title: str, report: Mapping[str, Any]) -> None:
    """Print verdict, names, errors on held-out trials and impedance of a report."""
    names = ", ".join(effect["name"] for effect in report["effects"])
    print(f"\n{title}: {report['verdict']} {names}", flush=True)
    for joint, error in report["error"]["holdout"].items():
        for name, value in error.items():
            if isinstance(value, float):
                print(f"  {joint}, held out: {name:24s} {value:8.4f}")
    for joint, impedance in report["impedance"].items():
        for name in ("stiffness", "damping"):
            value = impedance[name]
            print(f"  {joint}: {name} before {value['before']:.3f}, after {value['after']:.3f}")
    for joint, left in report["unexplained"].items():
        low, high = left["band_hz"]
        print(f"  {joint}: unexplained {left['rms']:.2f}, {low:.0f} to {high:.0f} Hz")


def main(measured: Path) -> None:
    print(describe_machine())
    sessions: Mapping[str, Callable[[Path], None]] = {
        "EMPS, published friction declared": partial(
            write_emps, measured=measured, joint=PUBLISHED
        ),
        "EMPS, the same form fitted": partial(
            write_emps, measured=measured, joint="", declared=FITTED
        ),
        "Elbows": partial(write_elbows, measured=measured),
    }
    for title, write in sessions.items():
        with tempfile.TemporaryDirectory(prefix="rehyb-recordings-") as name:
            folder = Path(name) / "session"
            write(folder)
            print_report(title, close_loop(folder, Path(name) / "out"))


if __name__ == "__main__":
    found = measured_folder()
    if found is None:
        sys.exit("no measured recordings: set REHYB_MEASURED to their folder")
    main(found)
