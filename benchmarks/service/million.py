"""A study of a million instances: submitting it, telling its progress, and memory meanwhile.

`python -m benchmarks.service.million`
"""

import sqlite3
import tempfile
import threading
import time
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from benchmarks.machine import describe_machine
from benchmarks.measuring import percentile, rss_mb
from benchmarks.service.coordinator import TOKEN, complete, coordinator, submit
from rehyb.client import Client

ROWS, WIDTH = 200_000, 5
#: Instances that are left to do, so that the study goes on.
LEFT = 1000
ASKED = 200
BATCH = 100
WORKER = {"id": "million", "host": "here", "versions": {}}

#: What a million leases and posts would have left in the tables, in one go.
FILL = """
WITH RECURSIVE numbers(n) AS (
    SELECT :first UNION ALL SELECT n + 1 FROM numbers WHERE n + 1 < :end
)
"""
FILL_INSTANCES = f"""
INSERT INTO instances (study_id, "row", position, state, attempts, host_class)
{FILL} SELECT :study, n / :width, n % :width, 'done', '{{}}', :host_class FROM numbers
"""
FILL_RESULTS = f"""
INSERT INTO results (study_id, seq, "row", position, outcome, outputs, reason, wall_seconds,
                     worker_id, received_at)
{FILL} SELECT :study, n + 1, n / :width, n % :width, 'ok', '{{"y":1.0}}', '', 0.1, :worker, :now
FROM numbers
"""
FILL_STUDY = """
UPDATE studies SET handed_out = :end, result_count = :end, ok_count = :end,
                   rows_complete = :end / :width WHERE id = :study
"""


@dataclass(frozen=True, kw_only=True)
class Million:
    """What was found."""

    submit_seconds: float
    #: Of each question for progress.
    progress_seconds: list[float]
    #: Largest memory of the coordinator that was seen, 10^6 bytes.
    peak_mb: float


def measure(directory: Path) -> Million:
    """Measure on SQLite, with all but a thousand instances finished."""
    file = directory / "million.sqlite3"
    url = f"sqlite:///{file}"
    peaks = []
    with coordinator(url) as running, _Memory(running.pid) as memory:
        started = time.perf_counter()
        study = submit(running.url, ROWS)
        submitted = time.perf_counter() - started
        assert study["instances"] == ROWS * WIDTH
        with Client(running.url, TOKEN) as client:
            complete(client, WORKER, WIDTH)
    peaks.append(memory.peak)
    fill(file, study["id"])
    with (
        coordinator(url) as running,
        _Memory(running.pid) as memory,
        Client(running.url, TOKEN) as client,
    ):
        waits = []
        for _ in range(ASKED):
            started = time.perf_counter()
            progress = client.progress(study["id"])
            waits.append(time.perf_counter() - started)
        assert progress["ok"] == ROWS * WIDTH - LEFT
        client.instances(study["id"], state="ok", limit=1000)
        while complete(client, WORKER, BATCH):
            pass
        assert client.progress(study["id"])["state"] == "complete"
    peaks.append(memory.peak)
    return Million(submit_seconds=submitted, progress_seconds=waits, peak_mb=max(peaks))


def fill(file: Path, study: str) -> None:
    """Finish all instances after the first row but the last thousand, directly in the database."""
    with closing(sqlite3.connect(file)) as connection:
        host_class = connection.execute("SELECT DISTINCT host_class FROM instances").fetchone()[0]
        values = {
            "first": WIDTH,
            "end": ROWS * WIDTH - LEFT,
            "width": WIDTH,
            "study": study,
            "worker": WORKER["id"],
            "host_class": host_class,
            "now": time.time(),
        }
        for statement in (FILL_INSTANCES, FILL_RESULTS, FILL_STUDY):
            connection.execute(statement, values)
        connection.commit()


class _Memory:
    """Looks at a process's memory ten times a second."""

    def __init__(self, pid: int) -> None:
        self.peak = 0.0
        self._pid = pid
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._look)

    def __enter__(self) -> "_Memory":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _look(self) -> None:
        while not self._stop.wait(0.1):
            self.peak = max(self.peak, rss_mb(self._pid))


def main() -> None:
    print(describe_machine())
    with tempfile.TemporaryDirectory() as directory:
        found = measure(Path(directory))
    waits = found.progress_seconds
    print(f"{ROWS * WIDTH} instances are submitted in {found.submit_seconds:.2f} s")
    print(
        f"progress: median {percentile(waits, 50) * 1e3:.1f} ms, "
        f"p99 {percentile(waits, 99) * 1e3:.1f} ms"
    )
    print(f"the coordinator's memory: {found.peak_mb:.0f} MB at most")


if __name__ == "__main__":
    main()
