"""A KUKA KR300 R2500 ultra, an industrial robot of 1.1 t with a hydraulic balancer.

Public recordings, github JonasWeigand/Robot_Identification (MIT licence; Weigand et al. 2021,
real-time nonlinear parameter identification of an industrial robot): three trajectories of 10 s at
250 Hz, motor angles and torques, the lengths, masses, centres, inertias and gears of the links, the
balancer's geometry, and the torque that the authors' own model fed forward.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.spatial.transform import Rotation

from analysis.closeloop.session.signals import lowpass, rms
from benchmarks.closeloop.arms import write_session, write_table

RUN = "data/recorded_trajectories/2020-10-21 10s FF {} 08ms/data.mat"
#: Runs to fit, and one held out.
FITTED, HELD = "AB", "C"
JOINTS = tuple(f"joint_{number}" for number in range(1, 7))
#: Denavit-Hartenberg: d and a (m), alpha and theta at zero (deg); mass (kg), centre of mass (mm)
#: and inertia about it in the link's frame (1e-6 kg m2; xx, yy, zz, xy, yz, xz).
LINKS = """
-.675 .350  90   0 395.40 -353 174  -4 16733765 29799119 32814954 -1703664  129384  4404062
-.189 1.15   0 -90 339.12 -709  -1  23  7507819 88886691 88673761   430046  173157 -4396607
 .189 .041 -90 180 105.21  -18 -18 -76 10783798 10186135  1943179   118474 -606384  -101950
-1    0     90   0  35.80    0 236   1   425035   217993   428465       -4  -11353      -27
 0    0    -90   0  31.46    0 -80  -9   283826   229562   258266       -4  -19521     -120
-.24  0    180   0  17.78    0   0 -50        1        1        1        0       0        0
"""
#: Turns of the motor a turn of the joint, and what turns with it, kg m2.
GEARS = np.array([1798 / 7, 1872 / 7, 757 / 3, 221.0, 5032 / 21, 206793 / 1340])
ROTORS = np.array([0.00923, 0.0118, 0.0118, 0.00173, 0.00173, 0.00173])
#: The authors' friction: viscous (Nm s/rad), and the sum of two Coulomb terms (Nm).
VISCOUS = (2050.35, 2306.7, 2024.4, 453.66, 1000.0, 458.8)
COULOMB = (355.5, 242.3, 294.5, 50.4, 46.7, 76.1)


def mjcf() -> str:
    """Return the robot without a load as MJCF, its joints at zero where the controller's are."""
    rows = [[float(word) for word in line.split()] for line in LINKS.strip().splitlines()]
    place, turn = np.zeros(3), Rotation.from_euler("x", 180, degrees=True)
    bodies = ""
    for joint, row, armature in zip(JOINTS, rows, ROTORS * GEARS**2, strict=True):
        d, a, alpha, theta, mass = row[:5]
        twist = Rotation.from_euler("x", alpha, degrees=True)
        end, axes = np.array([a, 0.0, d]), twist.as_matrix()
        centre = end + axes @ (1e-3 * np.array(row[5:8]))
        xx, yy, zz, xy, yz, xz = 1e-6 * np.array(row[8:])
        about = axes @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ axes.T
        inertia = about[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        held = turn * Rotation.from_euler("z", theta, degrees=True)
        bodies += (
            f"<body name='{joint.replace('joint', 'link')}' pos='{_words(place)}' "
            f"quat='{_words(held.as_quat(scalar_first=True))}'>"
            f"<joint name='{joint}' axis='0 0 1' armature='{armature:.6g}'/>"
            f"<inertial mass='{mass}' pos='{_words(centre)}' fullinertia='{_words(inertia)}'/>"
        )
        place, turn = end, twist
    return f"<mujoco><worldbody>{bodies}{'</body>' * 6}</worldbody></mujoco>"


def _words(values: Sequence[float] | np.ndarray) -> str:
    return " ".join(f"{value:.9g}" for value in values)


def balancer(joint_2: np.ndarray) -> np.ndarray:
    """Return what the hydraulic balancer takes of joint 2's torque, Nm, at its angles, rad."""
    apart, arm = 0.8, 0.2
    angle = joint_2 - np.pi / 2 + np.radians(95.0)
    length = np.sqrt(apart**2 + arm**2 - 2 * apart * arm * np.cos(angle))
    area = np.pi * (0.055**2 - 0.030**2) / 4
    gas = 1.01 * 296.8 * 328.0 * 2 * 0.0795
    pressure = gas / (2 * 0.00048 - (length - (apart - arm)) * area)
    return np.asarray(np.sin(angle) * apart * arm / length * pressure * area)


def write(folder: Path, source: Path, *, balanced: bool) -> None:
    """Write a session of two runs to fit and one held out.

    Args:
        folder: of the session.
        source: a clone of the repository.
        balanced: whether what the balancer takes is known, and no part of the effort.
    """
    folder.mkdir()
    (folder / "robot.xml").write_text(mjcf())
    columns = ["time", *(f"{joint}.{what}" for what in ("position", "effort") for joint in JOINTS)]
    for run in FITTED + HELD:
        time, position, effort, _ = _read(source, run)
        if balanced:
            effort[:, 1] -= balancer(position[:, 1])
        write_table(folder / f"{run}.csv", columns, np.column_stack([time, position, effort]))
    fitted = [{"file": f"{run}.csv"} for run in FITTED]
    held = [{"file": f"{run}.csv", "role": "holdout"} for run in HELD]
    write_session(folder, "robot.xml", [*fitted, *held])


def _read(source: Path, run: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return a run: times (s), angles (rad), torques and what was fed forward (Nm), by joint."""
    content = loadmat(source / RUN.format(run), squeeze_me=True, struct_as_record=False)
    recorded = content["rec"]
    position = np.radians(recorded.act_pos_mot_deg.T)
    forward = (content["tau_ff_all"].T + content["tau_ff_init"]) * GEARS
    return recorded.time_cont, position, recorded.act_torque_abs_nm.T * GEARS, forward


def fed_forward_errors(source: Path, band: float) -> list[float]:
    """Return the error of the authors' own model in the run held out, below `band` Hz, Nm."""
    time, _, effort, forward = _read(source, HELD)
    left = lowpass(effort - forward, band, 1.0 / float(time[1] - time[0]))
    return [rms(own) for own in left.T]
