"""Commands on samples that are there already: `analyse` and `study analyse`."""

from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from rehyb.cli.answers import Answer, answering
from rehyb.cli.options import StudyId, optional
from rehyb.client import Client, Json
from rehyb.errors import needs_extra, refusing
from rehyb.files import study_with_results

Outputs = Annotated[
    list[str] | None,
    optional("--output", metavar="COLUMN", help="An output; repeat. Known of a study's table."),
]


@answering
def analyse(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="CSV or Parquet, a run a line.")],
    output: Outputs = None,
    factor: Annotated[
        list[str] | None,
        optional(metavar="COLUMN", help="A factor; repeat. Default: every other of numbers."),
    ] = None,
) -> Answer:
    """Tell which factors matter from runs that somebody else sampled."""
    return _answer(file, output, factor)


@answering
def analyse_study(client: Client, study: StudyId, output: Outputs = None) -> Answer:
    """Tell what a study's results say of its factors besides its own indices."""
    with study_with_results(client, study) as (_, results):
        return _answer(results, output, None)


def _answer(file: Path, outputs: list[str] | None, factors: list[str] | None) -> Answer:
    with needs_extra("an analysis of a table", "given"):
        from analysis.given.answer import analyse as told
        from analysis.given.table.refusals import GivenError

        with refusing(GivenError):
            found = told(file, outputs or (), factors)
    return Answer(found, partial(_print, found))


def _print(found: Json) -> None:
    from analysis.sensitivity.estimators import SYMBOLS
    from rehyb.display import plain_table, whole_console

    console = whole_console()
    for output, told in found["outputs"].items():
        designed = {SYMBOLS.get(name, name): told["design"][name] for name in told["design"]}
        measured = {
            found["measures"][name]["symbol"]: told["measures"][name] for name in told["measures"]
        }
        table = plain_table(output, *designed, *measured, *(["independent?"] if measured else []))
        for factor in found["factors"]:
            columns = (*designed.values(), *measured.values())
            entries = [column.get(factor, {}) for column in columns]
            table.add_row(factor, *map(_cell, entries), *_verdict(told["measures"], factor))
        console.print(table)
    for name, measure in found["measures"].items():
        console.print(
            f"{measure['symbol']} ({name}, {measure['rows']} rows) assumes: {measure['assumes']}."
        )
    for remark in found["remarks"]:
        console.print(remark)


def _cell(entry: Any) -> str:
    """Return a value with its interval, and beside it what chance alone gives."""
    from rehyb.display import statistic

    if not entry:
        return ""
    chance = f", chance {entry['chance']:.3f}" if entry.get("chance") is not None else ""
    return f"{statistic(entry)}{chance}"


def _verdict(measures: Json, factor: str) -> list[str]:
    entry = measures.get("hsic", {}).get(factor)
    if not entry or entry["p_value"] is None:
        return [""] if measures else []
    return [f"p = {entry['p_value']:.2g}"]
