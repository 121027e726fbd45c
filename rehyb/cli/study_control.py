"""Commands for a study under way: `study pause`, `extend`, `rerun`, `failures` and so on."""

import json
from pathlib import Path
from typing import Annotated

import typer

from rehyb.cli.options import AsJson, Token, Url, print_json, print_rows
from rehyb.cli.studies import Id, app
from rehyb.client import Client, Json

#: Instances asked for at a time.
PAGE = 500


@app.command()
def pause(study: Id, url: Url = None, token: Token = None, as_json: AsJson = False) -> None:
    """Hand out nothing of a study until it is resumed."""
    with Client(url, token) as client:
        _say(client.pause(study), as_json)


@app.command()
def drain(study: Id, url: Url = None, token: Token = None, as_json: AsJson = False) -> None:
    """Finish the rows that were begun and begin no other; then the study is paused."""
    with Client(url, token) as client:
        _say(client.drain(study), as_json)


@app.command()
def resume(study: Id, url: Url = None, token: Token = None, as_json: AsJson = False) -> None:
    """Go on with a paused study."""
    with Client(url, token) as client:
        _say(client.resume(study), as_json)


@app.command()
def extend(
    study: Id,
    rows: Annotated[int, typer.Option(min=1, help="How many it is to have in all.")],
    url: Url = None,
    token: Token = None,
    as_json: AsJson = False,
) -> None:
    """Give a study more rows; the results that are there stay."""
    with Client(url, token) as client:
        _say(client.extend(study, rows), as_json)


@app.command()
def priority(
    study: Id,
    value: Annotated[
        int, typer.Argument(min=-1000, max=1000, help="Higher is sooner; a new study has 0.")
    ],
    url: Url = None,
    token: Token = None,
    as_json: AsJson = False,
) -> None:
    """Serve a study before all of lower priority."""
    with Client(url, token) as client:
        _say(client.prioritise(study, value), as_json)


@app.command()
def settle(study: Id, url: Url = None, token: Token = None, as_json: AsJson = False) -> None:
    """Extend a study no more, whatever precision was wanted of it."""
    with Client(url, token) as client:
        client.let_be(study)
    if as_json:
        print_json({"settled": study})
    else:
        typer.echo(f"{study} is extended no more")


@app.command()
def rerun(
    study: Id,
    which: Annotated[
        str, typer.Option(help="failed, or all: from the start, with the workers' versions of now.")
    ] = "failed",
    outcome: Annotated[
        list[str] | None, typer.Option(help="Only failures of this name; repeat.")
    ] = None,
    url: Url = None,
    token: Token = None,
    as_json: AsJson = False,
) -> None:
    """Run the failed instances again, or all of them."""
    with Client(url, token) as client:
        answer = client.rerun(study, which, outcome or None)
    if as_json:
        print_json(answer)
    else:
        typer.echo(f"{answer['taken_back']} results were taken back; {study} is {answer['state']}")


@app.command()
def delete(study: Id, url: Url = None, token: Token = None, as_json: AsJson = False) -> None:
    """Remove a study that does not run, with all its results."""
    with Client(url, token) as client:
        client.delete(study)
    if as_json:
        print_json({"deleted": study})
    else:
        typer.echo(f"{study} is deleted")


@app.command()
def failures(
    study: Id,
    outcome: Annotated[str | None, typer.Option(help="Only failures of this name.")] = None,
    quarantined: Annotated[
        bool, typer.Option("--quarantined", help="Only what went wrong on host after host.")
    ] = False,
    url: Url = None,
    token: Token = None,
    as_json: AsJson = False,
) -> None:
    """List a study's failed instances: where, why, and who reported it."""
    state = "quarantined" if quarantined else "failed"
    found: list[Json] = []
    after: str | None = None
    with Client(url, token) as client:
        while True:
            page = client.instances(study, state=state, outcome=outcome, after=after, limit=PAGE)
            found += page["instances"]
            after = page["next"]
            if after is None:
                break
    if as_json:
        print_json({"instances": found})
    else:
        print_rows(("row", "position", "outcome", "reason", "worker"), found)


@app.command()
def instance(
    study: Id,
    row: Annotated[int, typer.Argument(min=0)],
    position: Annotated[int, typer.Argument(min=0)],
    out: Annotated[
        Path | None,
        typer.Option(help="A file for `rehyb assess --replay`.", show_default=False),
    ] = None,
    url: Url = None,
    token: Token = None,
    as_json: AsJson = False,
) -> None:
    """Show one instance with all that it takes to replay it, as JSON."""

    with Client(url, token) as client:
        bundle = client.instance(study, row, position)
    if out is not None:
        out.write_text(json.dumps(bundle, indent=2) + "\n")
    if as_json or out is None:
        print_json(bundle)
    else:
        typer.echo(str(out))


def _say(study: Json, as_json: bool) -> None:
    if as_json:
        print_json(study)
    else:
        typer.echo(
            f"{study['id']} is {study['state']}: {study['rows']} rows, "
            f"{study['instances']} instances, priority {study['priority']}"
        )
