"""What commands answer, and how typer gets them: a command returns an Answer, this prints it."""

import inspect
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from rehyb.client import Client, Json

Url = Annotated[
    str | None,
    typer.Option(
        help="The coordinator. Default: REHYB_URL, else this machine.", show_default=False
    ),
]
Token = Annotated[
    str | None, typer.Option(help="Its token. Default: REHYB_TOKEN.", show_default=False)
]
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


def answering(command: Callable[..., Answer | None]) -> Callable[..., None]:
    """Make a command for typer of a function that returns an Answer: adds --json.

    The function may ask for `as_json`, and print something on the way; what it prints is all if
    it returns None.
    """
    asks = "as_json" in inspect.signature(command).parameters

    def run(*, as_json: bool, **given: Any) -> None:
        answer = command(**given, as_json=as_json) if asks else command(**given)
        if answer is None:
            return
        if as_json:
            print_json(answer.content)
        elif callable(answer.text):
            answer.text()
        elif answer.text:
            typer.echo(answer.text)
        if answer.status:
            raise typer.Exit(answer.status)

    return _described(run, command, {"as_json": (AsJson, False)})


def asking(command: Callable[..., Answer | None]) -> Callable[..., None]:
    """Make a command for typer of a function of a `client`: adds --url, --token and --json."""

    def run(*, url: str | None, token: str | None, **given: Any) -> Answer | None:
        with Client(url, token) as client:
            return command(client=client, **given)

    return answering(_described(run, command, {"url": (Url, None), "token": (Token, None)}))


def _described(
    run: Callable[..., Any], command: Callable[..., Any], added: Mapping[str, tuple[Any, Any]]
) -> Callable[..., Any]:
    """Give `run` the name, help and options of `command`, with more: annotation and default."""
    options = {
        name: option
        for name, option in inspect.signature(command).parameters.items()
        if name not in ("client", *added)
    }
    late = {name: options.pop(name) for name in ("as_json",) if name in options}
    for name, (annotation, default) in added.items():
        options[name] = inspect.Parameter(
            name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation
        )
    options |= late
    run.__name__, run.__doc__ = command.__name__, command.__doc__
    described = [option.replace(kind=inspect.Parameter.KEYWORD_ONLY) for option in options.values()]
    vars(run)["__signature__"] = inspect.Signature(described)
    run.__annotations__ = {option.name: option.annotation for option in described}
    return run


def file_written(path: Path) -> Answer:
    """Answer with the name of a file."""
    return Answer({"file": str(path)}, str(path))


def study_submitted(study: Json) -> Answer:
    """Answer with a study as the coordinator took it."""
    return Answer(study, f"{study['id']}  {study['name']}: {study['instances']} instances")


def json_text(content: Any) -> str:
    """Return `content` as JSON, indented by two."""
    return json.dumps(content, indent=2, ensure_ascii=False)


def print_json(content: Any) -> None:
    """Print `content` as JSON on stdout."""
    print(json_text(content), flush=True)


def print_rows(columns: tuple[str, ...], rows: Sequence[Mapping[str, Any]]) -> None:
    """Print what `rows` have under `columns` as a table."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    table = Table(*columns, box=SIMPLE_HEAD, pad_edge=False)
    for row in rows:
        table.add_row(*(str(row.get(column, "")) for column in columns))
    Console().print(table)
