"""Commands about studies: `study submit`, `list`, `show`, `progress`, `indices`, and so on."""

import json
import sys
import time
from math import inf
from pathlib import Path
from typing import Annotated

import typer

from rehyb.cli.options import AsJson, Token, Url, assignment, number, print_json, print_rows
from rehyb.cli.precision import to_precision
from rehyb.client import Client, Json
from rehyb.errors import Invalid

app = typer.Typer(help="Submit studies and see what becomes of them.", no_args_is_help=True)

Id = Annotated[str, typer.Argument(help="The study's id.", metavar="STUDY")]


@app.command()
def submit(
    file: Annotated[
        Path | None,
        typer.Argument(help="The study as JSON; - reads standard input.", show_default=False),
    ] = None,
    model: Annotated[str | None, typer.Option(help="elbow, ishigami or sobol_g.")] = None,
    method: Annotated[
        str | None, typer.Option(help="morris, saltelli or saltelli_second_order.")
    ] = None,
    rows: Annotated[int | None, typer.Option(min=1, help="Rows of the design.")] = None,
    name: Annotated[str | None, typer.Option(help="What to call it.")] = None,
    factor: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=LOW:HIGH", help="Sample this factor; repeat. Default: all."),
    ] = None,
    fix: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="Hold this factor; repeat."),
    ] = None,
    output: Annotated[
        list[str] | None, typer.Option(help="Rank this output; repeat. Default: all.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Default: 1.")] = None,
    sampling: Annotated[
        str | None,
        typer.Option(
            help="sobol_blocks, sobol, sobol_paired, latin_hypercube, or trajectories for morris. "
            "Default: sobol_blocks."
        ),
    ] = None,
    priority: Annotated[
        int | None, typer.Option(help="Higher is sooner. Default: 0.", show_default=False)
    ] = None,
    tag: Annotated[
        list[str] | None, typer.Option(help="Only for workers that have this tag; repeat.")
    ] = None,
    key: Annotated[
        str | None,
        typer.Option(help="Idempotency key: submitting again returns the same study."),
    ] = None,
    up_to: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Have the study extended until it is as precise as --target says or has this many "
            "rows, and wait for it as `study watch` does.",
            show_default=False,
        ),
    ] = None,
    target: Annotated[
        float | None,
        typer.Option(help="Half width wanted of every interval of the first output."),
    ] = None,
    url: Url = None,
    token: Token = None,
    as_json: AsJson = False,
) -> None:
    """Submit a study, from a JSON file or from options; options win over the file."""
    if target is not None and up_to is None:
        raise typer.BadParameter("--target needs --up-to, the rows that it may cost in all")
    study = _read(file) if file else {}
    given: Json = {
        "name": name,
        "model": model,
        "method": method,
        "rows": rows,
        "seed": seed,
        "sampling": sampling,
        "outputs": output or None,
        "priority": priority,
        "tags": tag or None,
        "factors": [_factor(text) for text in factor] if factor else None,
        "fixed": {n: number(v, n) for n, v in map(assignment, fix)} if fix else None,
        "precision": None if up_to is None else {"target": target, "up_to": up_to},
    }
    study |= {field: value for field, value in given.items() if value is not None}
    if missing := [field for field in ("model", "method", "rows") if field not in study]:
        raise typer.BadParameter(
            f"a study needs {', '.join(missing)}: give --{' --'.join(missing)}, or a FILE"
        )
    study.setdefault("name", f"{study['model']} {study['method']} {study['rows']}")
    with Client(url, token) as client:
        answer = client.submit(study, idempotency_key=key)
        if not as_json:
            print(f"{answer['id']}  {answer['name']}: {answer['instances']} instances", flush=True)
        if up_to is not None:
            answer |= to_precision(client, answer["id"], as_json=as_json)
    if as_json:
        print_json(answer)
    if not answer.get("reached", True):
        raise typer.Exit(1)


@app.command("list")
def list_studies(url: Url = None, token: Token = None, as_json: AsJson = False) -> None:
    """List the studies."""
    with Client(url, token) as client:
        studies = client.studies()
    if as_json:
        print_json({"studies": studies})
    else:
        print_rows(("id", "name", "model", "method", "rows", "state"), studies)


@app.command()
def show(study: Id, url: Url = None, token: Token = None, as_json: AsJson = False) -> None:
    """Show what a study samples."""
    with Client(url, token) as client:
        answer = client.study(study)
    if as_json:
        print_json(answer)
        return
    for field, value in answer.items():
        typer.echo(f"{field:12} {value if isinstance(value, str | int) else json.dumps(value)}")


@app.command()
def progress(
    study: Id,
    watch: Annotated[
        bool, typer.Option("--watch", help="Print a line per second until it is complete.")
    ] = False,
    url: Url = None,
    token: Token = None,
    as_json: AsJson = False,
) -> None:
    """Show how far a study is, its rate, and its failures by cause."""
    from rehyb.display import progress_in_words

    def show_one(answer: Json) -> None:
        if as_json:
            print(json.dumps(answer), flush=True)
        else:
            print(f"{answer['state']}: {progress_in_words(answer)}", flush=True)

    with Client(url, token) as client:
        if watch:
            client.wait(study, on_progress=show_one)
        else:
            show_one(client.progress(study))


@app.command()
def indices(
    study: Id,
    plot: Annotated[
        Path | None, typer.Option(help="Also draw them.", metavar="FILE.png", show_default=False)
    ] = None,
    target: Annotated[
        float | None,
        typer.Option(
            help="Half width wanted of every interval. Default: 0.02 of S and ST, a tenth of the "
            "largest μ*.",
            show_default=False,
        ),
    ] = None,
    url: Url = None,
    token: Token = None,
    as_json: AsJson = False,
) -> None:
    """Show a study's sensitivity indices, their intervals, and how many rows are still wanted."""
    from rich.console import Console

    from analysis.sensitivity.remarks import remarks, warning
    from rehyb.display import indices_table, pairs_table

    if target is not None and not 0.0 < target < inf:
        raise typer.BadParameter(f"--target is a positive half width, not {target:g}")

    with Client(url, token) as client:
        snapshot = client.indices(study)
    outputs = list(snapshot["outputs"])
    if plot is not None:
        from analysis.reports.figures import screening_figure, variance_figure

        if not outputs:
            raise Invalid(f"there is nothing to draw: study {study} has no indices yet")
        draw = screening_figure if snapshot["method"] == "morris" else variance_figure
        draw(snapshot, outputs[0]).savefig(plot)
    if as_json:
        print_json(snapshot)
        return
    console = Console()
    console.print(f"{snapshot['rows_complete']} of {snapshot['rows']} rows are complete")
    if alarm := warning(snapshot):
        console.print(alarm, style="bold red", markup=False)
    for output in outputs:
        console.print(indices_table(snapshot, output, output))
        if "second_order" in snapshot["outputs"][output]:
            console.print(pairs_table(snapshot["outputs"][output]["second_order"]))
        for sentence in remarks(snapshot, output, target):
            if sentence != alarm:
                console.print(sentence, markup=False)


@app.command()
def cancel(study: Id, url: Url = None, token: Token = None, as_json: AsJson = False) -> None:
    """Stop handing out a study's instances; results already there stay."""
    with Client(url, token) as client:
        answer = client.cancel(study)
    if as_json:
        print_json(answer)
    else:
        typer.echo(f"{study} is {answer['state']}")


@app.command()
def results(
    study: Id,
    out: Annotated[
        Path | None, typer.Option(help="Default: STUDY.csv.", show_default=False)
    ] = None,
    url: Url = None,
    token: Token = None,
    as_json: AsJson = False,
) -> None:
    """Download a study's results as CSV, one line per instance."""
    path = out or Path(f"{study}.csv")
    with Client(url, token) as client:
        client.results_csv(study, path)
    if as_json:
        print_json({"file": str(path)})
    else:
        typer.echo(str(path))


def workers(url: Url = None, token: Token = None, as_json: AsJson = False) -> None:
    """List the workers the coordinator knows."""
    with Client(url, token) as client:
        known = client.workers()
    if as_json:
        print_json({"workers": known})
    else:
        now = time.time()
        for worker in known:
            worker["last_seen"] = f"{max(0.0, now - worker['last_seen']):.0f} s ago"
            worker["tags"] = ", ".join(worker.get("tags", ()))
            worker["trust"] = f"{worker.get('trust', 1.0):.2f}"
        print_rows(
            ("id", "host", "host_class", "tags", "last_seen", "instances_done", "trust"), known
        )


def _read(file: Path) -> Json:
    try:
        study = json.loads(sys.stdin.read() if str(file) == "-" else file.read_text())
    except OSError as error:
        raise typer.BadParameter(f"{file} cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise typer.BadParameter(f"{file} is not JSON: {error}") from None
    if not isinstance(study, dict):
        raise typer.BadParameter(f"{file} must hold one JSON object, a study")
    return study


def _factor(text: str) -> Json:
    name, value = assignment(text)
    low, colon, high = value.partition(":")
    if not colon:
        raise typer.BadParameter(f"{text!r} is not of the form NAME=LOW:HIGH")
    return {
        "name": name,
        "range": [
            number(low, f"the lower end of {name}"),
            number(high, f"the upper end of {name}"),
        ],
    }
