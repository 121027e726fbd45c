"""Models of kind `command`: a program that takes one line of JSON and answers with one.

The program is code of the worker's owner, who named its folder; it runs in a group of processes
of its own, which ends with the evaluation, or with the worker if the program is kept.
"""

import json
import os
import resource
import selectors
import signal
import subprocess
import time
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from typing import IO, Any

from models.description import complete
from models.evaluation import ModelFailure, columns
from models.folder import ModelFolder
from models.processes import descendants, die_with_parent, end, memory_of, orphans

#: Of one answer. A curve of a million points would be 20 MB; a program that prints more is stuck.
MAX_ANSWER_BYTES = 5_000_000
#: Of what a program says on stderr, the end is kept.
STDERR_BYTES = 4_000
CHUNK = 65_536
#: That a program may take unless the worker's owner says otherwise.
MEMORY_BYTES = 4 * 2**30
#: Seconds between two looks at what a program and all that it started take together.
LOOK_SECONDS = 0.25
#: A whole number with so many digits is larger than any double.
MOST_DIGITS = 400
#: Seconds that a program gets to exit by itself once it has answered.
GRACE_SECONDS = 2.0
#: What a program must do that ends before it answers, and takes that for right.
_ONCE = ": it must print one line of JSON on stdout for the line that it reads"
_KEPT = (
    ": with keep = true it must stay, and print and flush one line of JSON for each line that it "
    "reads, until there is no other"
)
#: Programs of this process that have not ended.
_RUNNING: set[int] = set()


class Command:
    """A program that is evaluated at many points."""

    def __init__(self, folder: ModelFolder) -> None:
        self._words, self._keep = folder.run["run"], folder.run.get("keep", False)
        self._folder, self._description = folder.path, folder.description
        self._running: _Program | None = None
        #: Whether it says to which parameters an answer belongs.
        self._repeats = False

    def __call__(self, parameters: Mapping[str, float], seed: int = 0) -> dict[str, float]:
        """Return the outputs at `parameters` (SI units; one left out is nominal).

        Raises:
            ValueError: a parameter is unknown or not finite.
            ModelFailure: the program's own outcome; "timed_out"; "crashed": it ended, or could
                not be started; "bad_answer": it answered with something else than one line, or at
                other parameters.
        """
        values = complete(self._description, parameters)
        question = json.dumps({"parameters": values, "seed": seed}) + "\n"
        limit = self._description.time_limit
        deadline = None if limit is None else time.monotonic() + limit
        program = self._running or _Program(self._words, self._folder, keep=self._keep)
        self._running = None
        try:
            answer = program.ask(question.encode(), deadline)
            self._check_place(answer, values)
        except BaseException:
            program.end()
            raise
        if self._keep:
            self._running = program
        else:
            program.end()
        return columns(self._description, _outputs(answer))

    def _check_place(self, answer: Any, asked: Mapping[str, float]) -> None:
        """Check that an answer is the one at `asked`, of a program that tells.

        A line too many of one that is kept is else the answer to the next line.
        """
        told = answer.get("parameters") if isinstance(answer, dict) else None
        self._repeats = self._repeats or told is not None
        if self._repeats and told != asked:
            said = "no parameters" if told is None else f"parameters {json.dumps(told)[:80]}"
            raise ModelFailure(
                "bad_answer",
                f"the program answered with {said}, not with those that it was asked: it must "
                "print one line for each line that it reads",
            )

    def close(self) -> None:
        """End a program that was kept."""
        if self._running is not None:
            self._running.end()
            self._running = None


class _Program:
    """A running program and the pipes to it."""

    def __init__(self, words: list[str], folder: os.PathLike[str], *, keep: bool) -> None:
        self._keep = keep
        try:
            self._process = subprocess.Popen(
                words,
                cwd=folder,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                start_new_session=True,
                preexec_fn=partial(_limit, os.getpid()),
            )
        except OSError as error:
            raise ModelFailure(
                "crashed", f"{words[0]} cannot be started: {error.strerror}"
            ) from None
        _RUNNING.add(self._process.pid)
        self._said = b""
        self._complaint = b""
        assert self._process.stdin and self._process.stdout and self._process.stderr
        # An answer as long as a pipe's buffer would block us both otherwise.
        os.set_blocking(self._process.stdin.fileno(), False)
        self._ears = selectors.DefaultSelector()
        self._ears.register(self._process.stdout, selectors.EVENT_READ)
        self._ears.register(self._process.stderr, selectors.EVENT_READ)
        self._look_at = time.monotonic() + LOOK_SECONDS

    def ask(self, question: bytes, deadline: float | None) -> Any:
        """Return the JSON of the line with which the program answers.

        One that is not kept is told that no more comes, and must then exit with status 0.

        Args:
            question: one line.
            deadline: on the monotonic clock; None: no limit.
        """
        last = not self._keep
        self._listen(0.0)
        if self._said:
            raise self._said_more("before it was asked")
        line = self._exchange(question, deadline, last=last)
        if last:
            self._said += self._rest(deadline)
        if self._said.strip():
            raise self._said_more("besides its answer", b"" if line.startswith(b"{") else line)
        if last:
            code = self._exit_status(deadline)
            if code != 0:
                raise ModelFailure("crashed", f"the program {_how(code)}{self._last_words()}")
        try:
            return json.loads(line, object_pairs_hook=_said_once, parse_int=_whole)
        except (ValueError, RecursionError):
            raise ModelFailure(
                "bad_answer", f"the program printed {_shown(line)}, which is not one line of JSON"
            ) from None

    def end(self) -> None:
        """Kill whatever is left of the program and of what it started."""
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        _RUNNING.discard(self._process.pid)
        # What left the program's group has become this process's own.
        end(orphans(_RUNNING))
        self._ears.close()
        for pipe in (self._process.stdin, self._process.stdout, self._process.stderr):
            if pipe is not None:
                with suppress(BrokenPipeError):
                    pipe.close()

    def _exchange(self, question: bytes, deadline: float | None, *, last: bool) -> bytes:
        """Write the question and read one line; meanwhile read what it says on stderr."""
        stdin = self._process.stdin
        assert stdin
        question = self._write(question)
        if question:
            self._ears.register(stdin, selectors.EVENT_WRITE)
        elif last:
            stdin.close()
        while b"\n" not in self._said:
            now = time.monotonic()
            if deadline is not None and now >= deadline:
                raise self._timed_out()
            if now >= self._look_at:
                self._check_memory(now)
            wake_at = self._look_at if deadline is None else min(deadline, self._look_at)
            if self._listen(wake_at - now) and question:
                question = self._write(question)
                if not question:
                    self._ears.unregister(stdin)
                    if last:
                        stdin.close()
        if question and not last:
            raise ModelFailure("bad_answer", "the program answered before it had read its line")
        line, _, self._said = self._said.partition(b"\n")
        return line

    def _listen(self, seconds: float) -> bool:
        """Read what the program says within `seconds`; returns whether it hears us, too."""
        writable = False
        for key, _ in self._ears.select(max(0.0, seconds)):
            if key.fileobj is self._process.stdout:
                self._read(self._process.stdout)
            elif key.fileobj is self._process.stdin:
                writable = True
            elif not self._hear():
                self._ears.unregister(key.fileobj)
        return writable

    def _check_memory(self, now: float) -> None:
        most = _memory_bytes()
        pid = self._process.pid
        taken = memory_of([pid, *descendants(pid), *orphans(_RUNNING)])
        # To look through many gigabytes takes a while itself.
        self._look_at = now + max(LOOK_SECONDS, 20.0 * (time.monotonic() - now))
        if taken > most:
            raise ModelFailure(
                "crashed",
                f"the program and what it started take {taken / 2**20:.0f} MB of memory; at most "
                f"{most / 2**20:.0f} MB",
            )

    def _rest(self, deadline: float | None) -> bytes:
        """Read what a program prints after its only answer, until it closes its output."""
        assert self._process.stdout
        until = time.monotonic() + GRACE_SECONDS
        if deadline is not None:
            until = min(until, deadline)
        rest = b""
        with selectors.DefaultSelector() as selector:
            selector.register(self._process.stdout, selectors.EVENT_READ)
            while selector.select(max(0.0, until - time.monotonic())):
                chunk = os.read(self._process.stdout.fileno(), CHUNK)
                rest += chunk
                if not chunk or len(rest) > MAX_ANSWER_BYTES:
                    break
        return rest

    def _write(self, question: bytes) -> bytes:
        assert self._process.stdin
        try:
            return question[os.write(self._process.stdin.fileno(), question) :]
        except BlockingIOError:
            return question
        except OSError:
            # It has ended, or does not listen; what it says, or its status, tells.
            return b""

    def _read(self, stdout: IO[bytes]) -> None:
        chunk = os.read(stdout.fileno(), CHUNK)
        if not chunk:
            if self._said:
                self._said += b"\n"
                return
            raise self._ended_early()
        self._said += chunk
        if len(self._said) > MAX_ANSWER_BYTES:
            raise ModelFailure(
                "bad_answer", f"the program printed more than {MAX_ANSWER_BYTES / 1e6:g} MB"
            )

    def _hear(self) -> bool:
        assert self._process.stderr
        chunk = os.read(self._process.stderr.fileno(), CHUNK)
        self._complaint = (self._complaint + chunk)[-STDERR_BYTES:]
        return bool(chunk)

    def _exit_status(self, deadline: float | None) -> int | None:
        left = GRACE_SECONDS if deadline is None else max(0.0, deadline - time.monotonic())
        try:
            return self._process.wait(min(GRACE_SECONDS, left))
        except subprocess.TimeoutExpired:
            return None

    def _ended_early(self) -> ModelFailure:
        code = self._exit_status(time.monotonic() + GRACE_SECONDS)
        how = "closed its output" if code is None else _how(code)
        right = "" if code else _KEPT if self._keep else _ONCE
        return ModelFailure(
            "crashed", f"the program {how} before it answered{right}{self._last_words()}"
        )

    def _said_more(self, when: str, line: bytes = b"") -> ModelFailure:
        said = _shown(b"\n".join((line, self._said)).strip().partition(b"\n")[0])
        return ModelFailure(
            "bad_answer",
            f"the program printed {said} {when}: it must print one line for each line that it "
            "reads, and all else on stderr",
        )

    def _timed_out(self) -> ModelFailure:
        return ModelFailure(
            "timed_out",
            f"the program gave no answer in time (model.time_limit){self._last_words()}",
        )

    def _last_words(self) -> str:
        assert self._process.stderr
        os.set_blocking(self._process.stderr.fileno(), False)
        try:
            while self._hear():
                pass
        except BlockingIOError:
            pass
        lines = self._complaint.decode(errors="replace").strip().splitlines()
        return f"; it said last: {lines[-1][:300]}" if lines else ""


def _limit(parent: int) -> None:
    """End with the worker's process, and take no more memory than is left for a program."""
    die_with_parent(parent, signal.SIGKILL)
    hard = resource.getrlimit(resource.RLIMIT_DATA)[1]
    resource.setrlimit(resource.RLIMIT_DATA, (_memory_bytes(), hard))


def _memory_bytes() -> int:
    """Return what a program may take: what the worker's owner says (`--memory-mb`), or 4 GB."""
    most = resource.getrlimit(resource.RLIMIT_DATA)[0]
    return MEMORY_BYTES if most == resource.RLIM_INFINITY else most


def _outputs(answer: Any) -> Mapping[str, Any]:
    said = answer if isinstance(answer, dict) else {}
    outputs, outcome = said.get("outputs"), said.get("outcome", "ok")
    if outcome == "ok" and isinstance(outputs, dict):
        return outputs
    if outcome != "ok" and outputs is None:
        try:
            failure = ModelFailure(str(outcome), str(said.get("reason", ""))[:1000])
        except ValueError as error:
            raise ModelFailure("bad_answer", str(error)) from None
        raise failure
    if outcome != "ok":
        what = f"outputs beside the outcome {str(outcome)[:40]!r}"
    elif "outcome" in said:
        what = "the outcome 'ok' without outputs"
    else:
        what = f"an object of {', '.join(said)[:80]!r}" if said else "anything else"
    raise ModelFailure(
        "bad_answer",
        'the program must print {"outputs": {...}} or, if it failed, {"outcome": ..., '
        f'"reason": ...}}, not {what}',
    )


def _said_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return an object of an answer; ModelFailure if it has a key twice, which REST refuses."""
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ModelFailure("bad_answer", f"the program answered with {twice[:60]!r} twice")
    return found


def _whole(digits: str) -> float:
    """Return a whole number; Python reads none of thousands of digits, which are more than any."""
    return int(digits) if len(digits) < MOST_DIGITS else float(digits)


def _shown(line: bytes) -> str:
    return repr(line[:80].decode(errors="replace"))


def _how(code: int | None) -> str:
    if code is None:
        return "answered and did not exit"
    if code < 0:
        return f"was ended by {signal.Signals(-code).name}"
    return f"exited with status {code}"
