"""Arms of the da Vinci research kit, which nothing here was made for.

`python -m benchmarks.closeloop.dvrk FOLDER`, the folder of a clone

Public recordings, github WPI-AIM/dvrk_dynamics_identification (Wang, Gondokaryono, Munawar and
Fischer 2019, A convex optimization-based dynamic model identification package for the da Vinci
research kit): 200 Hz, 30 s each, efforts from the drives' currents. Lengths and angles between axes
are the authors'; masses, centres and inertias are made up, as nobody publishes them.
"""

import argparse
import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from analysis.closeloop.load import load_session
from analysis.closeloop.session.signals import lowpass
from benchmarks.closeloop.arms import print_arm, read_residuals
from benchmarks.machine import describe_machine

RATE = 200.0
PSM = ("yaw", "pitch", "insertion")
MTM = ("yaw", "shoulder", "elbow", "platform", "wrist_pitch", "wrist_yaw", "wrist_roll")
#: Hz and s: the authors' low-pass, the period of their trajectories, and what its ends need.
BAND, PERIOD, SETTLED = 5.4, 1.0 / 0.18, 0.2
#: What their convex fit of all seven joints leaves of the first three on the same trajectory, in
#: their notebook `main_psm.ipynb`.
PUBLISHED = (0.0929, 0.1783, 0.1907)
#: Axes of the patient side manipulator meet in one point, which its parallelogram holds still; a
#: counterweight balances what slides. Up is where its instrument goes out to.
PSM_MODEL = """<mujoco><option gravity="0 0 9.81"/><worldbody>
<body name="yaw_link"><joint name="yaw" axis="0 1 0"/>
<inertial mass="1" pos="0 0 0.1" diaginertia="0.02 0.02 0.02"/>
<body name="pitch_link"><joint name="pitch" axis="-1 0 0"/>
<inertial mass="1" pos="0 0.1 0.1" diaginertia="0.02 0.02 0.02"/>
<body name="tool"><joint name="insertion" type="slide" axis="0 0 -1"/>
<inertial mass="0.3" pos="0 0 0.3" diaginertia="0.002 0.002 0.002"/>
</body></body></body></worldbody></mujoco>
"""
#: Of the master tool manipulator (Craig's convention) a, m, alpha, quarter turns, d, m, and the
#: angle at zero, quarter turns; then mass, kg, and centre, m.
MTM_LINKS = """
0     0 -.2154 0  2   0    0   .1
0    -1  0     1  1   .14  0   0
.2794 0  0     1  .6  .18  0   0
.3645 -1 .151  0  .3  0    0  -.05
0     1  0     0  .2  0   .03  0
0    -1  0     1  .2  0    0  -.03
0    -1  0     2  .1  0    0   .03
"""
#: What the angles of the elbow and the platform take of the motors' before them.
COUPLED = {(2, 1): -1.0, (3, 1): 0.6697, (3, 2): -0.6697}


def write_psm(folder: Path, source: Path, *, load: str = "", model: str = PSM_MODEL) -> None:
    """Write the first three axes of the patient side manipulator.

    Args:
        folder: new.
        source: a clone.
        load: grams of a weight on the pitching frame that one trial carries, "105" or "205".
        model: its MJCF.
    """
    folder.mkdir(parents=True)
    log = source / "data/psm/measured_trajectory"
    first = "one_no_weight_results" if load else "one_results"
    _write_trial(folder / "one.csv", log / f"{first}.csv", PSM, np.eye(3))
    trials: list[dict[str, Any]] = [{"file": "one.csv"}]
    if load:
        loaded = source / "data/psm_simplified/measured_trajectory"
        loaded /= f"one_results_1.0_scale_{load}_grams_insertion.csv"
        _write_trial(folder / "loaded.csv", loaded, PSM, np.eye(3))
        payload = {"name": "weight", "body": "pitch_link"}
        trials.append({"file": "loaded.csv", "payload": payload})
    _write_trial(folder / "two.csv", log / "two_results.csv", PSM, np.eye(3))
    _finish(folder, model, [*trials, {"file": "two.csv", "role": "holdout"}])


def write_mtm(folder: Path, source: Path) -> None:
    """Write all axes of the master tool manipulator: one trajectory to fit, another held out."""
    folder.mkdir(parents=True)
    log = source / "data/mtm/measured_trajectory"
    coupled = np.eye(len(MTM))
    for axes, share in COUPLED.items():
        coupled[axes] = share
    for name in ("one", "two"):
        _write_trial(folder / f"{name}.csv", log / f"{name}_results.csv", MTM, coupled)
    bodies = ""
    for joint, line in zip(MTM, MTM_LINKS.split("\n")[1:-1], strict=True):
        a, alpha, d, zero, mass, *centre = (float(word) for word in line.split())
        tilt, turn = np.pi / 4 * alpha, np.pi / 4 * zero
        place = (a, -d * np.sin(2 * tilt), d * np.cos(2 * tilt))
        frame = (
            *(np.cos(tilt) * np.cos(turn), np.sin(tilt) * np.cos(turn)),
            *(-np.sin(tilt) * np.sin(turn), np.cos(tilt) * np.sin(turn)),
        )
        bodies += (
            f'<body name="{joint}_link" pos="{_words(place)}" quat="{_words(frame)}">'
            f'<joint name="{joint}"/><inertial mass="{mass:g}" pos="{_words(centre)}" '
            f'diaginertia="{_words([0.004 * mass] * 3)}"/>'
        )
    model = f"<mujoco><worldbody>{bodies}{'</body>' * len(MTM)}</worldbody></mujoco>"
    _finish(folder, model, [{"file": "one.csv"}, {"file": "two.csv", "role": "holdout"}])


def _write_trial(path: Path, log: Path, joints: Sequence[str], coupled: np.ndarray) -> None:
    """Write angles and efforts of some joints, which are `coupled` times the motors' angles."""
    table, count = np.loadtxt(log, delimiter=","), len(joints)
    clock = np.arange(len(table)) / RATE
    angle = table[:, :count] @ coupled.T
    effort = table[:, 14 : 14 + count] @ np.linalg.inv(coupled)
    names = ["time", *(f"{j}.position" for j in joints), *(f"{j}.effort" for j in joints)]
    both = np.column_stack([clock, angle, effort])
    np.savetxt(path, both, delimiter=",", header=",".join(names), comments="", fmt="%.9g")


def _finish(folder: Path, model: str, trials: Sequence[dict[str, Any]]) -> None:
    (folder / "robot.xml").write_text(model)
    content = {"schema": 1, "model": "robot.xml", "trials": list(trials)}
    (folder / "session.json").write_text(json.dumps(content))


def _words(numbers: Sequence[float]) -> str:
    return " ".join(f"{number:.8g}" for number in numbers)


def relative_errors(session: Path, report: Path) -> list[float]:
    """Return every joint's held-out error over its effort, both below `BAND`, in one period."""
    after = read_residuals(report / "residuals.csv", load_session(session))["after"]
    own = slice(int(SETTLED * RATE), int((SETTLED + PERIOD) * RATE))
    pairs = [[lowpass(one, BAND, RATE)[own] for one in (e.residual, e.effort)] for e in after]
    return [float(np.linalg.norm(left) / np.linalg.norm(effort)) for left, effort in pairs]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("source", metavar="FOLDER", type=Path)
    source = parser.parse_args().source
    print(describe_machine())
    with tempfile.TemporaryDirectory(prefix="rehyb-dvrk-") as name:
        folder = Path(name)
        write_psm(folder / "psm", source)
        print_arm("Patient side manipulator", folder / "psm", folder / "psm-out", BAND)
        found = ", ".join(f"{x:.3f}" for x in relative_errors(folder / "psm", folder / "psm-out"))
        print(f"  relative errors {found}; published {', '.join(f'{x:.3f}' for x in PUBLISHED)}")
        repaired = (folder / "psm-out" / "model_after.xml").read_text()
        for model, of in ((PSM_MODEL, "made up"), (repaired, "as repaired above")):
            for load in ("105", "205"):
                name = f"{load} {of}"
                write_psm(folder / name, source, load=load, model=model)
                title = f"Patient side manipulator, {load} g, links {of}"
                print_arm(title, folder / name, folder / f"{name} out", BAND)
        write_mtm(folder / "mtm", source)
        print_arm("Master tool manipulator", folder / "mtm", folder / "mtm-out", BAND)


if __name__ == "__main__":
    main()
