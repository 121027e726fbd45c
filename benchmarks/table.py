"""The table that a user reads, and what was to be reached."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from benchmarks.measuring import Target, Throughput, percentile
from benchmarks.million import Million
from benchmarks.rivals import Rival

#: The batch that the coordinator is compared at.
BATCH = 10
HEADER = f"  {'':34s} {'batch':>5s} {'per second':>10s} {'CPU ms each':>12s}"


@dataclass(frozen=True, kw_only=True)
class Line:
    """One line of the table."""

    name: str
    batch: int
    throughput: Throughput
    remark: str = ""

    def __str__(self) -> str:
        found = self.throughput
        return (
            f"  {self.name:34s} {self.batch:5d} {found.per_second:10.0f} {found.cpu_ms:12.3f}"
            f"  {self.remark}"
        ).rstrip()


def ours(name: str, found: Mapping[int, Throughput]) -> Iterator[Line]:
    """Yield the coordinator's lines."""
    for batch, throughput in found.items():
        yield Line(
            name=name,
            batch=batch,
            throughput=throughput,
            remark=f"(coordinator alone: {throughput.server_ms:.3f} ms)",
        )


def theirs(found: Sequence[Rival]) -> Iterator[Line]:
    """Yield the rivals' lines."""
    for rival in found:
        yield Line(
            name=rival.name,
            batch=rival.batch,
            throughput=rival.throughput,
            remark=f"({rival.lacks})" if rival.lacks else "",
        )


def targets(
    on_sqlite: Mapping[int, Throughput],
    rivals: Sequence[Rival],
    waits: Mapping[str, Sequence[float]],
    study: Million,
) -> list[Target]:
    """Return what was to be reached.

    Args:
        on_sqlite: the coordinator's throughput by batch.
        rivals: those that lack nothing compete.
        waits: seconds that leases took, by what was going on.
        study: what was found about a study of a million instances.
    """
    durable = [rival for rival in rivals if not rival.lacks]
    rate = on_sqlite[BATCH].per_second
    beside = [
        Target(
            what=f"rate at batch {BATCH} beside the best durable rival's, {which}",
            figure=rate / max(rival.throughput.per_second for rival in others),
            bound=3.0,
            unit="times",
            at_least=True,
        )
        for which, others in (
            ("any batch", durable),
            (f"up to {BATCH}", [rival for rival in durable if rival.batch <= BATCH]),
        )
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
        *beside,
        Target(
            what=f"lease and complete on SQLite, batch {BATCH}",
            figure=rate,
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
