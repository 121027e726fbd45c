"""How strong a fault of a case is, so that it shows beside the noise of its sensors."""

from dataclasses import replace

import numpy as np
from scipy.signal import butter, sosfiltfilt

from benchmarks.closeloop.unkind.cases import Case
from benchmarks.closeloop.unkind.chain import (
    Chain,
    Signal,
)
from benchmarks.closeloop.unkind.faults import RANGES, Fault
from benchmarks.closeloop.unkind.simulate import Bench, FlightError, Trial

#: A channel without noise of its own is held for this good, of its RMS.
LEAST_NOISE = 0.005

#: Commands above it are the controller's answer to its encoder's noise.
CHATTER_HZ = 20.0

#: A fault is at least this strong beside the noise, or its session does not count.
LEAST_RATIO = 3.0

#: Frictions whose form must show beside the noise, too: what Coulomb and viscous friction leave.
FORMS = (
    "stribeck_friction",
    "asymmetric_friction",
    "load_dependent_friction",
    "position_dependent_friction",
)


def noise_of(chain: Chain, rms: Signal, chatter: Signal) -> Signal:
    """Return the effort's noise by joint, Nm, of which `rms` is the effort's own."""
    share = np.hypot(chain.noise, chain.least_count / np.sqrt(12))
    sensor = max(share, LEAST_NOISE) * np.maximum(rms, 0.05 * np.max(rms))
    return np.asarray(np.hypot(sensor, chatter))


def chatter_of(trials: list[Trial]) -> Signal:
    """Return the RMS of commands above `CHATTER_HZ`: no log at these rates can tell its motion."""
    step = float(trials[0].time[1])
    section = butter(4, CHATTER_HZ, "highpass", fs=1 / step, output="sos")
    fast = np.concatenate([sosfiltfilt(section, t.effort, axis=0)[50:-50] for t in trials])
    return np.asarray(np.sqrt(np.mean(fast**2, axis=0)))


def sized_fault(
    case: Case, fault: Fault, starts: list[float], noise: Signal, rms: Signal
) -> tuple[Fault, float]:
    """Return a fault at the size that its ratio asks for, and the ratio that it reaches."""
    joint = case.robot.index(fault.joint)
    low, high = RANGES.get(fault.name, (0.0, np.inf))
    if case.robot.limb is not None and fault.name == "nonlinear_stiffness":
        high = 5.0 * case.robot.limb.stiffness
    at_torque = fault.ratio * float(noise[joint])
    first = {
        "payload": 0.3,
        "added_inertia": 0.05,
        "load_dependent_friction": at_torque / float(rms[joint]),
        "nonlinear_stiffness": 4 * at_torque,
        "stretch_reflex": 2 * at_torque,
    }.get(fault.name, float(np.sqrt(low * high)) if low else at_torque)
    if fault.name == "load_dependent_friction":
        load = {**fault.values, "base": fault.values["base"] * float(rms[joint]) * 0.3}
        fault = replace(fault, values=load)
    size, ratio = first, 0.0
    for _ in range(3):
        fault = replace(fault, size=float(np.clip(size, low, high)))
        try:
            ratio, form = _strength(case, fault, starts, noise)
        except FlightError:
            size = 0.5 * fault.size
            continue
        wish = max(fault.ratio / max(ratio, 1e-9), 1.0 / max(form, 1e-9))
        if 0.8 < wish < 1.25:
            break
        size = fault.size * float(np.clip(wish, 0.1, 10.0))
    return fault, ratio


def _strength(case: Case, fault: Fault, starts: list[float], noise: Signal) -> tuple[float, float]:
    """Return RMS over noise of what only this fault explains, and of its form beyond Coulomb's."""
    bench = Bench(replace(case, faults=(fault,), pushes=()))
    fit = [n for n, plan in enumerate(case.plans) if not plan.holdout]
    chosen = [n for n in fit if n % 3 != 2] if fault.name == "drift" else fit[1:5:2]
    trials = [bench.run(case.plans[n], starts[n], {}) for n in chosen]
    missing = np.concatenate([bench.missing(trial) for trial in trials])
    q, v = (np.concatenate([getattr(t, key)[::5] for t in trials]) for key in ("q", "v"))
    ratios = []
    joint = case.robot.index(fault.joint)
    for n, name in enumerate(case.robot.names):
        known = []
        if case.robot.limb is not None:
            known = [np.ones(len(q)), q[:, n], v[:, n]]
        elif name in case.declared:
            known = [np.tanh(v[:, n] / 0.01), v[:, n]]
        ratios.append(_left(missing[:, n], known) / noise[n])
    whole = max(ratios) if fault.name == "payload" else ratios[joint]
    if case.robot.limb is not None and fault.name == "payload":
        whole = ratios[joint]
    if fault.name not in FORMS:
        return float(whole), np.inf
    simple = [
        np.ones(len(q)),
        v[:, joint],
        np.tanh(v[:, joint] / 0.01),
        np.tanh(v[:, joint] / 0.05),
    ]
    form = _left(missing[:, joint], [*simple, q[:, joint]]) / noise[joint]
    return float(whole), float(form)


def _left(torque: Signal, known: list[Signal]) -> float:
    if known:
        design = np.stack(known, axis=1)
        torque = torque - design @ np.linalg.lstsq(design, torque, rcond=None)[0]
    return float(np.sqrt(np.mean(torque**2)))


def shown(pushed: Trial, bare: Trial, joint: int) -> float:
    """Return by how much a push changes what its joint's motor does, at most, Nm.

    What friction holds wholly leaves no trace in a log.

    Args:
        pushed: the trial with the push.
        bare: the same trial without it.
        joint: that is pushed.
    """
    change = pushed.effort[:, joint] - bare.effort[:, joint]
    slow = butter(4, CHATTER_HZ, fs=1 / float(pushed.time[1]), output="sos")
    return float(np.abs(sosfiltfilt(slow, change)).max())
