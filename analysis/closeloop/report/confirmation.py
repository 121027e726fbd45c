"""Confirmation: simulate the repaired model and compare it with the recording.

The recorded effort drives the model's motor. In closed loop a weak feedback keeps the joint on the
recorded path: what it has to add, and how far the joint strays in spite of it, is what the model
still lacks, and both fall if the repair is right. In open loop nothing does. Joints whose effort
nobody recorded follow their recorded path as if a computed torque drove them (Luh, Walker and Paul
1980, Resolved-acceleration control), so that they neither fall nor shake the others. No residual of
the fit enters, so this also tells whether the model that was written runs.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from analysis.closeloop.contract import Verdict
from analysis.closeloop.report.repaired import repaired_model
from analysis.closeloop.session.contents import AddedMass, Trial
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.signals import rms
from models.mjcf.compiling import compiled
from sim.effects.applied import AppliedEffects
from sim.effects.elements import PREFIX

#: Bandwidths of the feedback, rad/s: the slowest, which leaves an error to be seen, that keeps the
#: repaired model as near to its path as below. Further away it moves as it never did: a light link
#: without its motor's inertia, whatever is right about the rest.
BANDWIDTHS = tuple(2 * np.pi * hertz for hertz in (2.0, 4.0, 8.0, 16.0))
#: Root mean square, rad or m.
NEAR = 0.1
#: Of joints whose effort nobody recorded: they have to follow.
HELD_BANDWIDTH = 2 * np.pi * 20.0
#: Longest time step, s, and longest piece of a trial that is simulated.
STEP, LONGEST = 1e-3, 30.0
#: Speed beyond which a simulation has left all sense, rad/s or m/s.
FASTEST = 60.0
#: What a feedback may grow by where nothing was repaired, and what a repair is judged by.
ALIKE, MEASURES = 1.01, ("feedback", "deviation")
#: Trials that are simulated.
TRIALS = 2


@dataclass(frozen=True)
class Run:
    """One simulated trial: root mean squares of feedback and deviation by analysed joint."""

    feedback: Mapping[int, float]
    deviation: Mapping[int, float]
    finite: bool

    @property
    def near(self) -> bool:
        """Whether every joint stays near its recorded path."""
        return self.finite and max(self.deviation.values(), default=0.0) < NEAR


def confirm(
    recording: Recording, report: Mapping[str, Any], xml: str
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Simulate the declared and the repaired model along recorded trials.

    Args:
        recording: all trials; holdouts are taken first.
        report: with impedances before and after.
        xml: the repaired model.

    Returns:
        The confirmation: for every analysed joint the feedback (Nm or N) and the deviation (rad or
        m) in closed loop, root mean square, before and after; the feedback's bandwidth (Hz), the
        slowest that keeps the repaired model near; and the files that were simulated.
        Then how far the joints stray from the first of them in open and in closed loop; null where
        a simulation does not stay finite.
    """
    before, _, _ = repaired_model(recording.device, _as_declared(report))
    models = {"before": before, "after": xml}
    pieces = _pieces(recording)
    hung = {
        word: [
            load_of(recording.session.trials[recording.trial_of(p)], report, word) for p in pieces
        ]
        for word in models
    }
    opened = {
        word: simulate(recording, model, pieces[0], hung[word][0], bandwidth=0.0)
        for word, model in models.items()
    }
    for bandwidth in BANDWIDTHS:
        after = _runs(recording, xml, pieces, hung["after"], bandwidth)
        if all(run.near for run in after):
            break
    closed = {"before": _runs(recording, before, pieces, hung["before"], bandwidth), "after": after}
    files = [recording.session.trials[recording.trial_of(piece)].file for piece in pieces]
    clock = recording.time[pieces[0]]
    confirmation: dict[str, Any] = {
        "trials": files,
        "ran": all(run.finite for run in closed["after"]),
        "bandwidth_hz": bandwidth / (2 * np.pi),
        "joints": {},
    }
    simulation: dict[str, Any] = {
        "file": files[0],
        "seconds": min(float(clock[-1] - clock[0]), LONGEST),
        "joints": {},
    }
    for joint in recording.joints:
        name = recording.name(joint)
        angle = recording.device.angle_unit(name)
        entry: dict[str, Any] = {"unit": recording.device.unit(name), "deviation_unit": angle}
        for word, runs in closed.items():
            entry[f"feedback_{word}"] = rms(np.array([run.feedback[joint] for run in runs]))
            entry[f"deviation_{word}"] = rms(np.array([run.deviation[joint] for run in runs]))
        confirmation["joints"][name] = entry
        first = {"open_loop": opened, "closed_loop": {word: own[0] for word, own in closed.items()}}
        simulation["joints"][name] = {"unit": angle} | {
            loop: {word: run.deviation[joint] if run.finite else None for word, run in own.items()}
            for loop, own in first.items()
        }
    return confirmation, simulation


def _runs(
    recording: Recording,
    model: str,
    pieces: Sequence[slice],
    loads: Sequence[AddedMass | None],
    bandwidth: float,
) -> list[Run]:
    """Simulate a model along every piece, with what hangs there; `bandwidth` in rad/s."""
    pairs = zip(pieces, loads, strict=True)
    return [simulate(recording, model, *pair, bandwidth=bandwidth) for pair in pairs]


def unconfirmed(confirmation: Mapping[str, Any], repaired: Collection[str]) -> list[str]:
    """Return a warning for every joint that the repaired model does not follow better.

    Args:
        confirmation: as `confirm` returns it.
        repaired: joints at which something was found; others only have to follow as well.
    """
    if not confirmation["ran"]:
        return ["model_after.xml does not run stably along the recorded trials"]
    return [
        f"simulated in closed loop, model_after.xml does not follow {joint} better than the "
        f"declared model: feedback {entry['feedback_before']:.3g} before, "
        f"{entry['feedback_after']:.3g} {entry['unit']} after"
        for joint, entry in confirmation["joints"].items()
        if entry["feedback_after"] > ALIKE * entry["feedback_before"]
        or (joint in repaired and not _helped(entry))
    ]


def _helped(entry: Mapping[str, Any]) -> bool:
    """Whether a repair lets a joint follow with less feedback, or nearer: noise takes feedback.

    So it does where the declared model leaves all sense, and has neither.
    """
    return not all(entry[f"{what}_after"] >= entry[f"{what}_before"] for what in MEASURES)


def load_of(trial: Trial, report: Mapping[str, Any], word: str) -> AddedMass | None:
    """Return the load that a trial carries as it was found; None if it carries none.

    Args:
        trial: it may name a payload.
        report: with the payloads that trials name, and those that seem to hang there all the same.
        word: "before" for the fit of the declared model, "after" for that of the repaired one.
    """
    key = "before" if word == "before" else "value"
    if trial.payload is not None:
        for entry in report["declared"]:
            if entry.get("name") == trial.payload.name and "body" in entry:
                return _hung(entry, key)
    for entry in report["unnamed_loads"]:
        begun = trial.time[0], trial.time[-1]
        if (entry["file"], entry["from"], entry["to"]) == (trial.file, *begun):
            return _hung({"body": entry["body"], "parameters": entry}, "value")
    return None


def _hung(entry: Mapping[str, Any], key: str) -> AddedMass | None:
    """Return a load; None if these trials do not determine it."""
    mass, place = (entry["parameters"][name][key] for name in ("mass", "position"))
    if mass is None or all(way is None for way in place):
        return None
    # What no joint feels may be anything.
    x, y, z = (0.0 if way is None else way for way in place)
    inertia = entry["parameters"].get("inertia", {}).get(key) or 0.0
    return AddedMass(body=entry["body"], mass=mass, position=(x, y, z), inertia=inertia)


def simulate(
    recording: Recording,
    xml: str,
    piece: slice,
    load: AddedMass | None = None,
    *,
    bandwidth: float = BANDWIDTHS[0],
) -> Run:
    """Drive a model with the recorded effort along one piece of the recording.

    Args:
        recording: all trials.
        xml: the model.
        piece: where the piece lies.
        load: what hangs there beside what the trial declares.
        bandwidth: of the feedback of driven joints, rad/s; 0 for none.
    """
    spec = mujoco.MjSpec.from_string(xml)
    trial = recording.session.trials[recording.trial_of(piece)]
    for mass in (trial.added_mass, load):
        if mass is not None:
            mass.hang(spec)
    spec.option.timestep = min(float(spec.option.timestep), STEP)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.disableflags |= (
        mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    )
    model = compiled(spec)
    clock = recording.time[piece]
    begun = float(clock[0] - recording.time.min())
    data, effects = mujoco.MjData(model), AppliedEffects(model, begun)
    time = np.arange(clock[0], min(clock[-1], clock[0] + LONGEST), model.opt.timestep)
    position, velocity, acceleration = (
        np.column_stack([np.interp(time, clock, column) for column in signal[piece].T])
        for signal in (recording.position, recording.velocity, recording.acceleration)
    )
    effort, driven = _efforts(recording, piece, time)
    motors = {dof: control for dof, control in _motors(model).items() if driven[dof]}
    data.qpos[:], data.qvel[:] = position[0], velocity[0]
    inertia = np.empty((model.nv, model.nv))
    held = ~driven
    # Found once: looking for them takes longer than a step.
    blocks = [np.ix_(*pair) for pair in ((driven, driven), (driven, held), (held, held))]
    band = np.where(driven, bandwidth, HELD_BANDWIDTH)
    feedback, path = np.zeros_like(position), np.zeros_like(position)
    for i in range(len(time)):
        mujoco.mj_step1(model, data)
        mujoco.mj_fullM(model, data, inertia)
        path[i], slip = position[i] - data.qpos, velocity[i] - data.qvel
        wanted = band * (band * path[i] + 2.0 * slip)
        feedback[i, driven] = inertia[blocks[0]] @ wanted[driven]
        total = effort[i] + feedback[i]
        if held.any():
            parts = [inertia[block] for block in blocks]
            total[held] = feedback[i, held] = _held(
                parts, data, total[driven], driven, acceleration[i] + wanted
            )
        data.qfrc_applied[:] = total
        for dof, control in motors.items():
            # The late or weak motor gets the effort; the feedback acts on the joint itself.
            data.ctrl[control] = effort[i, dof]
            data.qfrc_applied[dof] = feedback[i, dof]
        effects.apply(data)
        mujoco.mj_step2(model, data)
        if not np.isfinite(data.qpos).all() or np.abs(data.qvel).max() > FASTEST:
            path[i:], feedback[i:] = np.nan, np.nan
            break
    return Run(
        feedback={joint: rms(feedback[:, joint]) for joint in recording.joints},
        deviation={joint: rms(path[:, joint]) for joint in recording.joints},
        finite=bool(np.isfinite(path).all()),
    )


def _held(
    inertia: Sequence[np.ndarray],
    data: mujoco.MjData,
    torque: np.ndarray,
    driven: np.ndarray,
    wanted: np.ndarray,
) -> np.ndarray:
    """Return the torque that gives the joints that are not driven their wanted acceleration.

    Args:
        inertia: mass matrix of the driven joints, between them and the others, of the others.
        data: at the state in question.
        torque: of the driven joints.
        driven: which, (nv,).
        wanted: accelerations, (nv,).
    """
    both, across, own = inertia
    needed, others = data.qfrc_bias - data.qfrc_passive, wanted[~driven]
    free = torque - needed[driven] - across @ others
    accelerations = np.linalg.solve(both, free) if driven.any() else free
    return np.asarray(across.T @ accelerations + own @ others + needed[~driven])


def _as_declared(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return the part of a report that makes the model before the repair."""
    impedance = {
        joint: {key: {"after": entry["before"]} for key, entry in entries.items()}
        for joint, entries in report["impedance"].items()
    }
    declared = [
        entry | {"parameters": {n: {"value": p["before"]} for n, p in entry["parameters"].items()}}
        for entry in report["declared"]
    ]
    return {
        "impedance": impedance,
        "declared": declared,
        "effects": [],
        "verdict": Verdict.ADEQUATE,
    }


def _pieces(recording: Recording) -> list[slice]:
    """Return the longest piece of each trial to simulate: holdouts first, then the fastest."""
    longest = {
        number: max(recording.pieces_of(number), key=lambda piece: piece.stop - piece.start)
        for number in np.unique(recording.trial).tolist()
    }

    def order(number: int) -> tuple[bool, float]:
        speed = np.abs(recording.velocity[longest[number]][:, list(recording.joints)])
        return recording.session.trials[number].role != "holdout", -float(speed.max())

    return [longest[number] for number in sorted(longest, key=order)[:TRIALS]]


def _efforts(recording: Recording, piece: slice, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return raw effort on the simulation's clock, (n, joints), and which joints have one."""
    number = recording.trial_of(piece)
    clock = recording.session.trials[number].time
    count = recording.position.shape[1]
    effort, driven = np.zeros((len(time), count)), np.zeros(count, dtype=bool)
    for joint in recording.joints:
        raw = recording.raw_effort(number, joint)
        if raw is not None:
            effort[:, joint], driven[joint] = np.interp(time, clock, raw), True
    return effort, driven


def _motors(model: mujoco.MjModel) -> dict[int, int]:
    """Return where in `ctrl` the plain torque motor of each degree of freedom is told."""
    found: dict[int, int] = {}
    # Controls are counted by `nu`; an actuator may have several.
    for number in range(len(model.actuator_trnid)):
        joint = int(model.actuator_trnid[number, 0])
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, number) or ""
        at_joint = model.actuator_trntype[number] == mujoco.mjtTrn.mjTRN_JOINT
        plain = model.actuator_gear[number, 0] == 1.0 and not name.startswith(PREFIX)
        if at_joint and plain and model.actuator_biastype[number] == mujoco.mjtBias.mjBIAS_NONE:
            found.setdefault(int(model.jnt_dofadr[joint]), int(model.actuator_ctrladr[number]))
    return found
