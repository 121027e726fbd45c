"""Commands about tokens: `token create`, `list`, `revoke`. They work on the database itself."""

import time
from dataclasses import asdict
from functools import partial
from typing import Annotated

import typer

from rehyb.cli.answers import Answer, answering, print_rows
from rehyb.cli.operate.database import opened

app = typer.Typer(
    help="Tokens for people and machines that need not be able to do everything.",
    no_args_is_help=True,
)


@app.command()
@answering
def create(
    name: Annotated[str, typer.Argument(help="Whose it is.")],
    scope: Annotated[
        list[str], typer.Option(help="submit, work, read or admin; repeat.", show_default=False)
    ],
) -> Answer:
    """Make a token and print it, once: the database at REHYB_DATABASE_URL keeps a digest only."""
    from server.operations import tokens

    with opened() as engine:
        token, secret = tokens.create(engine, name=name, scopes=scope, now=time.time())
    return Answer(
        {**asdict(token), "token": secret},
        f"{token.id}  {token.name}: {', '.join(token.scopes)}\n{secret}",
    )


@app.command("list")
@answering
def list_tokens() -> Answer:
    """List all tokens ever made; their secrets cannot be shown."""
    from server.operations import tokens

    with opened() as engine:
        found = [asdict(token) for token in tokens.every(engine)]
    shown = [
        token
        | {
            "scopes": ", ".join(token["scopes"]),
            "state": "good" if token["revoked_at"] is None else "revoked",
        }
        for token in found
    ]
    columns = ("id", "name", "scopes", "state")
    return Answer({"tokens": found}, partial(print_rows, columns, shown))


@app.command()
@answering
def revoke(
    token: Annotated[str, typer.Argument(help="Its id, from `rehyb token list`.")],
) -> Answer:
    """Make a token worthless, for good; coordinators notice within five seconds."""
    from server.operations import tokens

    with opened() as engine:
        revoked = tokens.revoke(engine, token, now=time.time())
    return Answer(asdict(revoked), f"{revoked.id} ({revoked.name}) is revoked")
