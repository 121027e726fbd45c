"""Commands about studies: `study submit`, `list`, `show`, `progress`, `indices`, and so on."""

import json
import time
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from rehyb.cli.answers import (
    Answer,
    Token,
    Url,
    answering,
    file_written,
    print_line,
    print_rows,
    study_submitted,
)
from rehyb.cli.options import (
    StudyId,
    Target,
    assignments,
    check_target,
    check_up_to,
    number,
    optional,
    read_json,
)
from rehyb.cli.study.precision import wait_for_precision
from rehyb.cli.study.size import Yes, check_study
from rehyb.client import Client, Json
from rehyb.errors import Invalid
from rehyb.own_files import check_own

app = typer.Typer(help="Submit studies and see what becomes of them.", no_args_is_help=True)


@app.command()
@answering
def submit(
    as_json: bool,
    file: Annotated[
        Path | None,
        typer.Argument(help="The study as JSON; - reads standard input.", show_default=False),
    ] = None,
    model: Annotated[str | None, typer.Option(help="One of `rehyb model list`.")] = None,
    method: Annotated[
        str | None,
        typer.Option(help="morris, saltelli, saltelli_second_order, shapley, surrogate or sample."),
    ] = None,
    rows: Annotated[int | None, typer.Option(min=1, help="Rows of the design.")] = None,
    name: Annotated[str | None, typer.Option(help="What to call it.")] = None,
    factor: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=LOW:HIGH", help="Sample this factor; repeat. Default: all."),
    ] = None,
    fix: Annotated[
        list[str] | None, typer.Option(metavar="NAME=VALUE", help="Hold this factor; repeat.")
    ] = None,
    output: Annotated[
        list[str] | None, typer.Option(help="Rank this output; repeat. Default: all.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Default: 1.")] = None,
    sampling: Annotated[
        str | None,
        typer.Option(
            help="owen_blocks, sobol_blocks, sobol, sobol_paired, latin_hypercube; for morris, "
            "random_trajectories or trajectories, too. Default: owen_blocks."
        ),
    ] = None,
    priority: Annotated[int | None, optional(help="Higher is sooner. Default: 0.")] = None,
    tag: Annotated[
        list[str] | None, typer.Option(help="Only for workers that have this tag; repeat.")
    ] = None,
    key: Annotated[
        str | None, typer.Option(help="Idempotency key: submitting again returns the same study.")
    ] = None,
    up_to: Annotated[
        int | None,
        optional(
            min=1,
            help="Have the study extended until it is as precise as --target says or has this many "
            "rows, and wait for it as `study watch` does.",
        ),
    ] = None,
    group: Annotated[
        list[str] | None,
        typer.Option(help="Factors that move together.", metavar="NAME=FACTOR,FACTOR"),
    ] = None,
    target: Annotated[
        float | None, typer.Option(help="Half width wanted of every interval of the first output.")
    ] = None,
    outside_range: Annotated[
        bool, typer.Option("--outside-range", help="Allow values far outside a factor's range.")
    ] = False,
    preset: Annotated[
        str | None,
        typer.Option(
            help="anthropometric: Table 1's factors spread and correlated as those of bodies are."
        ),
    ] = None,
    yes: Yes = False,
    url: Url = None,
    token: Token = None,
) -> Answer:
    """Submit a study, from a JSON file or from options; options win over the file."""
    check_up_to(target, up_to)
    check_target(target)
    study = _described(
        (_preset(preset) if preset else {}) | (_read(file) if file else {}),
        {
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
            "fixed": {n: _fixed(n, v) for n, v in assignments(fix).items()} if fix else None,
            "precision": None if up_to is None else {"target": target, "up_to": up_to},
            "groups": {n: v.split(",") for n, v in assignments(group).items()} if group else None,
            "outside_range": True if outside_range else None,
        },
    )
    with Client(url, token) as client:
        check_study(client, study, yes)
        submitted = study_submitted(client.submit(study, idempotency_key=key))
        if up_to is None:
            return submitted
        if not as_json:
            submitted.show(as_json=False)
        precise = wait_for_precision(client, submitted.content["id"], as_json=as_json)
    return Answer(submitted.content | precise, status=0 if precise["reached"] else 1)


@app.command("list")
@answering
def list_studies(client: Client) -> Answer:
    """List the studies."""
    studies = client.studies()
    columns = ("id", "name", "model", "method", "rows", "state")
    return Answer({"studies": studies}, partial(print_rows, columns, studies))


@app.command()
@answering
def show(client: Client, study: StudyId) -> Answer:
    """Show what a study samples."""
    answer = client.study(study)
    lines = (
        f"{field:12} {value if isinstance(value, str | int) else json.dumps(value)}"
        for field, value in answer.items()
    )
    return Answer(answer, "\n".join(lines))


@app.command()
@answering
def progress(
    client: Client,
    as_json: bool,
    study: StudyId,
    watch: Annotated[
        bool, typer.Option("--watch", help="Print a line per second until it is complete.")
    ] = False,
) -> None:
    """Show how far a study is, its rate, and its failures by cause."""
    from rehyb.display import progress_in_words

    def show_one(answer: Json) -> None:
        if as_json:
            print(json.dumps(answer), flush=True)
        else:
            print_line(f"{answer['state']}: {progress_in_words(answer)}")

    if watch:
        client.wait(study, on_progress=show_one)
    else:
        show_one(client.progress(study))


@app.command()
@answering
def indices(
    study: StudyId,
    plot: Annotated[Path | None, optional(help="Also draw them.", metavar="FILE.png")] = None,
    target: Target = None,
    url: Url = None,
    token: Token = None,
) -> Answer:
    """Show a study's sensitivity indices, their intervals, and how many rows are still wanted."""
    check_target(target)
    if plot is not None:
        check_own(plot, "picture")
    with Client(url, token) as client:
        snapshot = client.indices(study)
        now = client.progress(study)
    # Of which method it is, only the coordinator knows.
    check_target(target, snapshot["method"])
    outputs = list(snapshot["outputs"])
    if plot is not None:
        from analysis.reports.figures import bars, curve, plane
        from analysis.reports.paper import on_paper

        curves = list(snapshot.get("curves", {}))
        if not outputs and not curves:
            raise Invalid(f"there is nothing to draw: study {study} has no indices yet")
        draw = plane if snapshot["method"] == "morris" else bars
        drawn = draw(snapshot, outputs[0]) if outputs else curve(snapshot, curves[0])
        on_paper(drawn).savefig(plot)
    return Answer(snapshot, partial(_print_indices, snapshot, now, target))


@app.command()
@answering
def cancel(client: Client, study: StudyId) -> Answer:
    """Stop handing out a study's instances; results already there stay."""
    answer = client.cancel(study)
    return Answer(answer, f"{study} is {answer['state']}")


@app.command()
@answering
def results(
    client: Client,
    study: StudyId,
    out: Annotated[Path | None, optional(help="Default: STUDY.csv.")] = None,
) -> Answer:
    """Download a study's results as CSV, one line per instance."""
    path = out or Path(f"{study}.csv")
    check_own(path, "csv")
    client.results_csv(study, path)
    return file_written(path)


@answering
def workers(client: Client) -> Answer:
    """List the workers the coordinator knows."""
    known, now = client.workers(), time.time()
    shown = [
        worker
        | {
            "last_seen": f"{max(0.0, now - worker['last_seen']):.0f} s ago",
            "tags": ", ".join(worker.get("tags", ())),
            "trust": f"{worker.get('trust', 1.0):.2f}",
            "refuses": ", ".join(worker.get("refused", ())),
        }
        for worker in known
    ]
    columns = ("id", "host", "host_class", "tags", "last_seen", "instances_done", "trust")
    refuses = ("refuses",) if any(row["refuses"] for row in shown) else ()
    return Answer({"workers": known}, partial(print_rows, (*columns, *refuses), shown))


def _described(study: Json, given: dict[str, Any]) -> Json:
    """Return a study from a file with what was given instead of it, and a name."""
    study = study | {field: value for field, value in given.items() if value is not None}
    if missing := [field for field in ("model", "method", "rows") if field not in study]:
        raise typer.BadParameter(
            f"a study needs {', '.join(missing)}: give --{' --'.join(missing)}, or a FILE"
        )
    study.setdefault("name", f"{study['model']} {study['method']} {study['rows']}")
    return study


def _print_indices(snapshot: Json, progress: Json, target: float | None) -> None:
    from analysis.sensitivity.remarks import remarks, warning
    from rehyb.display import (
        indices_table,
        left_in_words,
        pairs_table,
        spread_table,
        whole_console,
    )

    console = whole_console()
    seen, complete = snapshot["rows_complete"], progress["rows_complete"]
    behind = f"; the indices are of {seen} of them" if seen < complete else ""
    console.print(f"{complete} of {progress['rows']} rows are complete{behind}")
    if left := left_in_words(progress):
        console.print(left, style="bold red")
    if alarm := warning(snapshot):
        console.print(alarm, style="bold red")

    def remark(output: str) -> None:
        for sentence in remarks(snapshot, output, target):
            if sentence != alarm:
                console.print(sentence)

    if snapshot["method"] == "sample":
        console.print(spread_table(snapshot))
        remark(next(iter(snapshot["outputs"])))
        return
    for output in snapshot["outputs"]:
        console.print(indices_table(snapshot, output, output))
        if "second_order" in snapshot["outputs"][output]:
            console.print(pairs_table(snapshot["outputs"][output]["second_order"]))
        remark(output)
    for curve, said in snapshot.get("curves", {}).items():
        console.print(indices_table(snapshot, curve, f"{curve}, the whole curve"))
        if "second_order" in said["whole"]:
            console.print(pairs_table(said["whole"]["second_order"]))
        remark(curve)


def _read(file: Path) -> Json:
    study = read_json(str(file))
    if not isinstance(study, dict):
        raise typer.BadParameter(f"{file} must hold one JSON object, a study")
    return study


def _preset(name: str) -> Json:
    from sim.parameters.anthropometric import STUDY

    if name != "anthropometric":
        raise typer.BadParameter(f"there is no preset {name!r}: there is anthropometric")
    return dict(STUDY)


def _fixed(name: str, text: str) -> float | str:
    """Return a fixed value: a number, or the name of a choice, which the coordinator knows."""
    from sim.parameters.conditions import CONDITIONS

    named = any(text in factor.choices for factor in CONDITIONS if factor.name == name)
    return text if named else number(text, name)


def _factor(text: str) -> Json:
    name, _, value = text.partition("=")
    low, colon, high = value.partition(":")
    if not (name and colon):
        raise typer.BadParameter(
            f"--factor {text!r} is not of the form NAME=LOW:HIGH, as in {name or 'x1'}=0.5:1.5"
        )
    return {
        "name": name,
        "range": [
            number(low, f"the lower end of {name}"),
            number(high, f"the upper end of {name}"),
        ],
    }
