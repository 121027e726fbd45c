"""The answer to a session in which no joint moves: whether somebody pushed, and nothing else."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.closeloop.contract import SCHEMA, Verdict
from analysis.closeloop.identification.balance.accuracy import raw_errors, rms_by_joint
from analysis.closeloop.identification.balance.trial_error import TrialError
from analysis.closeloop.identification.findings import Event
from analysis.closeloop.judgement.floor import floors
from analysis.closeloop.report.answer import Answer
from analysis.closeloop.report.plain import CONVENTION, finite, session_entry
from analysis.closeloop.report.unexplained import floor_entries, only_events, untouched
from analysis.closeloop.session.recording import Recording

NOTHING_MOVES = (
    "no joint moves long enough to judge the model by: only pushes and knocks are looked for"
)


def still_answer(recording: Recording, events: Sequence[Event]) -> Answer:
    """Return the answer to a session without motion.

    Friction holds a joint at rest with any torque, so neither the residual's level nor its creep
    says anything of the declared model; the errors are given as they are.

    Args:
        recording: of which no joint moves long enough for a fit.
        events: torque that is local in time.
    """
    trials = tuple(range(len(recording.session.trials)))
    errors = raw_errors(recording, recording.static, trials)
    lowest = floors(recording, [_centred(error) for error in errors])
    entries = {
        recording.name(joint): {
            "before": size,
            "after": size,
            "floor": lowest[joint].value if joint in lowest else None,
            "unit": recording.device.unit(recording.name(joint)),
        }
        for joint, (size, _) in rms_by_joint(errors).items()
    }
    pushed = sorted({event.joint for event in events})
    report = {
        "schema": SCHEMA,
        "verdict": Verdict.UNEXPLAINED if events else Verdict.NOT_IDENTIFIABLE,
        "convention": CONVENTION,
        "effects": [],
        "error": {"holdout": entries, "fit": entries},
        "impedance": {},
        "identified": {},
        "declared": [],
        "unnamed_loads": [],
        "links": {},
        "unexplained": {
            recording.name(joint): only_events(recording, [e for e in events if e.joint == joint])
            for joint in pushed
        },
        "floor": floor_entries(recording, lowest),
        "diagnostics": {},
        "advice": [
            *untouched(recording, events),
            "Move every joint to and fro, at two or more speeds.",
        ],
        "warnings": [NOTHING_MOVES],
        "session": session_entry(recording),
        "ladder": [],
    }
    return Answer(report=finite(report), recording=recording, before=errors, after=errors)


def _centred(error: TrialError) -> TrialError:
    """Return an error about its own mean, for its spectrum."""
    return replace(error, predicted=error.predicted + float(np.mean(error.residual)))
