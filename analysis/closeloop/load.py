"""Load a session: read its files, refuse what cannot be right, bring its trials to one clock."""

from dataclasses import replace
from pathlib import Path

from analysis.closeloop.exchanged import check_exchanged
from analysis.closeloop.misdeclared import check_declared
from analysis.closeloop.odd_trials import check_odd_trials
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
