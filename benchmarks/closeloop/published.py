"""Robots of which somebody published the friction: what is named, beside what they found.

`python -m benchmarks.closeloop.published FOLDER`

FOLDER holds clones of github thanhndv212/figaroh-examples as `figaroh` (Staubli TX40: 9 s at 5 kHz,
motor positions and torques; Apache licence), unisa-acg/inverse-dynamics-solver as `unisa` (UR10 and
Franka Panda: an exciting trajectory each, as ROS 2 bags; GPL), JonasWeigand/Robot_Identification as
`kuka` (`kr300`), NKU-ZiXuan/xMate7p_dyn_ident as `xmate` and
FrankJIE09/Dynamics_identification_Frank as `ar5` (`rokae`), and
YIZHIXIAOCANGSHU/Friction-Identification-for-Manipulators as `amd02` (an arm moved joint by joint,
each of which sticks and jumps). Who published the friction had these recordings or others of the
same robot; of the Panda another one. The UR10's published model is compiled, where there is g++,
for its error on the same held-out samples; of the KR300 the log has what its model feeds forward.
"""

import argparse
import json
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from analysis.closeloop.logs.reading import read_log
from analysis.closeloop.loop import close_loop
from analysis.closeloop.session.signals import rms
from benchmarks.closeloop import kr300, rokae
from benchmarks.closeloop.arms import (
    panda_links,
    print_arm,
    write_session,
    write_table,
)
from benchmarks.machine import describe_machine

#: Bands in which errors are compared, Hz.
TX40_BAND, UR10_BAND, PANDA_BAND, KR300_BAND, ROKAE_BAND = 20.0, 8.0, 8.0, 10.0, 8.0
#: The TX40's motors: turns a turn of the joint; the last one turns with joint 5, too.
TX40_GEARS = (32.0, 32.0, 45.0, -48.0, 45.0, 32.0)
TX40_SECONDS = 2e-4
#: Viscous (Nm s/rad) and Coulomb friction (Nm) by joint, as its `TX40_config.yaml` has them.
TX40_FRICTION = {
    "viscous_friction": (8.05, 5.53, 1.97, 1.11, 1.86, 0.65),
    "coulomb_friction": (7.14, 8.26, 6.34, 2.48, 3.03, 0.282),
}
#: The UR10 as ROS-Industrial describes it (BSD licence): place and pitch of the joint, its axis,
#: mass, height of the centre of mass, moments of inertia.
UR10 = """
shoulder_pan_joint   0 0 .1273       0           0 0 1  7.778 0      .0314743 .0314743 .0218756
shoulder_lift_joint  0 .220941 0     1.57079633  0 1 0  12.93 .306   .421754 .421754 .0363656
elbow_joint          0 -.1719 .612   0           0 1 0  3.87  .28615 .11107 .11107 .0108844
wrist_1_joint        0 0 .5723       1.57079633  0 1 0  1.96  0      .00510825 .00510825 .0055125
wrist_2_joint        0 .1149 0       0           0 0 1  1.96  0      .00510825 .00510825 .0055125
wrist_3_joint        0 0 .1157       0           0 1 0  .202  0      .000526462 .000526462 .00056813
"""
#: Nm/A, and friction in A (Petrone, Ferrentino and Chiacchio 2025, The dynamic model of the UR10
#: robot and its ROS2 integration): viscous, offset, step, and its slope and place in rad/s.
UR10_GAINS = np.array([13.5841, 14.2959, 11.3716, 11.2408, 11.7681, 11.7682])
UR10_FRICTION = np.array(
    [
        (1.064044, -1.006570, 2.050627, 7.946667, -0.018479),
        (0.994406, 0.956270, -2.401744, -59.953552, -0.001950),
        (0.679578, -0.811995, 1.647842, 19.825139, -0.005295),
        (0.315922, -0.176720, 0.468777, 134.898249, -0.018577),
        (0.224395, -0.192362, 0.475976, 331.442055, -0.011778),
        (0.235839, -0.245335, 0.597950, 459.193349, -0.012953),
    ]
)
#: Step of the Panda's friction, Nm (Gaz et al. 2019, another arm).
PANDA_STEP = (0.54615, 0.87224, 0.64068, 1.2794, 0.83904, 0.30301, 0.56489)
AMD02_JOINTS = ("second", "third", "fourth", "fifth", "sixth", "sixthoutput", "seventh")
#: Recordings of one joint each that move it to and fro, and Coulomb friction as its authors' report
#: on them has it, Nm; none of a joint of which they found none.
AMD02_COULOMB = {1: None, 3: 0.338, 4: 0.839, 6: 0.168, 7: 0.113}
MAIN = """#include "ur10_inverse_dynamics_solver/getCurrents.h"
#include <cstdio>
int main() {
  double v[18], i[6];
  for (;;) {
    for (double &x : v) if (scanf("%lf", &x) != 1) return 0;
    ur10_inverse_dynamics_solver::getCurrents(v, v + 6, v + 12, i);
    for (double x : i) printf("%.9g ", x);
  }
}
"""


def write_tx40(folder: Path, source: Path, trials: Sequence[dict[str, Any]]) -> None:
    """Write the TX40's recording at 1 kHz, its transmission undone as its maker built it."""
    robot = source / "figaroh/examples/staubli_TX40"
    motor, torque = (
        np.loadtxt(robot / f"data/{name}_data.csv", delimiter=",", skiprows=1)
        for name in ("pos_read", "curr")
    )
    turns = np.diag(TX40_GEARS)
    turns[5, 4] = TX40_GEARS[5]
    joint = motor @ np.linalg.inv(turns).T + np.pi / 2 * np.array([0, -1, 1, 0, 0, 0])
    time = TX40_SECONDS * np.arange(len(joint))
    names = [f"joint_{number}" for number in range(1, 7)]
    columns = ["time", *(f"{n}.position" for n in names), *(f"{n}.effort" for n in names)]
    write_table(folder / "motion.csv", columns, np.column_stack([time, joint, torque @ turns])[::5])
    shutil.copy(robot / "urdf/tx40_mdh_modified.urdf", folder / "robot.urdf")
    write_session(folder, "robot.urdf", trials)


def write_bag(folder: Path, bag: Path, model: str, split: float) -> np.ndarray:
    """Write a session of a bag's joint states; what comes after `split` s is held out.

    Returns:
        Time, positions, velocities and efforts, (n, 1 + 3 joints).
    """
    channels = read_log(bag).channels
    time = channels[0].time
    assert time is not None
    table = np.column_stack(
        [time, *(np.interp(time, c.time, c.values) for c in channels if c.time is not None)]
    )
    write_table(folder / "motion.csv", ["time", *(channel.name for channel in channels)], table)
    (folder / "robot.xml").write_text(model)
    trials = [{"file": "motion.csv", "to": split}]
    trials.append({"file": "motion.csv", "from": split + 1e-3, "role": "holdout"})
    write_session(folder, "robot.xml", trials)
    return table


def ur10() -> str:
    """Return the UR10 as MJCF."""
    bodies = ""
    for line in UR10.strip().splitlines():
        name, *words = line.split()
        place, axis = " ".join(words[:3]), " ".join(words[4:7])
        mass, height, moments = words[7], words[8], " ".join(words[9:])
        bodies += (
            f"<body name='{name.replace('joint', 'link')}' pos='{place}' euler='0 {words[3]} 0'>"
            f"<joint name='{name}' axis='{axis}'/><inertial mass='{mass}' pos='0 0 {height}' "
            f"diaginertia='{moments}'/>"
        )
    return (
        f"<mujoco><compiler angle='radian'/><worldbody>{bodies}{'</body>' * 6}</worldbody></mujoco>"
    )


def write_amd02(folder: Path, source: Path) -> None:
    """Write the AM-D02's recordings of one joint each, halves as groups."""
    names = [f"ArmL{name}_Joint" for name in AMD02_JOINTS]
    trials: list[dict[str, Any]] = []
    for number in AMD02_COULOMB:
        log = np.load(source / f"amd02/results/real_uart_capture_collect_joint_{number}.npz")
        table = np.column_stack([log["time"], log["q"], log["tau_measured"]])
        columns = ["time", *(f"{n}.position" for n in names), *(f"{n}.effort" for n in names)]
        write_table(folder / f"joint_{number}.csv", columns, table)
        middle = float(table[[0, -1], 0].mean())
        trials.append({"file": f"joint_{number}.csv", "to": middle, "group": f"{number}a"})
        trials.append({"file": f"joint_{number}.csv", "from": middle, "group": f"{number}b"})
    (urdf,) = (source / "amd02/am_d02_model/urdf").glob("*.urdf")
    shutil.copy(urdf, folder / "robot.urdf")
    write_session(folder, "robot.urdf", trials)


def print_left_out(title: str, folder: Path, out: Path) -> None:
    """Close the loop on a session without held-out trials and print what left-out groups lose."""
    report = close_loop(folder, out)
    print(f"\n{title}: {report['verdict']}\n  error of left-out groups: declared, closed loop")
    for joint, error in report["error"]["holdout"].items():
        print(f"  {joint:24s} {error['before']:7.3f} {error['after']:7.3f} {error['unit']}")


def print_beside(report: Path, joints: Sequence[str], known: Mapping[str, Sequence[Any]]) -> None:
    """Print named friction and offsets beside published ones, by effect in `known`."""
    effects = json.loads((report / "report.json").read_text())["effects"]
    for effect, values in known.items():
        for joint, value in zip(joints, values, strict=True):
            if value is None:
                continue
            print(f"  {effect} of {joint}: published {value:.3g}, {_found(effects, effect, joint)}")
    for entry in effects:
        if entry["name"] not in (*known, "link_inertia", "added_inertia"):
            found = {
                key: f"{p['value']:.3g} ({p['ci90'][0]:.3g} to {p['ci90'][1]:.3g})"
                for key, p in entry["parameters"].items()
                if p["value"] is not None and p["ci90"] is not None
            }
            said = ", ".join(f"{key} {text}" for key, text in found.items())
            print(f"  {entry['name']} of {entry['joint']}: {said}")


def _found(effects: Sequence[Mapping[str, Any]], effect: str, joint: str) -> str:
    """Return the first parameter of an effect in words."""
    for entry in effects:
        first = next(iter(entry["parameters"].values()))
        if entry["name"] == effect and entry["joint"] == joint and first["ci90"] is not None:
            low, high = first["ci90"]
            return f"found {first['value']:.3g} ({low:.3g} to {high:.3g})"
    return "not named"


def published_errors(source: Path, table: np.ndarray, split: float) -> str:
    """Return the error of the UR10's published model after `split` s, Nm, by joint."""
    package = source / "unisa/ur10_inverse_dynamics_solver"
    time, (q, v, effort) = table[:, 0], np.split(table[:, 1:], 3, axis=1)
    with tempfile.TemporaryDirectory() as name:
        (Path(name) / "main.cpp").write_text(MAIN)
        code = [str(Path(name) / "main.cpp"), str(package / "src/getCurrents.cpp")]
        made = ["g++", f"-I{package / 'include'}", *code, "-o", str(Path(name) / "currents")]
        try:
            subprocess.run(made, check=True)
        except FileNotFoundError:
            return "not computed: no g++"
        given = np.column_stack([q, v, np.gradient(v, time, axis=0)])
        text = "\n".join(" ".join(f"{x:.12g}" for x in row) for row in given)
        ran = subprocess.run(
            [str(Path(name) / "currents")], input=text, capture_output=True, text=True, check=True
        )
    viscous, offset, step, slope, place = UR10_FRICTION.T
    rubbing = viscous * v + offset + step / (1.0 + np.exp(-np.clip(slope * (v + place), -500, 500)))
    expected = UR10_GAINS * (np.array(ran.stdout.split(), dtype=float).reshape(-1, 6) + rubbing)
    left = (effort - expected)[time > split]
    return ", ".join(f"{rms(own):.2f}" for own in left.T)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("source", metavar="FOLDER", type=Path)
    source = parser.parse_args().source
    print(describe_machine())
    with tempfile.TemporaryDirectory(prefix="rehyb-published-") as name:
        held = [
            {"file": "motion.csv", "to": 6.0},
            {"file": "motion.csv", "from": 6.0005, "role": "holdout"},
        ]
        joints = [f"joint_{number}" for number in range(1, 7)]
        own = Path(name) / "tx40"
        own.mkdir()
        write_tx40(own, source, held)
        print_arm("Staubli TX40, the last 3 s held out", own, own / "out", TX40_BAND)
        print_beside(own / "out", joints, TX40_FRICTION)

        split, own = 18.0, Path(name) / "ur10"
        own.mkdir()
        bags = "ur10_inverse_dynamics_solver/bagfiles/ur10_exciting_trajectory.db3"
        table = write_bag(own, source / "unisa" / bags, ur10(), split)
        print_arm("UR10, the last 9.5 s held out", own, own / "out", UR10_BAND)
        print(f"  the published model leaves there {published_errors(source, table, split)} Nm")
        viscous, offset, step, *_ = UR10_FRICTION.T
        friction = {
            "viscous_friction": UR10_GAINS * viscous,
            "coulomb_friction": UR10_GAINS * np.abs(step) / 2.0,
            "torque_offset": UR10_GAINS * (offset + step / 2.0),
        }
        ur10_joints = [line.split()[0] for line in UR10.strip().splitlines()]
        print_beside(own / "out", ur10_joints, friction)

        split, own = 16.0, Path(name) / "panda"
        own.mkdir()
        bags = "franka_inria_inverse_dynamics_solver/bagfiles/panda_exciting_trajectory.db3"
        write_bag(own, source / "unisa" / bags, panda_links("fer_joint"), split)
        print_arm("Franka Panda at 30 Hz, the last 8 s held out", own, own / "out", PANDA_BAND)
        panda = [f"fer_joint{number}" for number in range(1, 8)]
        print_beside(own / "out", panda, {"coulomb_friction": [step / 2.0 for step in PANDA_STEP]})

        left = ", ".join(
            f"{own:.0f}" for own in kr300.fed_forward_errors(source / "kuka", KR300_BAND)
        )
        for balanced, title in ((False, "balancer and load"), (True, "load")):
            own = Path(name) / f"kr300-{balanced}"
            kr300.write(own, source / "kuka", balanced=balanced)
            print_arm(
                f"KUKA KR300, {title} undeclared, a run held out", own, own / "out", KR300_BAND
            )
            print(f"  what its authors' model feeds forward leaves there {left} Nm")
            friction = {"viscous_friction": kr300.VISCOUS, "coulomb_friction": kr300.COULOMB}
            print_beside(own / "out", kr300.JOINTS, friction)

        own = Path(name) / "xmate"
        rokae.write_xmate(own, source / "xmate")
        print_arm("Rokae xMate7p, two trajectories held out", own, own / "out", ROKAE_BAND)
        rokae.print_relative(own)

        for declared in (False, True):
            own = Path(name) / f"ar5-{declared}"
            rokae.write_ar5(own, source / "ar5", gravity=declared)
            title = "gravity declared, the last 20 s held out" if declared else "gravity downwards"
            print_arm(f"Rokae AR5 at a wall, {title}", own, own / "out", ROKAE_BAND)
            print_beside(own / "out", rokae.AR5, {"coulomb_friction": rokae.AR5_COULOMB})

        own = Path(name) / "amd02"
        own.mkdir()
        write_amd02(own, source)
        print_left_out("AM-D02, joints that stick and jump, one a trial", own, own / "out")
        stuck = [f"ArmL{AMD02_JOINTS[number - 1]}_Joint" for number in AMD02_COULOMB]
        print_beside(own / "out", stuck, {"coulomb_friction": [*AMD02_COULOMB.values()]})


if __name__ == "__main__":
    main()
