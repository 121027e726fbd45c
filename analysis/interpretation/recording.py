"""What a robot recorded: a file of `rehyb assess --record`, or a measured session."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from zipfile import is_zipfile

import numpy as np

from analysis.closeloop.errors import SessionError
from analysis.closeloop.session.archive import opened
from analysis.closeloop.session.contents import NOMINAL, Session, Trial
from analysis.closeloop.session.files import SESSION_FILE
from analysis.closeloop.session.mjcf import load_device as session_device
from analysis.closeloop.session.reading import read_session
from analysis.closeloop.session.trial_csv import read_trial
from analysis.interpretation.bank.archive import is_finite, read_arrays
from analysis.interpretation.declared import other_robot
from analysis.interpretation.errors import InterpretationError
from analysis.interpretation.sensors import beyond_motor, despiked, impossible
from intake.arrays import DamagedArraysError, NoArraysError
from sim.assessment.nominal import REFERENCE_HEIGHT, REFERENCE_MASS
from sim.assessment.summary import (
    AFTER,
    BEFORE,
    Motion,
    RecordingError,
    half_way,
    summarise,
)
from sim.effects.catalogue import BY_NAME, VISCOELASTIC
from sim.models import CURVES, ESTIMATES, WINDOWS
from sim.robot.device import ELBOW_JOINT, NESM

#: What a file of `rehyb assess --record` has under these names.
MOTION = ("time", "theta", "theta_velocity", "motor_torque")
ARRAYS = (*MOTION, "device", "exo_joint", "joint")
#: Effects by which a recording looks like that of another limb.
LOADS = ("payload", "added_inertia")
#: Of a log, a part of a session and a broken zip file a session's reader says more.
_SAID = (".csv", ".json", ".zip")
#: Fewest samples of a recording.
LEAST_SAMPLES = 10


@dataclass(frozen=True, kw_only=True)
class Recording:
    """One movement, as far as a robot records it."""

    #: What it was read from, in words.
    source: str
    #: Name of the device.
    device: str
    motion: Motion
    #: How many single samples were replaced, by channel in words.
    replaced: Mapping[str, int] = field(default_factory=dict)
    #: What the declared robot differs in from the device, in words.
    differs: str | None = None
    #: Effects of LOADS that a session says are there.
    loads: tuple[str, ...] = ()
    #: Declared low-pass in the torques, Hz.
    effort_filter_hz: float | None = None
    #: What a session says that interpretation does not use.
    unused: tuple[str, ...] = ()

    def values(self) -> np.ndarray:
        """Return CURVES and ESTIMATES, shape (both,).

        Raises:
            InterpretationError: it holds no such movement.
        """
        try:
            found = summarise(self.motion, NESM)
        except ValueError as error:
            raise InterpretationError(f"{self.source}: {error}{self._hint}") from None
        return np.array([found[name] for name in (*CURVES, *ESTIMATES)])

    @property
    def _hint(self) -> str:
        """What may be wrong if no movement is found."""
        apart = float(np.median(np.diff(self.motion.time)))
        if apart < (BEFORE + AFTER) / WINDOWS:
            return ""
        return f" (samples are {apart:g} s apart: time must be in seconds)"

    def velocity_check(self) -> tuple[float, float]:
        """Compare the moved joint's velocity with the slope of its angle, both window by window.

        Returns:
            The velocity's gain over the slope, and the root mean square of their difference, rad/s.

        Raises:
            InterpretationError: it holds no movement, or a velocity that is none of this angle.
        """
        time, joint = self.motion.time, self.motion.joint
        angle, velocity = self.motion.theta[:, joint], self.motion.velocity[:, joint]
        try:
            middle = half_way(time, angle)
        except RecordingError as error:
            raise InterpretationError(f"{self.source}: {error}") from None
        steps = np.diff(time) * (velocity[1:] + velocity[:-1]) / 2.0
        travelled = np.concatenate([[0.0], np.cumsum(steps)])
        edges = np.linspace(middle - BEFORE, middle + AFTER, WINDOWS + 1)
        width = edges[1] - edges[0]
        slope = np.diff(np.interp(edges, time, angle)) / width
        mean = np.diff(np.interp(edges, time, travelled)) / width
        gain = float(mean @ slope / (slope @ slope))
        if gain <= 0.0:
            raise InterpretationError(
                f"{self.source}: the velocity of the moved joint is not of its angle (it is "
                f"{gain:.2f} times the angle's slope): both must be in rad and rad/s, with one sign"
            )
        return gain, float(np.sqrt(np.mean((mean - slope) ** 2)))


def read_recording(path: Path) -> Recording:
    """Read a recording: an `.npz` file, or a session (folder or zip).

    Of a session the first trial is taken that holds one movement of the elbow; of those that carry
    a load only if there is no other.

    Raises:
        InterpretationError: it cannot be read, or lacks what is needed; one sentence.
    """
    if path.suffix == ".npz":
        return _from_archive(path)
    if not path.exists():
        raise InterpretationError(f"{path}: there is no such file or folder")
    if path.is_file() and path.suffix not in _SAID and not is_zipfile(path):
        raise InterpretationError(
            f"{path} is no recording: take a file of `rehyb assess --record` (.npz), or a measured "
            f"session, a folder with {SESSION_FILE} or its zip file"
        )
    try:
        with opened(path) as folder:
            return _from_session(folder)
    except SessionError as error:
        raise InterpretationError(str(error)) from None


def _from_archive(path: Path) -> Recording:
    try:
        arrays = read_arrays(path)
    except FileNotFoundError:
        raise InterpretationError(f"{path}: there is no such file") from None
    except DamagedArraysError as error:
        raise InterpretationError(f"{path} {error}") from None
    except NoArraysError:
        raise InterpretationError(
            f"{path} is no recording: take a file of `rehyb assess --record`, or a session"
        ) from None
    if missing := [name for name in ARRAYS if name not in arrays]:
        what = "velocities" if missing == ["theta_velocity"] else ", ".join(missing)
        raise InterpretationError(f"{path} has no {what}: record angles, velocities and torques")
    for name in MOTION:
        if arrays[name].dtype.kind not in "iuf":
            raise InterpretationError(f"{path}: {name} must be real numbers")
    device = arrays["device"]
    if device.shape or device.dtype.kind != "U":
        raise InterpretationError(f"{path}: device must be one name, such as {NESM.name}")
    exo_joint = _whole(arrays["exo_joint"], f"{path}: exo_joint")
    if _whole(arrays["joint"], f"{path}: joint") != 3:
        raise InterpretationError(f"{path} is of the shoulder: banks are of the elbow")
    motion = Motion(
        time=np.asarray(arrays["time"], dtype=float),
        theta=np.asarray(arrays["theta"], dtype=float),
        velocity=np.asarray(arrays["theta_velocity"], dtype=float),
        torque=np.asarray(arrays["motor_torque"], dtype=float),
        joint=exo_joint,
    )
    _check(motion, str(path))
    motion, replaced = _cleaned(motion, str(path), str(device))
    return Recording(source=str(path), device=str(device), motion=motion, replaced=replaced)


def _whole(array: np.ndarray, what: str) -> int:
    if array.shape or not is_finite(array) or array != np.round(array):
        raise InterpretationError(f"{what} must be one whole number")
    return int(array)


def _check(motion: Motion, source: str) -> None:
    """Raise InterpretationError if arrays do not fit each other or are not finite."""
    count = len(motion.time) if motion.time.ndim == 1 else 0
    if motion.time.ndim == 1 and count < LEAST_SAMPLES:
        raise InterpretationError(
            f"{source} has {count} sample{'' if count == 1 else 's'}: a recording has at least "
            f"{LEAST_SAMPLES}"
        )
    shape = motion.theta.shape
    fits = motion.theta.ndim == 2 and shape[0] == count and 0 <= motion.joint < shape[1]
    if not fits or motion.velocity.shape != shape or motion.torque.shape != shape:
        raise InterpretationError(
            f"{source}: time must have n values, and angles, velocities and torques n rows and a "
            "column for each joint of the device"
        )
    for name, array in vars(motion).items():
        if not np.isfinite(array).all():
            raise InterpretationError(f"{source}: {name} has values that are not finite")
    if not (np.diff(motion.time) > 0.0).all():
        raise InterpretationError(f"{source}: time must rise from sample to sample")
    if why := impossible(motion):
        raise InterpretationError(f"{source}: {why}")


def _cleaned(motion: Motion, source: str, device: str) -> tuple[Motion, dict[str, int]]:
    """Return `despiked`; InterpretationError if the bank's device cannot give its torques."""
    motion, replaced = despiked(motion)
    if device == NESM.name and (why := beyond_motor(motion, NESM)):
        raise InterpretationError(f"{source}: {why}")
    return motion, replaced


def _from_session(folder: Path) -> Recording:
    """Return the first trial of a session that holds one movement of the elbow."""
    session = read_session(folder, tuple(BY_NAME))
    joints = _joints(session)
    differs = other_robot(session)
    complaint = f"{folder.name}: it has no trial"
    for listed in sorted(session.trials, key=_loaded):
        trial = read_trial(folder, listed, joints, ())
        motion, replaced = _cleaned(_motion(trial, joints), trial.file, NESM.name)
        recording = Recording(
            source=f"{folder.name}/{trial.file}",
            device=NESM.name,
            motion=motion,
            replaced=replaced,
            differs=differs,
            loads=_loads(session, trial),
            effort_filter_hz=trial.effort_filter_hz,
            unused=_unused(session),
        )
        try:
            summarise(motion, NESM)
        except ValueError as error:
            complaint = f"{recording.source}: {error}"
            continue
        return recording
    raise InterpretationError(complaint)


def _loaded(trial: Trial) -> bool:
    return trial.added_mass is not None or trial.payload is not None


def _loads(session: Session, trial: Trial) -> tuple[str, ...]:
    """Return which of LOADS a session says that its trial has."""
    declared = {one.effect for one in session.declared} | ({LOADS[0]} if _loaded(trial) else set())
    return tuple(name for name in LOADS if name in declared)


def _unused(session: Session) -> tuple[str, ...]:
    """Return what a session says that interpretation does not use, by its key."""
    other = {one.effect for one in session.declared} - {*LOADS, VISCOELASTIC.name}
    said = {
        "subject": (session.height_m, session.mass_kg) != (REFERENCE_HEIGHT, REFERENCE_MASS),
        "declared_effects": bool(other),
    }
    return (*(name for name, there in said.items() if there), *session.unknown)


def _joints(session: Session) -> tuple[str, ...]:
    """Return the NESM's joints; InterpretationError if the session is of another device."""
    if session.model != NOMINAL:
        joints = session_device(session).recorded_joints
        if set(joints) != set(NESM.joints):
            raise InterpretationError(
                f"{session.folder.name} is of {session.model} with {', '.join(joints)}: banks are "
                f"of the elbow in the {NESM.name} with {', '.join(NESM.joints)}"
            )
    return NESM.joints


def _motion(trial: Trial, joints: tuple[str, ...]) -> Motion:
    columns = {}
    for quantity in ("position", "velocity", "effort"):
        missing = [j for j in joints if f"{j}.{quantity}" not in trial.columns]
        if missing:
            raise InterpretationError(
                f"{trial.file} has no {missing[0]}.{quantity}: to interpret it takes position, "
                f"velocity and effort of {', '.join(joints)}"
            )
        columns[quantity] = np.column_stack([trial.columns[f"{j}.{quantity}"] for j in joints])
    motion = Motion(
        time=trial.time,
        theta=columns["position"],
        velocity=columns["velocity"],
        torque=columns["effort"],
        joint=joints.index(ELBOW_JOINT),
    )
    _check(motion, trial.file)
    return motion
