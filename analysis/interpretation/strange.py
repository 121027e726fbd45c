"""Why a recording is unlike a bank's, or what is known does not go with it, in words.

What a session says that it carries comes first, then what no sensor reads alone, then the
comparison with the bank's recordings as a whole (Mahalanobis 1936, On the generalised distance in
statistics).
"""

from dataclasses import replace
from math import pi

import numpy as np
from scipy.special import ndtri

from analysis.interpretation.bank.bank import Bank
from analysis.interpretation.friction import rubs
from analysis.interpretation.inference.familiarity import CALLED_STRANGE
from analysis.interpretation.inference.features import RECORDED
from analysis.interpretation.inference.interpreter import Interpreter, Known
from analysis.interpretation.inference.rounding import ALLOWED, moved_by_rounding
from analysis.interpretation.inference.view import View
from analysis.interpretation.recording import Recording
from analysis.interpretation.sensors import misread, posture
from analysis.interpretation.sensors import steps as steps_of
from sim.models import WINDOWS
from sim.parameters.effects import PREFIX
from sim.robot.device import NESM, load_device

#: Share of samples that may be single ones far from their neighbours; ours, as `sensors.SPAN`.
MOST_REPLACED = 0.01


def unfamiliar(
    bank: Bank, interpreter: Interpreter, recording: Recording, values: np.ndarray
) -> str | None:
    """Return why a recording (its `values`, too) is unlike the bank's, or None."""
    for name, count in recording.replaced.items():
        if count > MOST_REPLACED * len(recording.motion.time):
            return f"{count} samples of the {name} are far from their neighbours"
    if why := _carried(bank, recording) or _filtered(interpreter, recording, values):
        return why
    features, familiarity = interpreter.features, interpreter.familiarity
    gain, off = recording.velocity_check()
    allowed = _velocity_error(interpreter)
    if off > allowed:
        return (
            f"the elbow's velocity is not the slope of its angle over time: it is {gain:.2f} times "
            f"it, and off by {off:.2g} rad/s, where {allowed:.2g} is as much as goes unnoticed"
        )
    device = load_device(NESM.name)
    if why := posture(recording.motion, device, contact=interpreter.correction is not None):
        return why
    if why := misread(recording.motion, device, bank.population):
        return why
    if why := _coarse(bank, interpreter, recording):
        return why
    if why := rubs(recording.motion, device, bank.population):
        return why
    scaled = features.scaled(values[None])[0]
    if offset := familiarity.offset(scaled):
        which, found, most = offset
        scale = features.scale[1, WINDOWS * which]
        # The motor's torque is subtracted in its curve.
        what, sign, unit = (f"torque of J{which}", -1, "Nm") if which else ("angle of J4", 1, "rad")
        return (
            f"the {what} has an offset of about {sign * found * scale:+.2g} {unit} that the bank's "
            f"recordings do not have ({most * scale:.2g} {unit} at most)"
        )
    distance, limit = familiarity.distance(scaled), familiarity.limit
    if distance > limit:
        return (
            f"{familiarity.strangest(scaled)} is unlike the bank's recordings (squared "
            f"distance {distance:.0f}, of the bank's own {limit:.0f} at most)"
        )
    return None


def _carried(bank: Bank, recording: Recording) -> str | None:
    """Return which load a recording has by its session and the bank's have not, or None."""
    there = (*bank.population.names, *bank.population.fixed)
    for load in recording.loads:
        if not any(name.startswith(f"{PREFIX}{load}.") for name in there):
            return (
                f"the session declares {load}, which moves K unseen and which this bank's "
                "recordings do not have: record without it, or build a bank that has it "
                "(`rehyb bank build --with-effect`)"
            )
    return None


def _filtered(interpreter: Interpreter, recording: Recording, values: np.ndarray) -> str | None:
    """Return what a declared low-pass of the torques does to K if it is too much, or None.

    A second one of the same kind moves K by as much again: by 0.54 of its half width at 1 Hz, where
    the first moved it by 0.54, and by 0.26 and 0.25 at 2 Hz (mean of 40 wearers, seed 7111).
    """
    cutoff, motion = recording.effort_filter_hz, recording.motion
    if cutoff is None:
        return None
    # It loads scipy.signal and with it statistics, a sixth of an answer's time.
    from analysis.closeloop.session.signals import lagged

    rate = 1.0 / float(np.median(np.diff(motion.time)))
    twice = replace(motion, torque=lagged(motion.torque, 1.0 / (2.0 * pi * cutoff), rate))
    once, again = (
        interpreter.infer(interpreter.look(own))
        for own in (values, replace(recording, motion=twice).values())
    )
    moved = abs(float(again.centre[0] - once.centre[0])) / once.half_width()
    if moved <= ALLOWED:
        return None
    return (
        f"the torques are behind a low-pass of {cutoff:g} Hz, which moves K by {moved:.2g} of its "
        "half width: record them before it"
    )


def _coarse(bank: Bank, interpreter: Interpreter, recording: Recording) -> str | None:
    """Return whose torque is recorded in too large steps, or None."""
    apart = steps_of(recording.motion)
    moved = moved_by_rounding(interpreter, bank, apart)
    if moved <= ALLOWED:
        return None
    alone = [moved_by_rounding(interpreter, bank, apart * one) for one in np.eye(len(apart))]
    worst = int(np.argmax(alone))
    allowed = apart[worst] * ALLOWED / moved
    return (
        f"the torque of {NESM.joints[worst]} is recorded in steps of {apart[worst]:.2g} Nm, which "
        f"move K by {moved:.2g} of its half width: record in steps of {allowed:.2g} Nm or less"
    )


def contrary(interpreter: Interpreter, view: View, known: tuple[Known, ...]) -> str | None:
    """Return what is known that does not go with the recording, or None.

    `view`: by the bank's sets of muscles, which tells factors best. With the paper's muscles left
    out of a bank 12 % of 125 wearers of whom lengths and a mass are known rightly are called so.
    """
    if not known:
        return None
    found, limit, worst = interpreter.surprise(view, known)
    if found <= limit:
        return None
    one = known[worst]
    unit = interpreter.population.unit_after(one.name)
    return (
        f"what was measured on the patient does not go with the recording, most of all "
        f"{one.name} {one.value:g}{unit}: measure again; if it stays so, the limb's muscles are "
        f"unlike the bank's (squared distance {found:.0f}, of the bank's own {limit:.0f} at most)"
    )


def _velocity_error(interpreter: Interpreter) -> float:
    """Return what a velocity may be off by, rad/s, root mean square.

    Times the damping of the bank's regressions it is a torque that its sensors' zero error has in
    all but CALLED_STRANGE; without such an error, what these regressions leave.
    """
    usual = interpreter.features.scale[0]
    torque = interpreter.population.torque_zero * float(ndtri(1.0 - CALLED_STRANGE / 2.0))
    torque = torque or abs(float(usual[RECORDED.index("residual")]))
    return torque / abs(float(usual[RECORDED.index("affine_damping")]))
