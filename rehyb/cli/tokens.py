"""Commands about tokens: `token create`, `list`, `revoke`. They work on the database itself."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from rehyb.cli.options import AsJson, print_json, print_rows
from rehyb.cli.services import database_url, in_one_sentence

if TYPE_CHECKING:
    from sqlalchemy.engine import Engine

app = typer.Typer(
    help="Tokens for people and machines that need not be able to do everything.",
    no_args_is_help=True,
)


@app.command()
def create(
    name: Annotated[str, typer.Argument(help="Whose it is.")],
    scope: Annotated[
        list[str], typer.Option(help="submit, work, read or admin; repeat.", show_default=False)
    ],
    as_json: AsJson = False,
) -> None:
    """Make a token and print it, once: the database at REHYB_DATABASE_URL keeps a digest only."""
    from server.store import tokens

    with _database() as engine:
        token, secret = tokens.create(engine, name=name, scopes=scope, now=time.time())
    if as_json:
        print_json({**asdict(token), "token": secret})
    else:
        typer.echo(f"{token.id}  {token.name}: {', '.join(token.scopes)}\n{secret}")


@app.command("list")
def list_tokens(as_json: AsJson = False) -> None:
    """List all tokens ever made; their secrets cannot be shown."""
    from server.store import tokens

    with _database() as engine:
        found = [asdict(token) for token in tokens.every(engine)]
    if as_json:
        print_json({"tokens": found})
        return
    for token in found:
        token["scopes"] = ", ".join(token["scopes"])
        token["state"] = "good" if token["revoked_at"] is None else "revoked"
    print_rows(("id", "name", "scopes", "state"), found)


@app.command()
def revoke(
    token: Annotated[str, typer.Argument(help="Its id, from `rehyb token list`.")],
    as_json: AsJson = False,
) -> None:
    """Make a token worthless, for good; coordinators notice within five seconds."""
    from server.store import tokens

    with _database() as engine:
        revoked = tokens.revoke(engine, token, now=time.time())
    if as_json:
        print_json(asdict(revoked))
    else:
        typer.echo(f"{revoked.id} ({revoked.name}) is revoked")


@contextmanager
def _database() -> Iterator["Engine"]:
    """Open the database, brought up to date, and turn its errors into sentences."""
    from server.store import create_engine, upgrade

    with in_one_sentence():
        url = database_url()
        upgrade(url)
        engine = create_engine(url)
        try:
            yield engine
        finally:
            engine.dispose()
