"""An agent beside a desk: the machine's share is kept, and neither leaves without the other."""

import threading
from pathlib import Path

from tests.unit.worker.test_agent import Work


class Desk:
    """A desk that is busy as long as it is told to be."""

    def __init__(self, busy: int = 0) -> None:
        self.busy = busy
        self.said: list[str] = []

    def start(self) -> None:
        self.said.append("start")

    def drain(self) -> None:
        self.said.append("drain")

    def close(self) -> None:
        self.said.append("close while busy" if self.busy else "close")


def beside(desk: Desk, folder: Path, batches: list[list[str]], processes: int = 1) -> Work:
    work = Work(folder, batches, processes, max_idle=0.05)
    work.agent._desk = desk  # type: ignore[assignment]
    return work


def test_while_a_loop_is_closed_one_process_less_evaluates(tmp_path: Path) -> None:
    desk = Desk(busy=1)
    work = beside(desk, tmp_path, [["a"], ["b"]])
    sizes: list[int] = []

    def done() -> None:
        sizes.extend(work.coordinator.sizes)
        desk.busy = 0

    threading.Timer(0.3, done).start()
    work.agent.run()
    # It neither left for want of work nor took any meanwhile.
    assert sizes == []
    assert set(work.coordinator.results) == {"a", "b"}


def test_the_other_processes_go_on(tmp_path: Path) -> None:
    desk = Desk(busy=1)
    work = beside(desk, tmp_path, [["a"], ["b"]], processes=2)

    def both() -> bool:
        done = len(work.coordinator.results) == 2
        if done:
            desk.busy = 0
        return done

    work.run_until(work.agent, both)
    assert set(work.coordinator.results) == {"a", "b"}


def test_a_draining_worker_waits_for_its_desk_and_closes_it(tmp_path: Path) -> None:
    desk = Desk(busy=1)
    work = beside(desk, tmp_path, [])
    threading.Timer(0.2, lambda: setattr(desk, "busy", 0)).start()
    work.agent.stop()
    work.agent.run()
    assert desk.said == ["start", "drain", "close"]


def test_a_worker_told_twice_to_stop_leaves_at_once(tmp_path: Path) -> None:
    desk = Desk(busy=1)
    work = beside(desk, tmp_path, [])
    work.agent.stop()
    work.agent.stop()
    work.agent.run()
    assert desk.said[-1] == "close while busy"
