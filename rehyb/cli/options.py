"""Options and arguments that several commands share, and how their texts are read."""

import json
import signal
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from math import isfinite
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rehyb.errors import Invalid

if TYPE_CHECKING:
    from models.description import Description
    from models.factors import Factor

#: An option that may be left out; its help says what holds then.
optional = partial(typer.Option, show_default=False)
StudyId = Annotated[str, typer.Argument(help="The study's id.", metavar="STUDY")]
Output = Annotated[str | None, optional(help="Default: the study's first.")]
Target = Annotated[
    float | None,
    optional(
        help="Half width wanted of every interval. Default: 0.02 of S and ST, a tenth of the "
        "largest μ*."
    ),
]

#: The code of models that are not rehyb's own and not data.
ModelFolders = Annotated[
    list[Path] | None,
    optional(metavar="DIR", help="A folder with a model.toml, whose program may run here; repeat."),
]
AllowedPackages = Annotated[
    list[str] | None,
    optional(metavar="NAME", help="A model that a package here announces; repeat."),
]
Servers = Annotated[
    list[str] | None,
    optional(metavar="URL", help="A server of models of kind umbridge in --models; repeat."),
]


def check_target(target: float | None, method: str | None = None) -> None:
    """Check a half width wanted of a method's indices; typer.BadParameter if it can be none.

    Without a method, of any indices.
    """
    if target is None:
        return
    from analysis.sensitivity.judgement.stopping import check_target

    try:
        check_target(target, method)
    except ValueError as error:
        raise typer.BadParameter(f"--{error}") from None


def check_up_to(target: float | None, up_to: int | None) -> None:
    """Check that a wanted precision comes with what it may cost; else typer.BadParameter."""
    if target is not None and up_to is None:
        raise typer.BadParameter("--target needs --up-to, the rows that it may cost in all")


def check_submitted(submit: bool, url: str | None, token: str | None) -> None:
    """Check that a coordinator is named for what it does only; else Invalid."""
    if not submit and (url or token):
        raise Invalid("--url and --token go with --submit: without it this machine does the work")


def assignment(text: str) -> tuple[str, str]:
    """Split "name=value".

    Raises:
        typer.BadParameter: there is no name, or no value.
    """
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise typer.BadParameter(f"{text!r} is not of the form name=value")
    return name, value


def assignments(texts: Iterable[str]) -> dict[str, str]:
    """Split every "name=value".

    Raises:
        typer.BadParameter: one has no name or no value, or a name comes twice.
    """
    found: dict[str, str] = {}
    for name, value in map(assignment, texts):
        if name in found:
            raise typer.BadParameter(
                f"{name} is set twice, to {found[name]} and to {value}: say it once"
            )
        found[name] = value
    return found


def fixed_values(model: "Description", texts: Iterable[str]) -> dict[str, float]:
    """Return "name=value" of a model's factors as numbers; that of a choice may be its name.

    Raises:
        typer.BadParameter: one is no factor's value, or a name comes twice.
    """
    from models.factors import no_factor

    known = {source.name: source for source in model.sources}
    values = {}
    for name, text in assignments(texts).items():
        if name not in known:
            raise typer.BadParameter(no_factor(model.name, name, known))
        values[name] = factor_value(known[name], text)
    return values


def factor_value(factor: "Factor", text: str) -> float:
    """Return a factor's value: a number, or a name if it is a choice; else typer.BadParameter."""
    try:
        return factor.number(text) if factor.choices else number(text, factor.name)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None


def number(text: str, what: str) -> float:
    """Return `text` as a number.

    Raises:
        typer.BadParameter: it is none, or not finite; the message names `what`.
    """
    try:
        value = float(text)
    except ValueError:
        raise typer.BadParameter(f"{what} must be a number, not {text!r}") from None
    if not isfinite(value):
        raise typer.BadParameter(f"{what} must be a finite number, not {text!r}")
    return value


def read_json(source: str) -> Any:
    """Return the JSON in a file, or of standard input if `source` is "-".

    Raises:
        typer.BadParameter: it cannot be read, is not JSON, or has a key twice.
    """
    from analysis.json_values import key_twice

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        if (key := key_twice(pairs)) is not None:
            raise typer.BadParameter(f"{source}: the key {key!r} comes twice: leave out one")
        return dict(pairs)

    try:
        text = sys.stdin.read() if source == "-" else Path(source).read_text()
        return json.loads(text, object_pairs_hook=once)
    except OSError as error:
        raise typer.BadParameter(f"{source} cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise typer.BadParameter(f"{source} is not JSON: {error}") from None
    except RecursionError:
        raise typer.BadParameter(f"{source} is nested too deeply") from None


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
