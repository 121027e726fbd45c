"""Commands for a study under way: `study pause`, `extend`, `rerun`, `failures` and so on."""

import json
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from rehyb.cli.answers import Answer, answering, json_text, print_rows
from rehyb.cli.options import StudyId, optional
from rehyb.cli.studies import app
from rehyb.client import Client, Json

#: Instances asked for at a time.
PAGE = 500


@app.command()
@answering
def pause(client: Client, study: StudyId) -> Answer:
    """Hand out nothing of a study until it is resumed."""
    return _state(client.pause(study))


@app.command()
@answering
def drain(client: Client, study: StudyId) -> Answer:
    """Finish the rows that were begun and begin no other; then the study is paused."""
    return _state(client.drain(study))


@app.command()
@answering
def resume(client: Client, study: StudyId) -> Answer:
    """Go on with a paused study."""
    return _state(client.resume(study))


@app.command()
@answering
def extend(
    client: Client,
    study: StudyId,
    rows: Annotated[int, typer.Option(min=1, help="How many it is to have in all.")],
) -> Answer:
    """Give a study more rows; the results that are there stay."""
    return _state(client.extend(study, rows))


@app.command()
@answering
def priority(
    client: Client,
    study: StudyId,
    value: Annotated[
        int, typer.Argument(min=-1000, max=1000, help="Higher is sooner; a new study has 0.")
    ],
) -> Answer:
    """Serve a study before all of lower priority."""
    return _state(client.prioritise(study, value))


@app.command()
@answering
def settle(client: Client, study: StudyId) -> Answer:
    """Extend a study no more, whatever precision was wanted of it."""
    client.remove_precision_goal(study)
    return Answer({"settled": study}, f"{study} is extended no more")


@app.command()
@answering
def rerun(
    client: Client,
    study: StudyId,
    which: Annotated[
        str, typer.Option(help="failed, or all: from the start, with the workers' versions of now.")
    ] = "failed",
    outcome: Annotated[
        list[str] | None, typer.Option(help="Only failures of this name; repeat.")
    ] = None,
) -> Answer:
    """Run the failed instances again, or all of them."""
    answer = client.rerun(study, which, outcome or None)
    return Answer(
        answer, f"{answer['taken_back']} results were taken back; {study} is {answer['state']}"
    )


@app.command()
@answering
def delete(client: Client, study: StudyId) -> Answer:
    """Remove a study that does not run, with all its results."""
    client.delete(study)
    return Answer({"deleted": study}, f"{study} is deleted")


@app.command()
@answering
def failures(
    client: Client,
    study: StudyId,
    outcome: Annotated[str | None, typer.Option(help="Only failures of this name.")] = None,
    quarantined: Annotated[
        bool, typer.Option("--quarantined", help="Only what went wrong on host after host.")
    ] = False,
) -> Answer:
    """List a study's failed instances: where, why, and who reported it."""
    state = "quarantined" if quarantined else "failed"
    found = client.all_instances(study, state=state, outcome=outcome, page=PAGE)
    columns = ("row", "position", "outcome", "reason", "worker")
    return Answer({"instances": found}, partial(print_rows, columns, found))


@app.command()
@answering
def instance(
    client: Client,
    study: StudyId,
    row: Annotated[int, typer.Argument(min=0)],
    position: Annotated[int, typer.Argument(min=0)],
    out: Annotated[Path | None, optional(help="A file for `rehyb assess --replay`.")] = None,
) -> Answer:
    """Show one instance with all that it takes to replay it, as JSON."""
    bundle = client.instance(study, row, position)
    if out is None:
        return Answer(bundle, json_text(bundle))
    out.write_text(json.dumps(bundle, indent=2) + "\n")
    return Answer(bundle, str(out))


def _state(study: Json) -> Answer:
    return Answer(
        study,
        f"{study['id']} is {study['state']}: {study['rows']} rows, "
        f"{study['instances']} instances, priority {study['priority']}",
    )
