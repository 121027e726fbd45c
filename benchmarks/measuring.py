"""What a measurement is made of: rates, processor time, percentiles, and targets met or not."""

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import nan

import psutil

#: A rate is taken between these parts of the work, where starting and ending do not show.
FROM, TO = 0.1, 0.9
#: Seconds after which a rate is good enough, however much is left.
LONGEST_SECONDS = 10.0
#: Seconds between two looks at how much is done.
LOOK_SECONDS = 0.05


@dataclass(frozen=True, kw_only=True)
class Throughput:
    """How fast instances were handed out and their results came to be stored."""

    per_second: float
    #: Milliseconds of processor time per instance of all processes concerned, workers included:
    #: what decides how far a machine gets, and depends less than the rate on who else uses it.
    cpu_ms: float
    #: The coordinator's part of it; NaN for others.
    server_ms: float = nan


@dataclass(frozen=True, kw_only=True)
class Target:
    """What a figure is meant to be."""

    what: str
    figure: float
    bound: float
    unit: str
    #: Whether the figure is to be at least the bound, rather than at most.
    at_least: bool

    @property
    def met(self) -> bool:
        """Whether the figure is on the right side of its bound; a missing one (NaN) is not."""
        return self.figure >= self.bound if self.at_least else self.figure <= self.bound

    def line(self) -> str:
        """Return one line for a reader."""
        sign = ">=" if self.at_least else "<="
        verdict = "met" if self.met else "NOT MET"
        return (
            f"  {self.what:58s} {self.figure:9.1f} {self.unit:8s}"
            f" target {sign} {self.bound:g} {self.unit}: {verdict}"
        )


def say(text: str) -> None:
    """Tell whoever waits how far it is; figures go to the standard output."""
    print(text, file=sys.stderr, flush=True)


def middle(found: Sequence[Throughput]) -> Throughput:
    """Return the one of several measurements whose rate is in the middle."""
    return sorted(found, key=lambda one: one.per_second)[len(found) // 2]


def percentile(values: Sequence[float], percent: float) -> float:
    """Return the smallest value that at least `percent` of all values do not exceed."""
    if not values:
        raise ValueError("there is no percentile of nothing")
    ordered = sorted(values)
    rank = -(-len(ordered) * percent // 100)
    return ordered[max(0, int(rank) - 1)]


def cpu_seconds(pids: Sequence[int]) -> float:
    """Return the processor time of processes and of their children, ended ones included."""
    total = 0.0
    for pid in pids:
        process = psutil.Process(pid)
        # Of children that have ended a parent knows the time; of the others it is asked.
        total += sum(process.cpu_times()[:4])
        for child in process.children(recursive=True):
            try:
                total += sum(child.cpu_times()[:4])
            except psutil.NoSuchProcess:
                continue
    return total


def rss_mb(pid: int) -> float:
    """Return the memory that a process occupies, 10^6 bytes."""
    return float(psutil.Process(pid).memory_info().rss) / 1e6


def watch(
    done: Callable[[], int], total: int, *, pids: Sequence[int], patience: float = 120.0
) -> Throughput:
    """Return the throughput of processes that are working off `total` instances.

    Args:
        done: returns how many are finished.
        total: how many there are.
        pids: the processes whose time counts, with their children.
        patience: seconds after which there must have been an end.

    Raises:
        TimeoutError: there was none.
    """
    deadline = time.monotonic() + patience
    first = None
    while True:
        count, now = done(), time.perf_counter()
        if first is None and count >= FROM * total:
            first = (count, now, cpu_seconds(pids))
        if first is not None and (count >= TO * total or now > first[1] + LONGEST_SECONDS):
            if count == first[0]:
                raise ValueError(f"{total} instances are too few to take a rate from")
            cpu = cpu_seconds(pids) - first[2]
            finished = count - first[0]
            return Throughput(
                per_second=finished / (now - first[1]), cpu_ms=cpu / finished * 1000.0
            )
        if time.monotonic() > deadline:
            raise TimeoutError(f"{count} of {total} instances were finished in {patience} s")
        time.sleep(LOOK_SECONDS)
