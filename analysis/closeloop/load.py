"""Load a session: read its files, refuse what cannot be right, bring its trials to one clock."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from analysis.closeloop.errors import naming_unsolvable
from analysis.closeloop.exchanged import check_exchanged
from analysis.closeloop.magnitudes import SAID, are_magnitudes
from analysis.closeloop.misdeclared import check_declared
from analysis.closeloop.odd_trials import check_odd_trials
from analysis.closeloop.session.contents import Trial
from analysis.closeloop.session.device import Device
from analysis.closeloop.session.faults import fault
from analysis.closeloop.session.files import SESSION_FILE
from analysis.closeloop.session.mjcf import load_device
from analysis.closeloop.session.plausibility import (
    check_copies,
    check_frozen,
    check_saturated,
    check_torque,
    checked_trial,
)
from analysis.closeloop.session.reading import read_session, unread_sensors
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.stretches import record
from analysis.closeloop.session.trial_csv import read_trial
from analysis.closeloop.signs import check_signs, check_turned
from analysis.closeloop.units import check_units
from sim.effects.catalogue import BY_NAME


@naming_unsolvable(SESSION_FILE)
def load_session(folder: Path) -> Recording:
    """Return the recording of the session in `folder`.

    Raises:
        SessionError: the first thing that is wrong.
    """
    session = read_session(folder, tuple(BY_NAME))
    device = load_device(session)
    declared = tuple(dict.fromkeys(entry.joint for entry in session.declared))
    trials = []
    for listed in session.trials:
        trial = read_trial(folder, listed, device.recorded_joints, declared)
        check_frozen(trial, device)
        check_exchanged(trial, device, session.limb_joints)
        trials.append(checked_trial(trial, device, session.limb_joints))
    check_copies(trials)
    if not session.limb_joints:
        check_signed(trials, device)
    check_saturated(trials, device)
    session = unread_sensors(session, {name for trial in trials for name in trial.columns})
    recording = record(replace(session, trials=tuple(trials)), device)
    check_signs(recording)
    check_turned(recording)
    check_odd_trials(recording)
    check_units(recording)
    check_declared(recording)
    for trial in trials:
        check_torque(trial, device, session.limb_joints)
    return recording


def check_signed(trials: Sequence[Trial], device: Device) -> None:
    """Refuse a robot's efforts without their sign: each joint would be told to be turned round.

    Raises:
        SessionError: names the first effort.
    """
    names = [
        name
        for name in device.recorded_joints
        if all(f"{name}.effort" in trial.columns for trial in trials)
    ]
    signals = {
        name: [(t.columns[f"{name}.position"], t.columns[f"{name}.effort"]) for t in trials]
        for name in names
    }
    if are_magnitudes(signals):
        raise fault(trials[0], SAID, f"{names[0]}.effort")
