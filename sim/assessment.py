"""The automated assessment (paper, section 2.3): parameters in, one `Assessment` out.

Don the exoskeleton, close the straps while the elbow's muscles co-contract, hold, let the
controller extend the elbow along the sigmoid, record, and regress. Whatever goes wrong is a named
outcome with the state it happened in, never a number.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import degrees
from typing import Any

import mujoco
import numpy as np

from sim.conditions import split
from sim.contact import InterfaceGauge
from sim.control import CONTROLLERS, DURATION, START, extension_reference
from sim.estimation import Fit, IllConditionedError, estimate_forms
from sim.fidelity import FIDELITIES
from sim.model import System, build_system, close_straps, reset_to_start, slacken_straps
from sim.nominal import nominal_model
from sim.record import Record, Recorder
from sim.validity import Failure, Posture, check_outcome, check_posture, check_start

#: Straps are pulled and the muscles' activation ramps up for so long, s.
DONNING = 0.3
#: The movement begins after so long, s; after 1.2 s one corner of Table 1 still moved.
HOLD = 1.5
#: Steps over which the locks' torque is averaged to start the controllers' integrals.
LOCK_AVERAGE = 5


@dataclass(frozen=True, kw_only=True)
class Assessment:
    """One assessment: its outputs if it can be believed, else the name of its failure."""

    #: "ok" or a key of `sim.validity.FAILURES`.
    outcome: str
    #: The outputs of `sim.catalogue.ELBOW`; empty unless `outcome` is "ok".
    outputs: Mapping[str, float]
    #: One sentence; empty if "ok".
    reason: str = ""
    #: Time, phase, qpos, qvel and act where it failed, as JSON; None if "ok".
    state: Mapping[str, Any] | None = None
    #: Figures for a reader beside the outputs: fits, largest angle difference, largest force.
    diagnostics: Mapping[str, float]
    #: What was recorded; None if the movement did not come to its end.
    record: Record | None


class _FailedError(Exception):
    """A detector fired."""

    def __init__(self, failure: Failure, phase: str) -> None:
        super().__init__(failure.reason)
        self.failure = failure
        self.phase = phase


def assess(
    values: Mapping[str, float],
    *,
    controller: str = "pid",
    fidelity: str = "campaign",
) -> Assessment:
    """Assess one wearer's elbow.

    Args:
        values: factors of Table 1 and of `sim.factors.CONDITIONS` (SI units); one left out is
            nominal.
        controller: "pid" (the authors' code) or "pd" (equation 19).
        fidelity: a key of `sim.fidelity.FIDELITIES`.

    Raises:
        ValueError: a factor, controller or fidelity is unknown, or a value out of its domain.
    """
    for what, name, known in (
        ("controller", controller, CONTROLLERS),
        ("fidelity", fidelity, FIDELITIES),
    ):
        if name not in known:
            raise ValueError(f"unknown {what} {name!r}: expected one of {', '.join(known)}")
    wearer, conditions = split(values)
    system = build_system(wearer, CONTROLLERS[controller], conditions, FIDELITIES[fidelity])
    data = reset_to_start(system)
    record = None
    diagnostics: dict[str, float] = {}
    try:
        _don_and_hold(system, data)
        record = _extend(system, data)
        outputs = _evaluate(record, diagnostics)
    except _FailedError as failed:
        return Assessment(
            outcome=failed.failure.name,
            outputs={},
            reason=failed.failure.reason,
            state=_state(data, failed.phase),
            diagnostics=diagnostics,
            record=record,
        )
    return Assessment(outcome="ok", outputs=outputs, diagnostics=diagnostics, record=record)


def _don_and_hold(system: System, data: mujoco.MjData) -> None:
    """Close the straps, wait until the arm rests, hand over from the locks to the controllers."""
    model = system.model
    stiffness = model.tendon_stiffness[system.straps].copy()
    step_seconds = system.fidelity.step
    donning, hold = round(DONNING / step_seconds), round(HOLD / step_seconds)
    slacken_straps(system, data)
    lock_torque = []
    for step in range(hold):
        if step == donning:
            close_straps(system, data, stiffness)
        data.ctrl[system.elbow_muscles] = system.conditions.activation * min(1.0, step / donning)
        _step(system, data, "hold")
        if step >= hold - LOCK_AVERAGE:
            lock_torque.append(_lock_torque(system, data))
    failure = check_start(
        human_speed=data.qvel[system.human_dof], exo_error=data.qpos[system.exo_qpos] - START
    )
    if failure:
        raise _FailedError(failure, "hold")
    data.eq_active[system.locks] = 0
    model.opt.disableactuator = 0
    for motor, torque in zip(system.motors, np.mean(lock_torque, axis=0), strict=True):
        integral = model.actuator_actadr[motor]
        if integral >= 0:
            data.act[integral] = torque / system.gains.ki


def _extend(system: System, data: mujoco.MjData) -> Record:
    """Let the controllers follow the reference and record every step."""
    model = system.model
    steps = round(DURATION / system.fidelity.step)
    reference, velocity = extension_reference(
        np.arange(steps) * system.fidelity.step,
        start=START[3],
        amplitude=system.conditions.movement_amplitude,
        rate=system.conditions.movement_rate,
    )
    position_input = model.actuator_ctrladr[system.motors]
    gauge, recorder = InterfaceGauge(system), Recorder(system, steps)
    exo_range = tuple(model.jnt_range[model.dof_jntid[system.exo_dof[3]]])
    data.ctrl[position_input] = START
    data.ctrl[position_input + 1] = 0.0
    for step in range(steps):
        data.ctrl[position_input[3]] = reference[step]
        data.ctrl[position_input[3] + 1] = velocity[step]
        recorder.before_step(data, reference[step])
        exo_elbow = float(data.qpos[system.exo_qpos[3]])
        human_elbow = float(data.qpos[system.human_qpos[3]])
        _step(system, data, "movement")
        resultant, normal_force = gauge.forces(data)
        penetration, overhang = gauge.seats(data)
        recorder.after_step(data, resultant, normal_force)
        failure = check_posture(
            Posture(
                exo_elbow=exo_elbow,
                human_elbow=human_elbow,
                exo_range=exo_range,
                penetration=penetration,
                overhang=overhang,
                normal_force=normal_force,
            )
        )
        if failure:
            raise _FailedError(failure, "movement")
    return recorder.record()


def inferred_torques(record: Record) -> tuple[np.ndarray, np.ndarray]:
    """Return the human elbow torque a clinic infers from a record, Nm, two arrays of shape (n,).

    The first is equation 20 with the full nominal inverse dynamics. The second is what the authors'
    code subtracts: bias torque alone, of an arm without tissue in an exoskeleton without straps.
    """
    motor = record.motor_torque[:, 3]
    declared = nominal_model().inverse_dynamics(
        record.theta, record.theta_velocity, record.theta_acceleration
    )
    published = nominal_model(attachments=False).bias(record.theta, record.theta_velocity)
    return declared - motor, published - motor


def fit_record(record: Record) -> dict[str, tuple[Fit, Fit]]:
    """Return estimate and truth of every regression form for a record.

    Raises:
        IllConditionedError: the recorded movement does not determine them.
    """
    inferred, published = inferred_torques(record)
    return estimate_forms(
        theta=record.theta[:, 3],
        theta_velocity=record.theta_velocity[:, 3],
        q=record.q[:, 3],
        q_velocity=record.q_velocity[:, 3],
        inferred_torque=inferred,
        published_torque=published,
        muscle_torque=record.muscle_torque,
    )


def _evaluate(record: Record, diagnostics: dict[str, float]) -> dict[str, float]:
    """Regress a finished movement; `diagnostics` is filled even if the result is refused."""
    try:
        forms = fit_record(record)
    except IllConditionedError as error:
        raise _FailedError(
            Failure(name="ill_conditioned", reason=str(error)), "regression"
        ) from error
    tracking = record.theta[:, 3] - record.reference
    estimate, truth = forms["affine"]
    outputs: dict[str, float] = {}
    for name, (estimated, true) in forms.items():
        suffix = "" if name == "affine" else f"_{name}"
        outputs[f"stiffness_error{suffix}"] = estimated.stiffness - true.stiffness
        outputs[f"stiffness_estimate{suffix}"] = estimated.stiffness
        outputs[f"stiffness_true{suffix}"] = true.stiffness
    assert estimate.damping is not None and truth.damping is not None
    outputs["damping_estimate"] = estimate.damping
    outputs["peak_contact_force"] = float(record.contact_force.max())
    outputs["tracking_rmse"] = float(np.sqrt(np.mean(tracking**2)))
    diagnostics.update(
        r_squared=estimate.r_squared,
        residual_rms_nm=estimate.residual_rms,
        damping_true=truth.damping,
        largest_angle_difference_deg=degrees(np.abs(record.q[:, 3] - record.theta[:, 3]).max()),
        largest_normal_force_n=float(record.normal_force.max()),
    )
    failure = check_outcome(tracking_rmse=outputs["tracking_rmse"], r_squared=estimate.r_squared)
    if failure:
        raise _FailedError(failure, "regression")
    return outputs


def _step(system: System, data: mujoco.MjData, phase: str) -> None:
    """Advance one step; a warning of the engine or a value that is not finite is a failure."""
    mujoco.mj_step(system.model, data)
    warnings = data.warning.number
    if warnings.any():
        name = mujoco.mjtWarning(int(warnings.argmax())).name.removeprefix("mjWARN_")
        raise _FailedError(
            Failure(name="diverged", reason=f"the engine warned {name} at {data.time:.2f} s"), phase
        )
    if not np.isfinite(data.qvel).all():
        raise _FailedError(
            Failure(name="diverged", reason=f"velocities are not finite at {data.time:.2f} s"),
            phase,
        )


def _lock_torque(system: System, data: mujoco.MjData) -> np.ndarray:
    """Return the torque of each lock on its joint, Nm, shape (4,)."""
    torque = np.zeros(len(system.locks))
    equality = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    for i, lock in enumerate(system.locks):
        torque[i] = data.efc_force[equality & (data.efc_id == lock)].sum()
    return torque


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
