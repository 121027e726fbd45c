"""What commands answer, and how typer gets them: a command returns an Answer, this prints it."""

import inspect
import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from intake.words import counted
from rehyb.cli.options import optional
from rehyb.client import Client, Json
from rehyb.streams import takes_any_character

Url = Annotated[
    str | None, optional(help="The coordinator. Default: REHYB_URL, else this machine.")
]
Token = Annotated[str | None, optional(help="Its token. Default: REHYB_TOKEN.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]


@dataclass(frozen=True)
class Answer:
    """What a command found."""

    #: What --json prints.
    content: Any
    #: What is printed otherwise, or what prints it; empty: nothing.
    text: str | Callable[[], None] = ""
    #: Exit status of the command.
    status: int = 0

    def show(self, as_json: bool) -> None:
        """Print it, and leave with its status."""
        if as_json:
            print_json(self.content)
        elif callable(self.text):
            self.text()
        elif self.text:
            print_line(self.text)
        if self.status:
            raise typer.Exit(self.status)


def answering(command: Callable[..., Answer | None]) -> Callable[..., None]:
    """Make a command for typer of a function that returns an Answer: adds --json.

    If the function takes a `client`, --url and --token are added too. It may take `as_json` and
    print something on the way; if it returns None, that is all.
    """
    taken = inspect.signature(command).parameters
    added: dict[str, tuple[Any, Any]] = {"as_json": (AsJson, False)}
    if "client" in taken:
        added = {"url": (Url, None), "token": (Token, None)} | added

    def run(*, as_json: bool, **given: Any) -> None:
        if "as_json" in taken:
            given["as_json"] = as_json
        with ExitStack() as stack:
            if "client" in taken:
                client = Client(given.pop("url"), given.pop("token"))
                given["client"] = stack.enter_context(client)
            answer = command(**given)
        if answer is not None:
            answer.show(as_json)

    kind = inspect.Parameter.KEYWORD_ONLY
    options = [
        *(taken[name].replace(kind=kind) for name in taken if name not in ("client", "as_json")),
        *(
            inspect.Parameter(name, kind, annotation=annotation, default=default)
            for name, (annotation, default) in added.items()
        ),
    ]
    run.__name__, run.__doc__ = command.__name__, command.__doc__
    run.__annotations__ = {option.name: option.annotation for option in options}
    vars(run)["__signature__"] = inspect.Signature(options)
    return run


def file_written(path: Path) -> Answer:
    """Answer with the name of a file."""
    return Answer({"file": str(path)}, str(path))


def study_submitted(study: Json) -> Answer:
    """Answer with a study as the coordinator took it."""
    instances = counted(study["instances"], "instance", "instances")
    return Answer(study, f"{study['id']}  {study['name']}: {instances}")


def json_text(content: Any) -> str:
    """Return `content` as JSON, indented by two."""
    # What standard output would escape else is no JSON.
    return json.dumps(content, indent=2, ensure_ascii=not takes_any_character())


def print_json(content: Any) -> None:
    """Print `content` as JSON on stdout."""
    print(json_text(content), flush=True)


def print_line(text: str, *, err: bool = False) -> None:
    """Print a text in which others may have put what turns a line around or shows as nothing."""
    from analysis.reports.wording import visible

    typer.echo(visible(text), err=err)


def print_rows(columns: tuple[str, ...], rows: Sequence[Mapping[str, Any]]) -> None:
    """Print what `rows` have under `columns`: a table, or where that is too wide lines."""
    from analysis.reports.wording import visible
    from rehyb.display import ANY_WIDTH, plain_console, plain_table

    console = plain_console()
    table = plain_table(*columns)
    for row in rows:
        table.add_row(*(visible(str(row.get(column, ""))) for column in columns))
    if console.measure(table, options=console.options.update(width=ANY_WIDTH)).maximum <= (
        console.width
    ):
        console.print(table)
        return
    name, *others = columns
    for row in rows:
        said = [f"{other} {row[other]}" for other in others if row.get(other, "") not in ("", None)]
        line = visible(f"{row[name]}: {', '.join(said)}")
        console.print(line, highlight=False)
