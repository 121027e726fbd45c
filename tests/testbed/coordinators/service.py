"""A process of `rehyb coordinator` or `rehyb analysis`, and the lines that it says."""

import os
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

#: Until something that is certain to happen must have happened; the longest pause is 8 s.
PATIENCE_SECONDS = 60.0


class Service:
    """A process of one of rehyb's commands that run for long.

    Args:
        command: its name.
        url: of the database.
        options: of the command.
        settings: other variables of its environment.
    """

    def __init__(self, command: str, url: str, *options: str, **settings: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "rehyb", command, *options],
            env=os.environ | {"REHYB_DATABASE_URL": url, **settings},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self._lines = queue.Queue[str]()
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        with self.process.stdout as lines:
            for line in lines:
                self._lines.put(line)

    def said(self) -> str:
        """Return its next line, which is waited for."""
        return self._lines.get(timeout=PATIENCE_SECONDS)

    def stop(self) -> int:
        """Ask it to end as an operator does, and return its exit status."""
        self.process.send_signal(signal.SIGTERM)
        return self.ended()

    def ended(self) -> int:
        """Wait until it ends by itself, and return its exit status."""
        status = self.process.wait(PATIENCE_SECONDS)
        self._reader.join()
        return status

    def is_silent(self) -> bool:
        """Say whether there is no further line yet."""
        return self._lines.empty()


@contextmanager
def running(command: str, url: str, *options: str, **settings: str) -> Iterator[Service]:
    """Run a command for as long as the block lasts; arguments as of `Service`."""
    service = Service(command, url, *options, **settings)
    try:
        yield service
    finally:
        service.process.kill()
        service.ended()
