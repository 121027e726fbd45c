"""Show a campaign while it runs and when it is over: in place on a terminal, lines for a log."""

import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Self, TextIO

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from intake.words import counted
from rehyb.campaign.files import Report
from rehyb.campaign.run import View
from rehyb.client.states import StudyState
from rehyb.display import (
    duration,
    failures_in_words,
    indices_table,
    leading_factors,
    progress_in_words,
)

#: Seconds between two lines of a log.
LINE_SECONDS = 2.0


def report_parts(report: Report) -> Iterable[RenderableType]:
    """Return what a finished campaign reports, part by part."""
    plan = report.plan
    level = f"{report.phase1['level']:.0%} confidence intervals"
    yield ""
    yield indices_table(
        report.phase1, plan.output, f"Phase 1: elementary effects on {plan.output}, {level}"
    )
    yield from _remarks(report.phase1, plan.output)
    yield f"{report.evidence}\nPhase 2 holds {report.fixed} at its nominal {report.fixed_at:g}."
    yield ""
    yield indices_table(
        report.phase2, plan.output, f"Phase 2: Sobol indices of {plan.output}, {level}"
    )
    yield from _remarks(report.phase2, plan.output, plan.target)
    failed = sum(report.failures.values())
    yield (
        f"{counted(report.instances, 'instance', 'instances')}, {failed} failed "
        f"({failures_in_words(report.failures)}), in {duration(report.seconds)}"
    )
    yield "\n".join(str(path) for path in report.files)


def _remarks(
    snapshot: Mapping[str, Any], output: str, target: float | None = None
) -> Iterable[RenderableType]:
    from analysis.sensitivity.remarks import remarks

    return (Text(sentence) for sentence in remarks(snapshot, output, target))


class LiveDisplay:
    """A campaign on a terminal, redrawn in place."""

    def __init__(self, console: Console) -> None:
        # Drawn by `show` only: a second thread would make it unsafe to fork a worker.
        self._live = Live(console=console, auto_refresh=False)

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Leave the terminal to others within the block."""
        self._live.stop()
        try:
            yield
        finally:
            self._live.start()

    def show(self, view: View) -> None:
        """Redraw."""
        from analysis.sensitivity.remarks import warning

        done = view.progress["ok"] + view.progress["failed"]
        bar = Table.grid()
        bar.add_row(ProgressBar(total=max(view.progress["instances"], 1), completed=done, width=60))
        parts: list[RenderableType] = [
            Text(f"Phase {view.phase} of 2: {view.title}", style="bold"),
            bar,
            progress_in_words(view.progress),
        ]
        if view.waiting:
            parts.append(Text(view.waiting, style="yellow"))
        if alarm := warning(view.snapshot):
            parts.append(Text(alarm, style="bold red"))
        parts.append(indices_table(view.snapshot, view.output))
        parts += _remarks(view.snapshot, view.output)
        self._live.update(Group(*parts), refresh=True)


class LineDisplay:
    """A campaign in a log: a line when something changed, not more often than every 2 s."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._last = ""
        self._shown_at = float("-inf")

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Leave the terminal to others within the block: nothing is printed unasked anyway."""
        yield

    def show(self, view: View) -> None:
        """Print a line if there is news."""
        complete = view.progress["state"] == StudyState.COMPLETE and not view.waiting
        if not complete and time.monotonic() - self._shown_at < LINE_SECONDS:
            return
        line = f"phase {view.phase}/2: {progress_in_words(view.progress)}"
        if leaders := leading_factors(view.snapshot, view.output):
            line += f"; {leaders}"
        if view.waiting:
            line += f"; {view.waiting}"
        if line != self._last:
            print(line, file=self._stream, flush=True)
            self._last, self._shown_at = line, time.monotonic()
