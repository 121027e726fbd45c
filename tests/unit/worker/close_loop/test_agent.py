"""An agent beside close-loop jobs: the machine is shared, and neither leaves without the other."""

import threading
from pathlib import Path

from tests.testbed.fleet.fake_coordinator import Work


class Jobs:
    """Close-loop jobs that keep a process busy as long as it is told to be."""

    def __init__(self, busy: int = 0) -> None:
        self.busy = busy
        self.said: list[str] = []

    def start(self) -> None:
        self.said.append("start")

    def drain(self) -> None:
        self.said.append("drain")

    def close(self) -> None:
        self.said.append("close while busy" if self.busy else "close")


def beside(jobs: Jobs, folder: Path, batches: list[list[str]], processes: int = 1) -> Work:
    work = Work(folder, batches, processes, max_idle=0.05)
    work.agent.close_loop_jobs = jobs  # type: ignore[assignment]
    return work


def test_while_a_loop_is_closed_one_process_less_evaluates(tmp_path: Path) -> None:
    jobs = Jobs(busy=1)
    work = beside(jobs, tmp_path, [["a"], ["b"]])
    sizes: list[int] = []

    def done() -> None:
        sizes.extend(work.coordinator.sizes)
        jobs.busy = 0

    threading.Timer(0.3, done).start()
    work.agent.run()
    # It neither left for want of work nor took any meanwhile.
    assert sizes == []
    assert set(work.coordinator.results) == {"a", "b"}


def test_the_other_processes_go_on(tmp_path: Path) -> None:
    jobs = Jobs(busy=1)
    work = beside(jobs, tmp_path, [["a"], ["b"]], processes=2)

    def both() -> bool:
        done = len(work.coordinator.results) == 2
        if done:
            jobs.busy = 0
        return done

    work.run_until(work.agent, both)
    assert set(work.coordinator.results) == {"a", "b"}


def test_a_draining_worker_waits_for_its_close_loop_job_and_ends_it(tmp_path: Path) -> None:
    jobs = Jobs(busy=1)
    work = beside(jobs, tmp_path, [])
    threading.Timer(0.2, lambda: setattr(jobs, "busy", 0)).start()
    work.agent.stop()
    work.agent.run()
    assert jobs.said == ["start", "drain", "close"]


def test_a_worker_told_twice_to_stop_leaves_at_once(tmp_path: Path) -> None:
    jobs = Jobs(busy=1)
    work = beside(jobs, tmp_path, [])
    work.agent.stop()
    work.agent.stop()
    work.agent.run()
    assert jobs.said[-1] == "close while busy"
