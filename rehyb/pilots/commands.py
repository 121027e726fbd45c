"""The commands of a batch system, run so that none outlives the time it is given."""

import os
import signal
import subprocess
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile


def run(command: str, seconds: float | None = None) -> tuple[int, str, str]:
    """Run a line of shell; return its status and what it printed, as parsl's `execute_wait` does.

    That one waits until nobody holds the line's output open, which a child left behind may do for
    ever, and leaves a line that hangs behind.

    Raises:
        TimeoutError: it gave no answer in time; it is killed, and what it started.
    """
    # Files have an end as soon as the line ends.
    with TemporaryFile() as out, TemporaryFile() as err:
        process = subprocess.Popen(
            command, shell=True, stdout=out, stderr=err, stdin=subprocess.DEVNULL, process_group=0
        )
        try:
            status = process.wait(seconds)
        except BaseException as error:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            if isinstance(error, subprocess.TimeoutExpired):
                name = Path(command.split()[0]).name
                raise TimeoutError(f"{name} gave no answer within {seconds:g} s") from None
            raise
        texts = []
        for file in (out, err):
            file.seek(0)
            texts.append(file.read().decode(errors="replace"))
        return status, texts[0], texts[1]
