"""Options that several commands share, and what all of them do with a result."""

import json
import signal
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Annotated, Any

import typer

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


def print_json(content: Any) -> None:
    """Print `content` as JSON on stdout."""
    print(json.dumps(content, indent=2, ensure_ascii=False), flush=True)


def print_rows(columns: tuple[str, ...], rows: Sequence[Mapping[str, Any]]) -> None:
    """Print what `rows` have under `columns` as a table."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    table = Table(*columns, box=SIMPLE_HEAD, pad_edge=False)
    for row in rows:
        table.add_row(*(str(row.get(column, "")) for column in columns))
    Console().print(table)


def assignment(text: str) -> tuple[str, str]:
    """Split "name=value".

    Raises:
        typer.BadParameter: there is no name, or no value.
    """
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise typer.BadParameter(f"{text!r} is not of the form name=value")
    return name, value


def number(text: str, what: str) -> float:
    """Return `text` as a number.

    Raises:
        typer.BadParameter: it is none; the message names `what`.
    """
    try:
        return float(text)
    except ValueError:
        raise typer.BadParameter(f"{what} must be a number, not {text!r}") from None


@contextmanager
def interruptible() -> Iterator[None]:
    """Within the block, SIGTERM ends the command as Ctrl-C does: everything is stopped in order."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
