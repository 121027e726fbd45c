"""Look at a zipped session, in a process of its own, and say as JSON whether it can be analysed.

`python -m analysis.closeloop.check FILE` prints one line: {"session": ...} of a session that can
be analysed, {"error": ...} of one that cannot. A caller that takes files from strangers runs
this: nothing of theirs is unpacked, parsed or given to MuJoCo in the process that asks.
"""

import argparse
import json
import resource
import sys
from pathlib import Path
from typing import Any

from analysis.closeloop.errors import SessionError

#: Characters kept of a sentence that quotes a stranger's file.
SENTENCE_LENGTH = 2000


def main() -> None:
    """Check the session named on the command line."""
    parser = argparse.ArgumentParser(description="Say whether a zipped session can be analysed.")
    parser.add_argument("file", type=Path)
    parser.add_argument("--memory-mb", type=int, default=4096)
    parser.add_argument("--seconds", type=int, default=300, help="of processor time")
    arguments = parser.parse_args()
    # Before anything of the file is read.
    limit(arguments.memory_mb, arguments.seconds)
    try:
        answer = {"session": check(arguments.file)}
    except SessionError as error:
        answer = {"error": _said(error)}
    except MemoryError:
        what = f"takes more than {arguments.memory_mb} MB of memory to read"
        answer = {"error": _said(SessionError(what, file=arguments.file.name))}
    json.dump(answer, sys.stdout)


def limit(memory_mb: int, seconds: int) -> None:
    """Let this process have so much memory (MB) and processor time (s), and write no core file."""
    resource.setrlimit(resource.RLIMIT_DATA, (memory_mb * 2**20, memory_mb * 2**20))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


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


def _said(error: SessionError) -> dict[str, Any]:
    return {
        "sentence": _cut(str(error)),
        "file": _cut(error.file),
        "column": None if error.column is None else _cut(error.column),
        "line": error.line,
    }


def _cut(text: str) -> str:
    """Return text from a stranger's file, shortened and safe to store and print."""
    return text[:SENTENCE_LENGTH].encode(errors="backslashreplace").decode().replace("\0", " ")


if __name__ == "__main__":
    main()
