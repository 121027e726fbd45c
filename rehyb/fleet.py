"""A coordinator, its analysis and some workers as child processes of this one."""

import fcntl
import os
import re
import secrets
import signal
import subprocess
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, Self

from models.tokens import usable
from rehyb.errors import FleetError, Invalid
from rehyb.whole_files import make_folder

#: What `rehyb coordinator` prints once it accepts connections.
LISTENING = re.compile(r"^listening on (https?://\S+:(\d+))", re.MULTILINE)
#: What it has logged last while it waits for its database.
WAITING = re.compile(r'"event": "(the database is away, and waited for: [^"]*)"[^\n]*\n\Z')
#: Seconds a coordinator may take to build its database and listen.
START_SECONDS = 60.0
#: Seconds for what runs to finish, and then for what is cut short to end.
STOP_SECONDS = 8.0
CUT_SHORT_SECONDS = 4.0
#: Status of a command that was told something impossible.
MISUSED = 2
#: A process that dies this often within so many seconds will not be better for another start.
DEATHS = 5
DEATHS_SECONDS = 60.0


class LocalFleet:
    """Everything a study needs, on this machine, for as long as the `with` block lasts.

    The processes run in sessions of their own, so that Ctrl-C reaches this process only, which
    then stops them in order; on Linux they also end when this process is killed. The directory
    keeps the database, the token, the spooled results and a log per process, so that a later fleet
    in the same directory carries on.

    Args:
        directory: made if missing; one fleet at a time.
        workers: how many worker processes, each evaluating one instance at a time.
        models: folders of models whose programs the workers may run.
        host: the address the coordinator listens on.
        port: 0 takes any free port.
        token: default: the one kept in the directory, made on first use.
        database_url: default: a SQLite file in the directory.
        say: is told in a sentence what the start waits for, if it is long.

    Raises:
        Invalid: the directory is a file, or lies in one.
        FleetError: the token is one that no request can bear.
    """

    def __init__(
        self,
        directory: Path,
        *,
        workers: int,
        models: Sequence[Path] = (),
        host: str = "127.0.0.1",
        port: int = 0,
        token: str | None = None,
        database_url: str | None = None,
        say: Callable[[str], object] = lambda _: None,
    ) -> None:
        self.directory = directory.resolve()
        try:
            given = usable(token or "")
            make_folder(self.directory, "a fleet")
            self.token = given or _kept_token(self.directory / "token")
        except ValueError as error:
            raise FleetError(f"{self.directory} gets no coordinator: {error}") from None
        #: Where the coordinator listens; empty before the fleet has started.
        self.url = ""
        self._workers = workers
        self._models = [word for folder in models for word in ("--models", str(folder.resolve()))]
        self._say = say
        self._lock: IO[str] | None = None
        self._processes: list[_Process] = []
        self._environment = os.environ | {
            "REHYB_DATABASE_URL": database_url or f"sqlite:///{self.directory}/rehyb.sqlite3",
            "REHYB_TOKEN": self.token,
            "REHYB_HOST": host,
            "REHYB_PORT": str(port),
            "PYTHONUNBUFFERED": "1",
        }

    def __enter__(self) -> Self:
        try:
            self._start()
        except BaseException:
            self._stop()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._stop()

    def supervise(self) -> None:
        """Restart what has died; to be called every second or so.

        Raises:
            FleetError: a process dies again and again; it says how the last one ended.
        """
        for process in self._processes:
            process.revive()

    def pids(self) -> dict[str, int]:
        """Return the process id of every member by its name."""
        return {process.name: process.pid for process in self._processes}

    def _start(self) -> None:
        self._lock = locked(self.directory / "lock")
        coordinator = self._add("coordinator", "rehyb", "coordinator")
        match = coordinator.wait_for(LISTENING, START_SECONDS, self._say)
        port = match.group(2)
        # A coordinator that has to be restarted must come back where its workers look for it.
        self._environment["REHYB_PORT"] = port
        self.url = re.sub(r"//(0\.0\.0\.0|\[::\]):", "//127.0.0.1:", match.group(1))
        self._environment["REHYB_URL"] = self.url
        self._add("analysis", "rehyb", "analysis")
        spool = str(self.directory / "spool")
        for number in range(1, self._workers + 1):
            self._add(
                f"worker-{number}", "worker", "--processes", "1", "--spool", spool, *self._models
            )

    def _add(self, name: str, module: str, *arguments: str) -> "_Process":
        from models.processes import python

        process = _Process(
            name,
            python("-m", module, *arguments),
            self._environment,
            self.directory / "logs" / f"{name}.log",
        )
        self._processes.append(process)
        return process

    def _stop(self) -> None:
        """Stop the workers first, so that they can still hand in what they have."""
        try:
            workers = [p for p in self._processes if p.name.startswith("worker-")]
            _end(workers)
            _end([p for p in self._processes if p not in workers])
        finally:
            # A second Ctrl-C lands here: nothing is waited for any more.
            for process in self._processes:
                process.kill()
            self._processes.clear()
            if self._lock is not None:
                self._lock.close()
                self._lock = None


class _Process:
    """One child process, its log, and how often it has died."""

    def __init__(
        self, name: str, command: list[str], environment: dict[str, str], log: Path
    ) -> None:
        self.name = name
        self._command = command
        self._environment = environment
        self._log = log
        self._log_start = 0
        self._deaths: deque[float] = deque(maxlen=DEATHS)
        self._popen = self._started()

    @property
    def pid(self) -> int:
        return self._popen.pid

    def _started(self) -> subprocess.Popen[bytes]:
        from models.processes import die_with_parent

        parent = os.getpid()
        self._log.parent.mkdir(exist_ok=True)
        with self._log.open("ab") as log:
            self._log_start = log.tell()
            return subprocess.Popen(
                self._command,
                env=self._environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                # Safe here: this process has one thread, and the call is one system call.
                preexec_fn=lambda: die_with_parent(parent, signal.SIGTERM),
            )

    def revive(self) -> None:
        if self._popen.poll() is None:
            return
        now = time.monotonic()
        self._deaths.append(now)
        if len(self._deaths) == DEATHS and now - self._deaths[0] < DEATHS_SECONDS:
            raise FleetError(
                f"the {self.name} died {DEATHS} times within {DEATHS_SECONDS:g} s, "
                f"last {self._how_it_ended()} and with {self._last_line()}"
            )
        self._popen = self._started()

    def wait_for(
        self, pattern: re.Pattern[str], seconds: float, say: Callable[[str], object]
    ) -> re.Match[str]:
        """Return what it writes once it is ready; the time in which it says it waits is its own."""
        deadline = time.monotonic() + seconds
        told = ""
        while time.monotonic() < deadline:
            ended = self._popen.poll() is not None
            written = self._written()
            if match := pattern.search(written):
                return match
            if ended:
                # It says so of what it was told, which is what this fleet was told.
                kind = Invalid if self._popen.returncode == MISUSED else FleetError
                raise kind(f"the {self.name} did not start: {self._last_line()}")
            if waits := WAITING.search(written):
                deadline = time.monotonic() + seconds
                if waits[1] != told:
                    say(f"{waits[1]}; Ctrl-C gives up")
                told = waits[1]
            time.sleep(0.05)
        raise FleetError(f"the {self.name} was not ready after {seconds:g} s: see {self._log}")

    def signal(self, number: signal.Signals) -> None:
        if self._popen.poll() is None:
            self._popen.send_signal(number)

    def ended_by(self, deadline: float) -> bool:
        try:
            self._popen.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            return False
        return True

    def kill(self) -> None:
        self._popen.kill()
        self._popen.wait()

    def _written(self) -> str:
        with self._log.open("rb") as log:
            log.seek(self._log_start)
            return log.read().decode(errors="replace")

    def _how_it_ended(self) -> str:
        status = self._popen.returncode
        return f"by {signal.Signals(-status).name}" if status < 0 else f"with status {status}"

    def _last_line(self) -> str:
        lines = [line.strip() for line in self._written().splitlines() if line.strip()]
        # Who reads it has been told by then which command speaks.
        said = lines[-1].removeprefix("rehyb: ") if lines else "no word"
        return f"{said} (see {self._log})"


def _end(processes: list[_Process]) -> None:
    """Ask to finish, then to stop at once."""
    for seconds in (STOP_SECONDS, CUT_SHORT_SECONDS):
        for process in processes:
            process.signal(signal.SIGTERM)
        deadline = time.monotonic() + seconds
        if all(process.ended_by(deadline) for process in processes):
            return


def _kept_token(path: Path) -> str:
    """Return the token kept at `path`, readable by its owner only; make one on first use."""
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        return usable(path.read_text())
    token = secrets.token_urlsafe(24)
    try:
        with os.fdopen(descriptor, "w") as file:
            file.write(token + "\n")
    except OSError as error:
        # Half of one on a full disk would be kept as the whole.
        path.unlink()
        raise OSError(error.errno, os.strerror(error.errno or 0), str(path)) from error
    return token


def locked(path: Path) -> IO[str]:
    """Lock a folder by a file in it, until that is closed; FleetError if somebody else has it."""
    file = path.open("w")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        raise FleetError(
            f"something else runs in {path.parent}: wait for it, or use another directory"
        ) from None
    return file
