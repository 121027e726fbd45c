"""Record a case: size its faults, simulate, measure, and write session and truth."""

import csv
import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.closeloop.unkind.cases import Case, Controller, to_json
from benchmarks.closeloop.unkind.chain import (
    Chain,
    Signal,
    effort_noise,
    logged,
    low_pass,
    quantised,
    stamps,
)
from benchmarks.closeloop.unkind.robots import declared_xml
from benchmarks.closeloop.unkind.simulate import Bench, FlightError, Trial
from benchmarks.closeloop.unkind.sizing import LEAST_RATIO, chatter_of, noise_of, shown, sized_fault

#: The session's clock begins here, s.
CLOCK = 100.0


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """A case as simulated: its faults at their final size."""

    case: Case
    trials: tuple[Trial, ...]
    starts: tuple[float, ...]
    #: By joint, Nm: the effort's noise, and the peak of each push.
    noise: Signal
    rms: Signal
    pushes: dict[int, float]
    #: By joint: RMS over all trials of the torque that the declared model lacks.
    missing: Signal
    #: What of each fault only it explains, over the noise.
    ratios: tuple[float, ...]
    #: What pushes of still trials change in the effort of their joint, over its noise.
    shown: tuple[float, ...]

    @property
    def weak(self) -> bool:
        """Whether something is below what the sensors show, so that the session does not count."""
        return min((*self.ratios, *self.shown), default=LEAST_RATIO) < LEAST_RATIO


def record(case: Case) -> Recorded:
    """Simulate a case.

    Raises:
        FlightError: the robot cannot follow these motions, however slow.
    """
    for attempt in range(4):
        try:
            return _record(case)
        except FlightError:
            if attempt == 3:
                raise
            slower = tuple(replace(p, pace=0.7 * p.pace) for p in case.plans)
            stiff = Controller(kind="computed_torque", hertz=case.controller.hertz + 1.5)
            case = replace(case, plans=slower, controller=stiff)
    raise AssertionError


def _record(case: Case) -> Recorded:
    starts = []
    clock = 0.0
    for plan in case.plans:
        clock += plan.pause
        starts.append(clock)
        clock += plan.seconds
    bare = Bench(replace(case, faults=(), pushes=()))
    # What the effort is without faults says how much noise its sensor has.
    plain = [bare.run(case.plans[n], starts[n], {}) for n in range(0, len(starts), 2)]
    rms = np.sqrt(np.mean(np.concatenate([t.effort for t in plain]) ** 2, axis=0))
    noise = noise_of(case.chain, rms, chatter := chatter_of(plain))
    sized, ratios = [], []
    for fault in case.faults:
        one, ratio = sized_fault(case, fault, starts, noise, rms)
        sized.append(one)
        ratios.append(ratio)
    if ratios and min(ratios) < LEAST_RATIO:
        # The effect cannot be larger: better sensors then, down to a third of the noise.
        better = max(min(ratios) / LEAST_RATIO, 1 / 3)
        chain = replace(
            case.chain, noise=better * case.chain.noise, least_count=better * case.chain.least_count
        )
        case = replace(case, chain=chain)
        old, noise = noise, noise_of(chain, rms, chatter)
        ratios = [ratio * float(np.min(old / noise)) for ratio in ratios]
    case = replace(case, faults=tuple(sized))
    pushes = {
        n: push.ratio * float(noise[case.robot.index(push.joint)])
        for n, push in enumerate(case.pushes)
    }
    bench = Bench(case)
    trials = tuple(bench.run(p, start, pushes) for p, start in zip(case.plans, starts, strict=True))
    missing = np.concatenate([bench.missing(trial) for trial in trials])
    at_rest = [push for push in case.pushes if case.plans[push.trial].motion == "still"]
    seen = []
    for push in at_rest:
        bare_trial = bench.run(case.plans[push.trial], starts[push.trial], {})
        joint = case.robot.index(push.joint)
        seen.append(shown(trials[push.trial], bare_trial, joint) / float(noise[joint]))
    return Recorded(
        case=case,
        trials=trials,
        starts=tuple(starts),
        noise=noise,
        rms=rms,
        pushes=pushes,
        missing=np.sqrt(np.mean(missing**2, axis=0)),
        ratios=tuple(ratios),
        shown=tuple(seen),
    )


def write_session(folder: Path, recorded: Recorded) -> dict[str, Any]:
    """Write a session to a new folder, and its truth to FOLDER.truth.json; return the truth."""
    case, chain = recorded.case, recorded.case.chain
    folder.mkdir(parents=True)
    names = case.robot.names
    (folder / "device.xml").write_text(declared_xml(case.robot))
    limb = case.robot.limb
    measured = [n for n, name in enumerate(names) if limb is None or name == limb.joint]
    entries, truths = [], []
    per_rate = chain.rate
    length = int((recorded.starts[-1] + 60.0) * per_rate)
    noise = {
        n: effort_noise(chain, float(recorded.rms[n]), length, case.rng("noise", n))
        for n in measured
    }
    for plan, trial, start in zip(case.plans, recorded.trials, recorded.starts, strict=True):
        rng = case.rng("logger", plan.number)
        file = f"t{plan.number}_{plan.motion}.csv"
        columns, lines, error = _measured(recorded, trial, start, measured, noise, rng)
        with (folder / file).open("w", newline="") as out:
            writer = csv.writer(out)
            writer.writerow(columns)
            writer.writerows([[f"{x:.10g}" for x in row] for row in lines])
        role = {"role": "holdout"} if plan.holdout else {}
        entries.append({"file": file, "label": f"{plan.motion}, {plan.pace:.2f} rad/s", **role})
        truths.append({"file": file, "noise": error})
    session: dict[str, Any] = {
        "schema": 1,
        "model": "device.xml",
        "declared_effects": [
            *([{"effect": "viscoelastic_joint", "joint": limb.joint}] if limb else []),
            *(
                {"effect": effect, "joint": joint}
                for joint in case.declared
                for effect in ("coulomb_friction", "viscous_friction")
            ),
        ],
        "trials": entries,
    }
    if chain.filter_hz:
        session["effort_filter_hz"] = round(chain.filter_hz, 3)
    if chain.per_ampere:
        session["columns"] = {"map": _map(names, measured, chain)}
    (folder / "session.json").write_text(json.dumps(session, indent=1))
    truth = _truth(recorded, measured, truths)
    Path(f"{folder}.truth.json").write_text(json.dumps(truth, indent=1))
    return truth


def _map(names: tuple[str, ...], measured: list[int], chain: Chain) -> dict[str, Any]:
    table: dict[str, Any] = {"time": "timestamp"}
    for n, name in enumerate(names):
        table[f"{name}.position"] = f"actual_q_{n}"
        if n in measured:
            table[f"{name}.effort"] = {
                "from": f"actual_current_{n}",
                "scale": round(chain.per_ampere, 6),
            }
        if chain.speed_hz:
            table[f"{name}.velocity"] = f"actual_qd_{n}"
    return table


def _measured(
    recorded: Recorded,
    trial: Trial,
    start: float,
    measured: list[int],
    noise: dict[int, Signal],
    rng: np.random.Generator,
) -> tuple[list[str], Signal, list[float]]:
    """Return header and lines of a trial's log, and by joint the RMS of the effort's error."""
    case, chain = recorded.case, recorded.case.chain
    step = float(trial.time[1] - trial.time[0])
    taken, said = stamps(chain, float(trial.time[-1]), rng)
    current = bool(chain.per_ampere)
    header = ["timestamp" if current else "time"]
    columns = [CLOCK + start + said]
    errors = []
    held = np.minimum((taken / step + 1e-6).astype(int), len(trial.time) - 1)
    first = int(start * chain.rate)
    for n, name in enumerate(case.robot.names):
        q = np.interp(taken, trial.time, trial.q[:, n])
        header.append(f"actual_q_{n}" if current else f"{name}.position")
        columns.append(quantised(q, chain.encoder))
        if chain.speed_hz:
            v = low_pass(trial.v[:, n], chain.speed_hz, step)
            header.append(f"actual_qd_{n}" if current else f"{name}.velocity")
            columns.append(np.interp(taken, trial.time, v))
        if n not in measured:
            continue
        effort = trial.effort[:, n]
        felt = effort[held]
        if chain.filter_hz:
            # MuJoCo's step moves the joint as if a command were there half a step before and after.
            around = 0.5 * (effort + np.concatenate([effort[:1], effort[:-1]]))
            felt = np.interp(taken, trial.time, low_pass(around, chain.filter_hz, step))
        said_effort = felt + noise[n][first : first + len(taken)]
        least = chain.least_count * float(recorded.rms[n])
        said_effort = quantised(said_effort, least)
        errors.append(float(np.sqrt(np.mean((said_effort - felt) ** 2))))
        header.append(f"actual_current_{n}" if current else f"{name}.effort")
        columns.append(said_effort / round(chain.per_ampere, 6) if current else said_effort)
    return header, logged(chain, np.stack(columns, axis=1), rng), errors


def _truth(recorded: Recorded, measured: list[int], files: list[dict[str, Any]]) -> dict[str, Any]:
    case = recorded.case
    holdout = next(n for n, plan in enumerate(case.plans) if plan.holdout)
    bench = Bench(case)
    missing = np.sqrt(np.mean(bench.missing(recorded.trials[holdout]) ** 2, axis=0))
    names = case.robot.names
    limb = case.robot.limb
    return {
        "case": case.name,
        "kind": case.kind,
        "effects": [
            {
                "name": fault.name,
                "joint": fault.joint,
                "parameters": {key: fault.value(key) for key in fault.values},
                **({"position": fault.place} if fault.place else {}),
                **({"other_joint": fault.other} if fault.other else {}),
                "ratio": ratio,
            }
            for fault, ratio in zip(case.faults, recorded.ratios, strict=True)
        ],
        "weak": recorded.weak,
        "pushes": [
            {
                "file": files[push.trial]["file"],
                "joint": push.joint,
                "from": CLOCK + recorded.starts[push.trial] + push.start,
                "to": CLOCK + recorded.starts[push.trial] + push.start + push.seconds,
                "peak": recorded.pushes[n],
            }
            for n, push in enumerate(case.pushes)
        ],
        "impedance": None
        if limb is None
        else {"joint": limb.joint, "stiffness": limb.stiffness, "damping": limb.damping},
        "noise": {names[n]: float(recorded.noise[n]) for n in measured},
        "holdout": {
            names[n]: {"missing": float(missing[n]), "noise": files[holdout]["noise"][at]}
            for at, n in enumerate(measured)
        },
        "spec": to_json(case),
    }
