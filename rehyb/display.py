"""Show a campaign while it runs and when it is over: tables for a terminal, lines for a log."""

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import TracebackType
from typing import Any, Self, TextIO

from rich.box import SIMPLE_HEAD
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from rehyb.campaign.run import Report, View

#: Seconds between two lines of a log.
LINE_SECONDS = 2.0

#: Statistics of a factor in the order tables show them, with their symbols in the paper.
SYMBOLS: Mapping[str, str] = {
    "mu_star": "μ*",
    "sigma": "σ",
    "first_order": "S",
    "total_order": "ST",
}
#: What ranks the factors, most influential first.
RANKED_BY = ("mu_star", "total_order")


def duration(seconds: float | None) -> str:
    """Return seconds as h:mm:ss or m:ss; a question mark if unknown."""
    if seconds is None:
        return "?"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


def failures_in_words(failures: Mapping[str, int]) -> str:
    """Return failures by cause, most frequent first."""
    if not any(failures.values()):
        return "none"
    ordered = sorted(failures.items(), key=lambda item: (-item[1], item[0]))
    return ", ".join(f"{cause} {count}" for cause, count in ordered if count)


def progress_in_words(progress: Mapping[str, Any]) -> str:
    """Return a study's progress as one line."""
    done = progress["ok"] + progress["failed"]
    rate = progress["results_per_second"] or 0.0
    eta = duration(progress["eta_seconds"])
    if progress.get("eta_high_seconds"):
        low, high = progress["eta_low_seconds"], progress["eta_high_seconds"]
        eta += f" [{duration(low)}, {duration(high)}]"
    return (
        f"{done}/{progress['instances']} results, "
        f"{progress['rows_complete']}/{progress['rows']} rows, {rate:.1f}/s, "
        f"ETA {eta}, {progress['workers']} workers, "
        f"failures: {failures_in_words(progress['failures'])}"
    )


def statistic(entry: Mapping[str, float | None] | None) -> str:
    """Return an index with its confidence interval, or a dash if there is none yet."""
    if entry is None or entry["value"] is None:
        return "-"
    if entry["low"] is None or entry["high"] is None:
        return f"{entry['value']:.3g}"
    return f"{entry['value']:.3g} [{_bound(entry['low'])}, {_bound(entry['high'])}]"


def _bound(value: float) -> str:
    """Return a limit of an interval in two digits, all that eight blocks of rows give."""
    return f"{value:.2g}" if abs(value) < 10.0 else f"{value:.0f}"


def indices_table(snapshot: Mapping[str, Any], output: str, title: str = "") -> Table:
    """Return the indices of one output, factors ranked by μ* or ST."""
    factors: Mapping[str, Mapping[str, Any]] = (
        snapshot["outputs"].get(output, {}).get("factors", {})
    )
    names = [name for name in SYMBOLS if any(name in entry for entry in factors.values())]
    table = Table(
        title=title or None,
        title_justify="left",
        caption="μ*, σ: per whole range" if "mu_star" in names else None,
        caption_justify="left",
        box=SIMPLE_HEAD,
        pad_edge=False,
    )
    table.add_column("factor", no_wrap=True)
    for name in names:
        table.add_column(SYMBOLS[name], justify="right", no_wrap=True)
    table.add_column("n", justify="right")
    for factor, entry in sorted(factors.items(), key=lambda item: _rank(item[1])):
        table.add_row(
            factor, *(statistic(entry.get(name)) for name in names), str(entry.get("n", 0))
        )
    return table


def pairs_table(pairs: Sequence[Mapping[str, Any]]) -> Table:
    """Return the second-order indices of an output as its snapshot has them, largest first."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("pair")
    table.add_column("S of the pair", justify="right", no_wrap=True)
    table.add_column("n", justify="right")
    for pair in sorted(pairs, key=lambda pair: -(pair["value"] or 0.0)):
        table.add_row(" × ".join(pair["factors"]), statistic(pair), str(pair["n"]))
    return table


def _rank(entry: Mapping[str, Any]) -> float:
    for name in RANKED_BY:
        value = (entry.get(name) or {}).get("value")
        if value is not None:
            return -float(value)
    return 0.0


def report_parts(report: Report) -> Iterable[RenderableType]:
    """Return what a finished campaign has to say, part by part."""
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
        f"{report.instances} instances, {failed} failed "
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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
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
        complete = view.progress["state"] == "complete" and not view.waiting
        if not complete and time.monotonic() - self._shown_at < LINE_SECONDS:
            return
        line = f"phase {view.phase}/2: {progress_in_words(view.progress)}"
        if leaders := _leaders(view):
            line += f"; {leaders}"
        if view.waiting:
            line += f"; {view.waiting}"
        if line != self._last:
            print(line, file=self._stream, flush=True)
            self._last, self._shown_at = line, time.monotonic()


def _leaders(view: View) -> str:
    """Return the two factors that lead the ranking, with their intervals."""
    factors = view.snapshot["outputs"].get(view.output, {}).get("factors", {})
    ranked = sorted(factors.items(), key=lambda item: _rank(item[1]))[:2]
    return ", ".join(
        f"{factor} {SYMBOLS[name]} {statistic(entry[name])}"
        for factor, entry in ranked
        for name in RANKED_BY
        if (entry.get(name) or {}).get("value") is not None
    )
