"""Studies on a terminal: their progress in words, their indices in tables."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Column, Table

from intake.words import counted

#: Indices that tables leave out: others say more, or bound the same from closer by.
LEFT_OUT = ("mu", "full_total_order", "independent_first_order")
#: What ranks the factors, most influential first.
RANKED_BY = ("mu_star", "total_order", "shapley")
#: Columns that no table needs.
ANY_WIDTH = 10_000


def plain_console(**options: Any) -> Console:
    """Return a console to which brackets and colons of a name are no markup, as `Console` does."""
    return Console(markup=False, emoji=False, **options)


def whole_console(*, stderr: bool = False) -> Console:
    """Return a console that cuts no number: a narrow terminal breaks lines, a pipe keeps them."""
    return plain_console(stderr=stderr, soft_wrap=True, width=ANY_WIDTH)


def plain_table(*columns: str, title: str | None = None, caption: str | None = None) -> Table:
    """Return an empty table as all of them look; a narrow terminal breaks words, and loses none."""
    return Table(
        # What a line is about stays in one piece.
        *(Column(name, overflow="fold", no_wrap=not at) for at, name in enumerate(columns)),
        title=title,
        title_justify="left",
        caption=caption,
        caption_justify="left",
        box=SIMPLE_HEAD,
        pad_edge=False,
    )


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


def left_in_words(progress: Mapping[str, Any]) -> str:
    """Return in a sentence that results wait for an analysis; empty if none do."""
    from analysis.reports.wording import left_by_analysis

    # An older coordinator does not say.
    return left_by_analysis(progress.get("left_by_analysis", 0))


def progress_in_words(progress: Mapping[str, Any]) -> str:
    """Return a study's progress as one line."""
    done = progress["ok"] + progress["failed"]
    rate = progress["results_per_second"] or 0.0
    eta = duration(progress["eta_seconds"])
    if progress.get("eta_high_seconds"):
        low, high = progress["eta_low_seconds"], progress["eta_high_seconds"]
        eta += f" [{duration(low)}, {duration(high)}]"
    missing = progress.get("waits_for")
    waits = f"waits for a worker with {missing}, " if missing else ""
    said = (progress.get("why_it_waits"), left_in_words(progress))
    # Who has nothing more to do is heard of no more.
    workers = counted(progress["workers"], "worker", "workers")
    at_work = f"{workers}, " if done < progress["instances"] else ""
    why = "".join(f"; {sentence}" for sentence in said if sentence)
    return (
        f"{waits}{done}/{progress['instances']} results, "
        f"{progress['rows_complete']}/{progress['rows']} rows, {rate:.1f}/s, "
        f"ETA {eta}, {at_work}"
        f"failures: {failures_in_words(progress['failures'])}{why}"
    )


def statistic(entry: Mapping[str, float | None] | None) -> str:
    """Return an index with its confidence interval, or a dash if there is none yet."""
    if entry is None or entry["value"] is None:
        return "-"
    if entry["low"] is None or entry["high"] is None:
        return f"{entry['value']:.3g}"
    value = entry["value"]
    # Of a narrow interval two digits may leave the value outside; as many as it has never do.
    low, high = (_bound(entry[end]) for end in ("low", "high"))
    if not float(low) <= float(f"{value:.3g}") <= float(high):
        low, high = (f"{entry[end]:.3g}" for end in ("low", "high"))
    return f"{value:.3g} [{low}, {high}]"


def _bound(value: float | None) -> str:
    """Return a limit of an interval in two digits, all that eight blocks of rows give."""
    assert value is not None
    return f"{value:.2g}" if abs(value) < 10.0 else f"{value:.0f}"


def indices_table(snapshot: Mapping[str, Any], output: str, title: str = "") -> Table:
    """Return the indices of one output, factors ranked by μ* or ST; of a curve, of the whole."""
    from analysis.sensitivity.estimators import SYMBOLS
    from analysis.sensitivity.records import said_of

    factors: Mapping[str, Mapping[str, Any]] = said_of(snapshot, output).get("factors", {})
    known = {name for entry in factors.values() for name in entry}
    names = [name for name in SYMBOLS if name in known and name not in LEFT_OUT]
    caption = "μ*, σ: per whole range" if "mu_star" in names else None
    table = plain_table(title=title or None, caption=caption)
    table.add_column("factor", no_wrap=True)
    for name in names:
        table.add_column(SYMBOLS[name], justify="right", no_wrap=True)
    table.add_column("n", justify="right")
    for factor, entry in sorted(factors.items(), key=lambda item: _rank(item[1])):
        table.add_row(
            factor, *(statistic(entry.get(name)) for name in names), str(entry.get("n", 0))
        )
    return table


def spread_table(snapshot: Mapping[str, Any]) -> Table:
    """Return mean and standard deviation of every output: what a sample has."""
    table = plain_table("output")
    for name in ("mean", "standard deviation", "n"):
        table.add_column(name, justify="right", no_wrap=True)
    for output, entry in snapshot["outputs"].items():
        both = ("-" if entry[name] is None else f"{entry[name]:.4g}" for name in ("mean", "sd"))
        table.add_row(output, *both, str(entry["n"]))
    return table


def pairs_table(pairs: Sequence[Mapping[str, Any]]) -> Table:
    """Return the second-order indices of an output as its snapshot has them, largest first."""
    table = plain_table("pair")
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


def leading_factors(snapshot: Mapping[str, Any], output: str) -> str:
    """Return the two factors that lead the ranking, with their intervals."""
    from analysis.sensitivity.estimators import SYMBOLS
    from analysis.sensitivity.records import said_of

    factors = said_of(snapshot, output).get("factors", {})
    ranked = sorted(factors.items(), key=lambda item: _rank(item[1]))[:2]
    return ", ".join(
        f"{factor} {SYMBOLS[name]} {statistic(entry[name])}"
        for factor, entry in ranked
        for name in RANKED_BY
        if (entry.get(name) or {}).get("value") is not None
    )
