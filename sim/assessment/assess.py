"""One automated assessment: parameters in, one `Assessment` out.

`sim.assessment.protocol` runs it; what was recorded is regressed here. Whatever goes wrong is a
named outcome with the state it happened in, never a number.
"""

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import degrees
from typing import Any

import mujoco
import numpy as np

from models.curves import columns
from sim.assessment.estimation import Fit, IllConditionedError, estimate_forms, fit
from sim.assessment.impedance import bone_length, local_impedance
from sim.assessment.nominal import nominal_model
from sim.assessment.protocol import run_protocol
from sim.assessment.record import Record
from sim.assessment.skin import on_skin
from sim.assessment.validity import FailedError, Failure, check_outcome
from sim.parameters.conditions import split
from sim.parameters.curves import OVER_PHASE
from sim.parameters.fidelity import CAMPAIGN, Fidelity, fidelity_of
from sim.parameters.target import ELBOW_TARGET, TARGETS
from sim.robot.control import CONTROLLERS
from sim.robot.device import NESM, load_device
from sim.system.build import build_system
from sim.system.start import reset_to_start
from sim.system.system import System

#: Shares of the human joint's travel at which its local impedance is looked at.
PLACES = {"start": 0.1, "middle": 0.5, "end": 0.9}
#: Called at every step with the system and its data, which it must leave as they are.
Watch = Callable[[System, mujoco.MjData], None]


@dataclass(frozen=True, kw_only=True)
class Assessment:
    """One assessment: its outputs if it can be believed, else the name of its failure."""

    #: "ok" or a key of `sim.assessment.validity.FAILURES`.
    outcome: str
    #: The outputs of `sim.models.ELBOW`; empty unless `outcome` is "ok".
    outputs: Mapping[str, float]
    #: One sentence; empty if "ok".
    reason: str = ""
    #: Time, phase, qpos, qvel and act where it failed, as JSON; None if "ok".
    state: Mapping[str, Any] | None = None
    #: Figures for a reader beside the outputs: fits, largest angle difference, largest force.
    diagnostics: Mapping[str, float]
    #: What was recorded; None if the movement did not come to its end.
    record: Record | None


def assess(
    values: Mapping[str, float | str],
    *,
    controller: str = "pid",
    fidelity: str | Fidelity = CAMPAIGN.name,
    target: str = ELBOW_TARGET.name,
    device: str = NESM.name,
    watch: Watch | None = None,
    curves: Collection[str] = (),
) -> Assessment:
    """Assess one joint of one wearer.

    Args:
        values: factors of Table 1 and of `sim.parameters.conditions.CONDITIONS` (SI units); one
            left out is nominal.
        controller: "pid" (the device's gains) or "pd" (without the integral: equation 19).
        fidelity: a key of `sim.parameters.fidelity.FIDELITIES`, or a discretisation of one's own.
        target: a key of `sim.parameters.target.TARGETS`: the elbow or a joint of the shoulder.
        device: one of `sim.robot.device.DEVICES`, or the path of an MJCF file
            (`docs/use/devices.md`).
        watch: sees every step, for a film (`sim.pictures.film`).
        curves: which of `sim.parameters.curves.OVER_PHASE` to give, too, point by point.

    Raises:
        ValueError: a factor, controller, fidelity, target, device or curve is unknown, a value
            means nothing, or the device cannot assess the target.
    """
    if unknown := set(curves) - set(OVER_PHASE):
        raise ValueError(f"unknown curve {min(unknown)!r}: expected one of {', '.join(OVER_PHASE)}")
    if controller not in CONTROLLERS:
        raise ValueError(
            f"unknown controller {controller!r}: expected one of {', '.join(CONTROLLERS)}"
        )
    if target not in TARGETS:
        raise ValueError(f"unknown target {target!r}: expected one of {', '.join(TARGETS)}")
    wearer, conditions = split(values)
    if controller == "pd":
        conditions = replace(conditions, integral_gain=0.0)
    robot = load_device(device)
    system = build_system(wearer, conditions, fidelity_of(fidelity), TARGETS[target], robot)
    data = reset_to_start(system)
    record = None
    diagnostics: dict[str, float] = {}
    try:
        with _watched(system, watch):
            record = run_protocol(system, data)
        outputs = _evaluate(record, diagnostics)
        outputs |= _looked_at(system, record) | _over_phase(record, curves)
        if system.fidelity.contact:
            outputs |= on_skin(record.loads, system.fidelity.step)
    except FailedError as failed:
        return Assessment(
            outcome=failed.failure.name,
            outputs={},
            reason=failed.failure.reason,
            state=_state(data, failed.phase),
            diagnostics=diagnostics,
            record=record,
        )
    return Assessment(outcome="ok", outputs=outputs, diagnostics=diagnostics, record=record)


@contextmanager
def _watched(system: System, watch: Watch | None) -> Iterator[None]:
    """Let `watch` see every step, through the engine's own callback."""
    if watch is None:
        yield
        return
    mujoco.set_mjcb_control(lambda model, data: watch(system, data))
    try:
        yield
    finally:
        mujoco.set_mjcb_control(None)


def inferred_torques(record: Record) -> tuple[np.ndarray, np.ndarray]:
    """Return the human elbow torque a clinic infers from a record, Nm, two arrays of shape (n,).

    The first is equation 20 with the full nominal inverse dynamics. The second is what the authors'
    code subtracts: bias torque alone, of an arm without tissue in an exoskeleton without straps.
    """
    device, joint = load_device(record.device), record.exo_joint
    motor = record.motor_torque[:, joint]
    declared = nominal_model(device).inverse_dynamics(
        record.theta, record.theta_velocity, record.theta_acceleration, joint
    )
    published = nominal_model(device, attachments=False).bias(
        record.theta, record.theta_velocity, joint
    )
    return declared - motor, published - motor


def fit_record(record: Record) -> dict[str, tuple[Fit, Fit]]:
    """Return estimate and truth of every regression form for a record.

    Raises:
        IllConditionedError: the recorded movement does not determine them.
    """
    inferred, published = inferred_torques(record)
    joint, exo_joint = record.joint, record.exo_joint
    return estimate_forms(
        theta=record.theta[:, exo_joint],
        theta_velocity=record.theta_velocity[:, exo_joint],
        q=record.q[:, joint],
        q_velocity=record.q_velocity[:, joint],
        inferred_torque=inferred,
        published_torque=published,
        muscle_torque=record.muscle_torque,
    )


def _evaluate(record: Record, diagnostics: dict[str, float]) -> dict[str, float]:
    """Regress a finished movement; `diagnostics` is filled even if the result is refused."""
    try:
        forms = fit_record(record)
    except IllConditionedError as error:
        raise FailedError(
            Failure(name="ill_conditioned", reason=str(error)), "regression"
        ) from error
    theta, q = record.theta[:, record.exo_joint], record.q[:, record.joint]
    tracking = theta - record.reference
    estimate, truth = forms["affine"]
    outputs: dict[str, float] = {}
    for name, (estimated, true) in forms.items():
        suffix = "" if name == "affine" else f"_{name}"
        outputs[f"stiffness_error{suffix}"] = estimated.stiffness - true.stiffness
        outputs[f"stiffness_estimate{suffix}"] = estimated.stiffness
        outputs[f"stiffness_true{suffix}"] = true.stiffness
        outputs[f"stiffness_true_r2{suffix}"] = true.r_squared
    q_velocity = record.q_velocity[:, record.joint]
    for name, torque in (("passive", record.passive_torque), ("sum", record.human_torque)):
        part = fit(torque, q, q_velocity, damping=True, constant=True)
        outputs[f"stiffness_{name}"] = part.stiffness
        outputs[f"stiffness_{name}_r2"] = part.r_squared
    assert estimate.damping is not None and truth.damping is not None
    outputs["damping_estimate"] = estimate.damping
    outputs["peak_contact_force"] = float(record.loads.contact_force.max())
    outputs["tracking_rmse"] = float(np.sqrt(np.mean(tracking**2)))
    diagnostics.update(
        r_squared=estimate.r_squared,
        residual_rms_nm=estimate.residual_rms,
        damping_true=truth.damping,
        largest_angle_difference_deg=degrees(np.abs(q - theta).max()),
        largest_normal_force_n=float(record.loads.normal_force.max()),
    )
    failure = check_outcome(tracking_rmse=outputs["tracking_rmse"], r_squared=estimate.r_squared)
    if failure:
        raise FailedError(failure, "regression")
    return outputs


def _looked_at(system: System, record: Record) -> dict[str, float]:
    """Return what the compiled model tells beside the movement.

    Both look with the same data: to make it takes as long as thirty steps without contact.
    """
    data = mujoco.MjData(system.model)
    bones = _bones(system.model, data)
    return _local(system, record, data) | bones


def _local(system: System, record: Record, data: mujoco.MjData) -> dict[str, float]:
    """Return the local impedance at the start, in the middle and at the end of the movement."""
    found = local_impedance(system, data, record, record.steps_at(PLACES.values()))
    return {
        f"local_{quantity}_{place}": float(value)
        for quantity, values in zip(("stiffness", "damping"), found, strict=True)
        for place, value in zip(PLACES, values, strict=True)
    }


def _over_phase(record: Record, wanted: Collection[str]) -> dict[str, float]:
    """Return curves over the movement's phase, the share of its time that has passed."""
    found: dict[str, float] = {}
    for name, curve in OVER_PHASE.items():
        if name in wanted:
            points = record.over_phase(_CURVES[name](record), curve.points)
            found |= zip(columns(name, curve.points), points.tolist(), strict=True)
    return found


_CURVES: Mapping[str, Callable[[Record], np.ndarray]] = {
    "torque_over_phase": lambda record: inferred_torques(record)[0],
    "angle_error_over_phase": lambda record: (
        record.theta[:, record.exo_joint] - record.q[:, record.joint]
    ),
    "contact_force_over_phase": lambda record: record.loads.contact_force.max(axis=-1),
}


def _bones(model: mujoco.MjModel, data: mujoco.MjData) -> dict[str, float]:
    """Return the lengths that the bones have in the compiled model, m; `data` is fresh."""
    mujoco.mj_kinematics(model, data)
    return {
        "shoulder_to_elbow": bone_length(data, "humerus", "ulna"),
        "elbow_to_wrist": bone_length(data, "ulna", "hand"),
    }


def _state(data: mujoco.MjData, phase: str) -> dict[str, Any]:
    """Return what is needed to look at a failure again, as JSON; values not finite become None."""

    def finite(values: np.ndarray) -> list[float | None]:
        return [float(v) if np.isfinite(v) else None for v in values]

    return {
        "time": float(data.time),
        "phase": phase,
        "qpos": finite(data.qpos),
        "qvel": finite(data.qvel),
        "act": finite(data.act),
    }
