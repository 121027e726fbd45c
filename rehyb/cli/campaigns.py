"""The command that runs the paper's two-phase study: `campaign run`."""

import sys
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rehyb.campaign.checks import check_plan
from rehyb.campaign.decisions import Proposed
from rehyb.campaign.files import MANIFEST, Report, load_manifest
from rehyb.campaign.plans import PRESETS, Plan
from rehyb.campaign.run import Campaign
from rehyb.cli.answers import Answer, Token, Url, answering
from rehyb.cli.models import added, read_model
from rehyb.cli.options import (
    check_target,
    check_up_to,
    fixed_values,
    interruptible,
    optional,
)
from rehyb.client import Client, Json
from rehyb.client.models import description_of
from rehyb.errors import Invalid, NotFound

if TYPE_CHECKING:
    from models.description import Description
    from rehyb.campaign.display import LineDisplay, LiveDisplay

app = typer.Typer(help="Run the paper's two-phase study.", no_args_is_help=True)


@app.callback()
def _group() -> None:
    """Run the paper's two-phase study."""


@app.command()
@answering
def run(
    as_json: bool,
    directory: Annotated[Path, typer.Option(help="Where results, and a local fleet, are kept.")],
    preset: Annotated[
        str, typer.Option(help="demo: minutes on a laptop. paper: the paper's own sizes.")
    ] = "demo",
    local_workers: Annotated[
        int | None,
        optional(
            min=1,
            help="Start a coordinator, an analysis and this many workers for as long as it takes. "
            "Default: use the coordinator at --url.",
        ),
    ] = None,
    model: Annotated[
        str, typer.Option(help="One of `rehyb model list`, or the folder of a model of your own.")
    ] = "elbow",
    output: Annotated[
        str | None,
        optional(
            help="The output to rank factors by. Default: the model's first, "
            "stiffness_error for the elbow."
        ),
    ] = None,
    screening_rows: Annotated[
        int | None, typer.Option(min=2, help="Rows of phase 1. Default: the preset's.")
    ] = None,
    variance_rows: Annotated[
        int | None, typer.Option(min=2, help="Rows of phase 2. Default: the preset's.")
    ] = None,
    sampling: Annotated[
        str | None,
        typer.Option(
            help="owen_blocks, sobol_blocks, sobol, sobol_paired or latin_hypercube. "
            "Default: the preset's."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of both designs.")] = 1,
    up_to: Annotated[
        int | None,
        optional(
            min=2,
            help="Extend phase 2 up to this many rows until it is as precise as --target says.",
        ),
    ] = None,
    target: Annotated[
        float | None,
        optional(help="Half width wanted of every interval of S and ST. Default: 0.02."),
    ] = None,
    fix: Annotated[
        list[str] | None,
        optional(metavar="NAME=VALUE", help="A factor that is not nominal throughout; repeat."),
    ] = None,
    outside_range: Annotated[
        bool, typer.Option("--outside-range", help="Allow --fix far outside a factor's range.")
    ] = False,
    ranges: Annotated[
        str,
        typer.Option(
            help="Of the arm's lengths: table_1, aligned10 (10 % round the nominal, as in the "
            "authors' code) or aligned (nominal)."
        ),
    ] = "table_1",
    confirm: Annotated[
        bool, typer.Option("--confirm", help="Ask before a factor is fixed. Default: fix it.")
    ] = False,
    url: Url = None,
    token: Token = None,
) -> Answer:
    """Screen all factors, fix the least influential one, and rank the others.

    Ctrl-C stops everything; running the same command again carries on where it was.
    """
    sizes: dict[str, Any] = {
        "screening_rows": screening_rows,
        "variance_rows": variance_rows,
        "sampling": sampling or None,
    }
    sizes |= {"ranges": ranges, "seed": seed, "most_rows": up_to, "target": target}
    sizes["outside_range"] = outside_range
    from models.built_in import built_in_models

    own = built_in_models().get(model)
    folder = Path(model) if (Path(model) / "model.toml").is_file() else None
    described = own
    if own is None and folder is not None:
        described = read_model(folder).description
    if described is not None:
        plan = _plan(preset, described, output, fix or (), **sizes)
        if (directory / MANIFEST).exists():
            load_manifest(directory, plan)
    elif local_workers is not None:
        raise Invalid(_no_model(model, built_in_models()))
    try:
        with interruptible(), ExitStack() as stack:
            fleet = None
            if local_workers is not None:
                from rehyb.fleet import LocalFleet

                code = () if folder is None else (folder,)
                fleet = stack.enter_context(
                    LocalFleet(directory, workers=local_workers, models=code)
                )
                url, token = fleet.url, fleet.token
            client = stack.enter_context(Client(url, token))
            if own is None:
                found = _found(client, model if folder is None else added(client, folder))
                plan = _plan(preset, description_of(found), output, fix or (), **sizes)
            display = _display(stack, live=not as_json)
            report = Campaign(
                client,
                plan,
                directory,
                show=display.show,
                tick=fleet.supervise if fleet else (lambda: None),
                confirm=partial(_ask, plan, display) if confirm else (lambda found: found.factor),
            ).run()
    except KeyboardInterrupt:
        print(
            f"\nInterrupted. Everything is stopped and nothing is lost: "
            f"run the same command again to carry on in {directory}.",
            file=sys.stderr,
        )
        raise
    return Answer(report.to_json(), partial(_print, report))


def _found(client: Client, model: str) -> Json:
    """Return a model that the coordinator knows; Invalid with those that it does."""
    try:
        return client.model(model)
    except NotFound:
        raise Invalid(_no_model(model, (known["name"] for known in client.models()))) from None


def _no_model(model: str, known: Iterable[str]) -> str:
    return (
        f"there is no model {model!r}: take one of {', '.join(known)}, or the folder of one of "
        "your own"
    )


def _plan(
    preset: str, model: "Description", output: str | None, fix: Sequence[str], **given: Any
) -> Plan:
    """Return what to compute: what is given, else the preset's sizes and the model's first output.

    Raises:
        typer.BadParameter: there is no such preset, factor or output, or the precision is none.
        Invalid: the coordinator would refuse it.
    """
    from models.built_in import built_in_models
    from sim.parameters.wearer import RANGES

    if preset not in PRESETS:
        raise typer.BadParameter(f"there is no preset {preset!r}: take {' or '.join(PRESETS)}")
    outputs = model.outputs
    if output is not None and output not in outputs:
        raise typer.BadParameter(
            f"{model.name} has no output {output!r}: it has {', '.join(outputs)}"
        )
    if given["ranges"] not in RANGES:
        raise typer.BadParameter(
            f"there are no ranges {given['ranges']!r}: take one of {', '.join(RANGES)}"
        )
    check_up_to(given["target"], given["most_rows"])
    check_target(given["target"], "saltelli")
    chosen = {name: value for name, value in given.items() if value is not None}
    chosen["fixed"] = fixed_values(model, fix)
    own = model.name in built_in_models()
    if not own:
        chosen["described"] = model.as_json()
    called = model.name if own else model.version
    plan = Plan(model=called, output=output or outputs[0], **{**PRESETS[preset], **chosen})
    check_plan(plan)
    return plan


def _display(stack: ExitStack, *, live: bool) -> "LiveDisplay | LineDisplay":
    """Return a display in place if stdout is a terminal, else one for a log."""
    from rehyb.campaign.display import LineDisplay, LiveDisplay
    from rehyb.display import plain_console

    console = plain_console()
    if console.is_terminal and live:
        return stack.enter_context(LiveDisplay(console))
    return LineDisplay(sys.stderr)


def _ask(plan: Plan, display: "LiveDisplay | LineDisplay", proposed: Proposed) -> str | None:
    """Show what phase 1 found on stderr, and ask what to fix."""
    from rehyb.display import indices_table, whole_console

    with display.paused():
        console = whole_console(stderr=True)
        console.print(indices_table(proposed.snapshot, plan.output, "Phase 1"))
        console.print(proposed.evidence)
        question = (
            f"Fix {proposed.factor} at {proposed.value} and go on? (yes, no, or the factor to fix "
            "instead): "
        )
        while True:
            print(question, end="", file=sys.stderr, flush=True)
            line = sys.stdin.readline()
            # No answer is no consent.
            answer = line.strip() if line else "no"
            if answer.lower() in ("y", "yes"):
                return proposed.factor
            if answer.lower() in ("n", "no"):
                return None
            if answer in proposed.factors:
                return str(answer)
            console.print(f"There is no factor {answer!r}: {', '.join(proposed.factors)}")


def _print(report: Report) -> None:
    from rehyb.campaign.display import report_parts
    from rehyb.display import whole_console

    # Paths and sentences are for copying: they are not to be broken at a terminal's edge.
    console = whole_console()
    for part in report_parts(report):
        console.print(part)
