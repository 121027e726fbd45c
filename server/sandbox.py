"""Strangers' files are looked at in a process of its own, which may crash, hang or bloat."""

import asyncio
import json
import os
import sys
import tempfile
from asyncio.subprocess import DEVNULL, PIPE
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from server.errors import BadFileError

#: Seconds that a look may take, many times what a usual session needs.
CHECK_SECONDS = 120
#: ... and MB of memory.
CHECK_MEMORY_MB = 4096
#: Looks at the same time; others wait.
CHECKS = 2


async def check(
    program: str,
    file: Path,
    *,
    wanted: Mapping[str, Any] | None = None,
    seconds: int = CHECK_SECONDS,
    memory_mb: int = CHECK_MEMORY_MB,
) -> dict[str, Any]:
    """Return what `program` understands of a file: see `intake.looks`.

    Args:
        program: the module to run, as "analysis.closeloop.check".
        file: sentences call it by its name.
        wanted: what of it, for a program that asks.
        seconds: that it may take.
        memory_mb: that it may take.

    Raises:
        BadFileError: it cannot be used, or not be looked at within the limits.
    """
    with tempfile.TemporaryDirectory(prefix="rehyb-check-") as scratch:
        # What it leaves behind when it is killed is in `scratch`. It needs no secrets.
        environment = {k: v for k, v in os.environ.items() if not k.startswith("REHYB_")}
        limits = ("--memory-mb", str(memory_mb), "--seconds", str(seconds))
        asked = () if wanted is None else ("--wanted", json.dumps(wanted))
        # -P: nothing is imported from the folder that it works in.
        command = [sys.executable, "-P", "-m", program, str(file), *limits, *asked]
        process = await asyncio.create_subprocess_exec(
            *command,
            stdin=DEVNULL,
            stdout=PIPE,
            stderr=PIPE,
            cwd=scratch,
            env={**environment, "TMPDIR": scratch},
        )
        try:
            said, complained = await asyncio.wait_for(process.communicate(), seconds)
        except TimeoutError:
            sentence = f"{file.name}: reading it takes more than {seconds} s"
            raise BadFileError(sentence, file=file.name) from None
        finally:
            # Also if the coordinator is stopped meanwhile.
            with suppress(ProcessLookupError):
                process.kill()
            await process.wait()
    try:
        answer = json.loads(said)
    except ValueError:
        why = f"reading it ends with status {process.returncode}: {_last(complained)}"
        raise BadFileError(f"{file.name}: {why}", file=file.name) from None
    if fault := answer.get("error"):
        where = {name: fault[name] for name in ("file", "column", "line")}
        raise BadFileError(fault["sentence"], **where)
    understood: dict[str, Any] = answer["answer"]
    return understood


def _last(said: bytes) -> str:
    """Return the last line a process wrote before it died."""
    lines = said.decode(errors="replace").split("\n")
    return next((line.strip()[:200] for line in reversed(lines) if line.strip()), "no word")
