"""Commands for a study under way: `study pause`, `extend`, `rerun`, `failures` and so on."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from intake.words import counted
from rehyb.again import Code, compared, evaluating, not_here
from rehyb.cli.answers import Answer, answering, json_text, print_line, print_rows
from rehyb.cli.options import AllowedPackages, ModelFolders, Servers, StudyId, optional
from rehyb.cli.study.size import Yes, check_rows
from rehyb.cli.study.studies import app
from rehyb.client import Client, Json
from rehyb.own_files import check_own
from rehyb.whole_files import write_json

#: Instances asked for at a time.
PAGE = 500
#: Outputs shown of a replayed instance.
SHOWN = 20


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
    yes: Yes = False,
) -> Answer:
    """Give a study more rows; the results that are there stay."""
    check_rows(client, study, rows, yes)
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
    replay: Annotated[
        bool, typer.Option("--replay", help="Evaluate it here, and compare with the result.")
    ] = False,
    models: ModelFolders = None,
    allow: AllowedPackages = None,
    umbridge: Servers = None,
) -> Answer:
    """Show one instance with all that it takes to replay it, as JSON, or replay it.

    With --replay, exit status 1 if what comes out here is not what the study has.
    """
    bundle = client.instance(study, row, position)
    if replay:
        code = Code(folders=models or (), packages=allow or (), servers=umbridge or ())
        return _replayed(client, bundle, code)
    if out is None:
        return Answer(bundle, json_text(bundle))
    check_own(out, "instance")
    write_json(out, bundle)
    return Answer(bundle, str(out))


def _replayed(client: Client, bundle: Json, code: Code) -> Answer:
    """Evaluate an instance here."""
    described = client.model(bundle["model"])

    def fetch(version: str, path: Path) -> None:
        if described["kind"] != "mjcf":
            raise not_here(version, described["kind"], code)
        client.model_archive(version, path)

    with evaluating(fetch, code) as evaluate:
        done = evaluate(bundle)
    stored = bundle["result"]
    agrees, sentence = (None, "the study has no result of it yet")
    if stored is not None:
        agrees, sentence = compared(stored, done)
        if not agrees and not described["deterministic"]:
            sentence += "; it says of itself that it is not deterministic"
    answer = {
        "id": bundle["id"],
        "model": bundle["model"],
        "parameters": bundle["parameters"],
        "model_seed": bundle["model_seed"],
        "outcome": done.outcome,
        "outputs": dict(done.outputs),
        "reason": done.reason,
        "stored": stored and {name: stored[name] for name in ("outcome", "outputs", "reason")},
        "agrees": agrees,
    }
    return Answer(answer, partial(_print_replayed, answer, sentence), 1 if agrees is False else 0)


def _print_replayed(answer: Json, sentence: str) -> None:
    said = f"{answer['outcome']} {answer['reason']}".strip()
    print_line(f"{answer['id']} of {answer['model']}: {said}")
    stored = (answer["stored"] or {}).get("outputs") or {}
    rows = [
        {"output": name, "here": repr(value), "study": repr(stored[name]) if name in stored else ""}
        for name, value in answer["outputs"].items()
    ]
    if rows:
        print_rows(("output", "here", "study"), rows[:SHOWN])
    print_line(sentence)


def _state(study: Json) -> Answer:
    return Answer(
        study,
        f"{study['id']} is {study['state']}: {counted(study['rows'], 'row', 'rows')}, "
        f"{counted(study['instances'], 'instance', 'instances')}, priority {study['priority']}",
    )
