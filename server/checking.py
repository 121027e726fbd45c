"""Strangers' sessions are looked at in a process of its own, which may crash, hang or bloat."""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from threading import BoundedSemaphore
from typing import Any

from server.errors import BadSessionError

#: Seconds that a look may take: the largest sessions take half a minute.
CHECK_SECONDS = 120
#: ... and MB of memory.
CHECK_MEMORY_MB = 4096
#: Looks at the same time; others wait.
CHECKS = 2

_turn = BoundedSemaphore(CHECKS)


def check(
    file: Path, *, seconds: int = CHECK_SECONDS, memory_mb: int = CHECK_MEMORY_MB
) -> dict[str, Any]:
    """Return what is understood of the zipped session `file`: see `analysis.closeloop.check`.

    Args:
        file: named as the session is to be called in a sentence.
        seconds: it may take.
        memory_mb: megabytes it may take.

    Raises:
        BadSessionError: it cannot be analysed, or not be looked at within the limits.
    """
    with _turn, tempfile.TemporaryDirectory(prefix="rehyb-check-") as scratch:
        # What it leaves behind when it is killed is in `scratch`. It has no business with secrets.
        environment = {k: v for k, v in os.environ.items() if not k.startswith("REHYB_")}
        limits = ("--memory-mb", str(memory_mb), "--seconds", str(seconds))
        # -P: nothing is imported from the folder that it works in.
        command = [sys.executable, "-P", "-m", "analysis.closeloop.check", str(file), *limits]
        try:
            ran = subprocess.run(
                command,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                cwd=scratch,
                env={**environment, "TMPDIR": scratch},
                timeout=seconds,
                check=False,
            )
        except subprocess.TimeoutExpired:
            sentence = f"{file.name}: reading it takes more than {seconds} s"
            raise BadSessionError(sentence, file=file.name) from None
    try:
        answer = json.loads(ran.stdout)
    except ValueError:
        sentence = f"{file.name}: reading it ends with status {ran.returncode}: {_last(ran.stderr)}"
        raise BadSessionError(sentence, file=file.name) from None
    if fault := answer.get("error"):
        where = {name: fault[name] for name in ("file", "column", "line")}
        raise BadSessionError(fault["sentence"], **where)
    session: dict[str, Any] = answer["session"]
    return session


def _last(said: bytes) -> str:
    """Return the last line a process wrote before it died."""
    lines = said.decode(errors="replace").split("\n")
    return next((line.strip()[:200] for line in reversed(lines) if line.strip()), "no word")
