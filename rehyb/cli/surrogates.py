"""The command that answers by a fitted function: `study surrogate`."""

import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from rehyb.cli.options import AsJson, Token, Url, print_json
from rehyb.client import Client, Json
from rehyb.errors import Invalid, RehybError


def surrogate(
    study: Annotated[str, typer.Argument(help="The study's id.", metavar="STUDY")],
    output: Annotated[
        str | None, typer.Option(help="Default: the study's first.", show_default=False)
    ] = None,
    url: Url = None,
    token: Token = None,
    as_json: AsJson = False,
) -> None:
    """Answer by functions fitted to the runs so far, with their held-out errors.

    A Gaussian process and, with the extra `chaos`, a sparse polynomial chaos.
    """
    with Client(url, token) as client, tempfile.TemporaryDirectory() as folder:
        described = client.study(study)
        results = Path(folder) / "results.csv"
        client.results_csv(study, results)
        snapshot = client.indices(study)
        found = _answer(described, results, output or described["outputs"][0])
    if as_json:
        print_json(asdict(found))
    else:
        _print(found, snapshot)


def _answer(study: Json, results: Path, output: str) -> Any:
    from analysis.files.results_csv import read_table
    from analysis.sensitivity.records import plan_of
    from analysis.sensitivity.surrogate import answer

    try:
        return answer(read_table(plan_of(study), results), output)
    except ValueError as error:
        raise Invalid(str(error)) from None
    except ModuleNotFoundError as error:
        raise RehybError(
            f"a surrogate needs {error.name}: pip install 'rehyb[surrogate]'"
        ) from None


def _print(found: Any, snapshot: Json) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    from analysis.designs import family
    from rehyb.display import statistic

    fits = {f"{name}: S, ST": fit for name, fit in found.fits().items()}
    sampled = snapshot["outputs"][found.output]["factors"]
    names = {"first_order": "S sampled", "total_order": "ST sampled"}
    shown = names if family(snapshot["method"]) == "saltelli" else {}
    table = Table("factor", *fits, *shown.values(), box=SIMPLE_HEAD, pad_edge=False)
    total = found.fit.total_order
    for factor in sorted(total, key=lambda name: -total[name]):
        table.add_row(
            factor,
            *(f"{f.first_order[factor]:.3f}, {f.total_order[factor]:.3f}" for f in fits.values()),
            *(statistic(sampled[factor].get(name)) for name in shown),
        )
    table.add_section()
    table.add_row("held out", *(f"{max(fit.held_out, 0.0):.1%} explained" for fit in fits.values()))
    console = Console(soft_wrap=True)
    console.print(table)
    console.print(found.sentence, markup=False)
