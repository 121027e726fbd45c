"""The table that a user reads, and what was to be reached."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from statistics import median

from benchmarks.measuring import Target, Throughput, middle, percentile
from benchmarks.service.million import Million
from benchmarks.service.rivals import Rival

#: The batch that the coordinator is compared at.
BATCH = 10
_COLUMNS = f"{'batch':>5s} {'per second':>10s} {'least':>8s} {'most':>8s} {'CPU ms each':>12s}"
HEADER = f"  {'':34s} {_COLUMNS}"


@dataclass(frozen=True, kw_only=True)
class Round:
    """What was measured once: every system within the same minutes."""

    on_sqlite: Mapping[int, Throughput]
    on_postgresql: Mapping[int, Throughput]
    rivals: Sequence[Rival]


@dataclass(frozen=True, kw_only=True)
class Line:
    """One line of the table."""

    name: str
    batch: int
    #: As it was measured in each round.
    found: Sequence[Throughput]
    remark: str = ""

    def __str__(self) -> str:
        rates = [one.per_second for one in self.found]
        return (
            f"  {self.name:34s} {self.batch:5d} {middle(self.found).per_second:10.0f}"
            f" {min(rates):8.0f} {max(rates):8.0f} {middle(self.found).cpu_ms:12.3f}"
            f"  {self.remark}"
        ).rstrip()


def lines(rounds: Sequence[Round]) -> Iterator[Line]:
    """Yield a line for every system and batch, the coordinator first."""
    yield from _ours("rehyb, SQLite", [one.on_sqlite for one in rounds])
    yield from _ours("rehyb, PostgreSQL", [one.on_postgresql for one in rounds])
    for same in zip(*(one.rivals for one in rounds), strict=True):
        rival = same[0]
        yield Line(
            name=rival.name,
            batch=rival.batch,
            found=[one.throughput for one in same],
            remark=f"({rival.lacks})" if rival.lacks else "",
        )


def _ours(name: str, found: Sequence[Mapping[int, Throughput]]) -> Iterator[Line]:
    for batch in found[0]:
        same = [one[batch] for one in found]
        alone = middle(same).server_ms
        remark = f"(coordinator alone: {alone:.3f} ms)"
        yield Line(name=name, batch=batch, found=same, remark=remark)


def beside(rounds: Sequence[Round]) -> dict[str, list[float]]:
    """Return how many times the best durable rival's rate ours is, in each round.

    A machine's pace changes from minute to minute, so that only what was measured in the same
    minutes is compared. Rivals that lack nothing compete: all of them, and those with no larger
    batch than ours.
    """
    found: dict[str, list[float]] = {"any batch": [], f"up to {BATCH}": []}
    for one in rounds:
        durable = [rival for rival in one.rivals if not rival.lacks]
        for which, most in zip(found, (inf, BATCH), strict=True):
            best = max(r.throughput.per_second for r in durable if r.batch <= most)
            found[which].append(one.on_sqlite[BATCH].per_second / best)
    return found


def targets(
    rounds: Sequence[Round], waits: Mapping[str, Sequence[float]], study: Million
) -> list[Target]:
    """Return what was to be reached; of several rounds the middle counts.

    Args:
        rounds: every system's throughput.
        waits: seconds that leases took, by what was going on.
        study: what was found about a study of a million instances.
    """
    ratios = [
        Target(
            what=f"rate at batch {BATCH} beside the best durable rival's, {which}",
            figure=median(found),
            bound=3.0,
            unit="times",
            at_least=True,
        )
        for which, found in beside(rounds).items()
    ]
    polled = [
        Target(
            what=f"p99 of a lease, 50 workers polling {what}",
            figure=percentile(seconds, 99) * 1e3,
            bound=50.0,
            unit="ms",
            at_least=False,
        )
        for what, seconds in waits.items()
    ]
    return [
        *ratios,
        Target(
            what=f"lease and complete on SQLite, batch {BATCH}",
            figure=middle([one.on_sqlite[BATCH] for one in rounds]).per_second,
            bound=2000.0,
            unit="/s",
            at_least=True,
        ),
        *polled,
        Target(
            what="p99 of progress, a million instances",
            figure=percentile(study.progress_seconds, 99) * 1e3,
            bound=20.0,
            unit="ms",
            at_least=False,
        ),
        Target(
            what="submitting a million instances",
            figure=study.submit_seconds,
            bound=60.0,
            unit="s",
            at_least=False,
        ),
        Target(
            what="memory of the coordinator meanwhile",
            figure=study.peak_mb,
            bound=500.0,
            unit="MB",
            at_least=False,
        ),
    ]
