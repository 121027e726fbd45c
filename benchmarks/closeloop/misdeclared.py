"""How often a wrong sign, exchanged columns or another gravity of a robot are noticed.

`python -m benchmarks.closeloop.misdeclared [--first N] [--arms N]` draws arms of the unkind bench,
tuning seeds: clean, with effects and pushed. Each is asked as it is, with one joint's effort turned
round after the other, with each pair of neighbours' efforts exchanged, and with the gravity of a
device on its side and upside down. Thresholds were set before these arms were drawn.
"""

import argparse
import tempfile
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from analysis.closeloop.errors import SessionError
from analysis.closeloop.load import load_session
from analysis.closeloop.misdeclared import check_declared, doubtful_gravity
from analysis.closeloop.session.recording import Recording
from benchmarks.closeloop.unkind.cases import draw
from benchmarks.closeloop.unkind.judge import recorded
from benchmarks.machine import describe_machine

ASIDE = ((9.80665, 0.0, 0.0), (0.0, 0.0, 9.80665))


def refused(recording: Recording) -> str:
    """Return why a recording is refused; empty if it is not."""
    try:
        check_declared(recording)
    except SessionError as error:
        return str(error)
    return ""


def hung(recording: Recording, gravity: np.ndarray) -> Recording:
    """Return the recording of a device that hangs in another gravity than its model says, m/s2."""
    effort = np.array(recording.effort)
    for joint in recording.joints:
        further = recording.weight(joint) @ (gravity - recording.gravity)
        effort[:, joint] += recording.filtered(further[:, None])[:, 0]
    return replace(recording, effort=effort, cache={})


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--first", type=int, default=33000, metavar="N")
    parser.add_argument("--arms", type=int, default=80, metavar="N")
    chosen = parser.parse_args()
    right: list[bool] = []
    seen: dict[str, list[bool]] = {"turned round": [], "exchanged": [], "gravity": []}
    for number in range(chosen.first, chosen.first + chosen.arms):
        with tempfile.TemporaryDirectory(prefix="rehyb-misdeclared-") as name:
            folder = Path(name) / "session"
            if "flight" in recorded(draw("tuning", "arm", number), folder):
                continue
            recording = load_session(folder)
            right.append(bool(refused(recording) or doubtful_gravity(recording)))
            for joint in recording.joints:
                sign = np.where(np.arange(recording.position.shape[1]) == joint, -1.0, 1.0)
                turned = replace(recording, effort=recording.effort * sign, cache={})
                own = f"{recording.name(joint)}.effort"
                why = refused(turned)
                seen["turned round"].append(own in why and "opposite sign" in why)
            for one, other in pairwise(recording.joints):
                order = np.arange(recording.position.shape[1])
                order[[one, other]] = other, one
                swapped = replace(recording, effort=recording.effort[:, order], cache={})
                seen["exchanged"].append("exchanged" in refused(swapped))
            for gravity in ASIDE:
                seen["gravity"].append(bool(doubtful_gravity(hung(recording, np.array(gravity)))))
    print(describe_machine())
    print(f"tuning seeds from {chosen.first}, {len(right)} arms")
    print(f"something is said of {sum(right)} that are as declared")
    for what, found in seen.items():
        print(f"{what}: noticed in {sum(found)} of {len(found)}")


if __name__ == "__main__":
    main()
