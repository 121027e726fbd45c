"""Look at a zipped session, in a process of its own, and say as JSON whether it can be analysed.

`python -m analysis.closeloop.check FILE` prints one line: {"answer": ...} of a session that can
be analysed, {"error": ...} of one that cannot. A caller that takes files from strangers runs
this: nothing of theirs is unpacked, parsed or given to MuJoCo in the process that asks.
"""

from pathlib import Path
from typing import Any

from analysis.closeloop.errors import SessionError
from intake.looks import look


def check(file: Path) -> dict[str, Any]:
    """Return what is understood of the session in zip file `file`, as JSON.

    Raises:
        SessionError: it cannot be analysed; see `load_session`.
    """
    from analysis.closeloop.session.archive import unpacked

    with unpacked(file) as folder:
        # MuJoCo takes a second to load: not for what is no session at all.
        from analysis.closeloop.load import load_session

        recording = load_session(folder)
    session, joints = recording.session, recording.device.joints
    return {
        "model": session.model,
        "declared_effects": [
            {"effect": entry.effect, "joint": entry.joint} for entry in session.declared
        ],
        "ignored_joints": list(session.ignored_joints),
        "analysed_joints": [joints[joint] for joint in recording.joints],
        "trials": [
            {
                "file": trial.file,
                "label": trial.label,
                "group": trial.group,
                "role": trial.role,
                "seconds": float(trial.time[-1] - trial.time[0]),
                "samples": len(trial.time),
                "joints": [name for name in joints if f"{name}.position" in trial.columns],
            }
            for trial in session.trials
        ],
        "unread": list(session.unknown),
    }


if __name__ == "__main__":
    look(check, SessionError, lambda detail, file: SessionError(detail, file=file))
