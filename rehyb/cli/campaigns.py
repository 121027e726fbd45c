"""The command that runs the paper's two-phase study: `campaign run`."""

import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from rehyb.campaign import PRESETS, Campaign, Plan, Report
from rehyb.cli.options import AsJson, Token, Url, interruptible, print_json
from rehyb.client import Client

app = typer.Typer(help="Run the paper's two-phase study.", no_args_is_help=True)


@app.callback()
def _group() -> None:
    """Run the paper's two-phase study."""


@app.command()
def run(
    directory: Annotated[Path, typer.Option(help="Where results, and a local fleet, are kept.")],
    preset: Annotated[
        str, typer.Option(help="demo: minutes on a laptop. paper: the paper's own sizes.")
    ] = "demo",
    local_workers: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Start a coordinator, an analysis and this many workers for as long as it takes. "
            "Default: use the coordinator at --url.",
            show_default=False,
        ),
    ] = None,
    model: Annotated[str, typer.Option(help="elbow, ishigami or sobol_g.")] = "elbow",
    output: Annotated[
        str | None,
        typer.Option(
            help="The output to rank factors by. Default: the model's first, "
            "stiffness_error for the elbow.",
            show_default=False,
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
            help="sobol_blocks, sobol, sobol_paired or latin_hypercube. Default: the preset's."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of both designs.")] = 1,
    url: Url = None,
    token: Token = None,
    as_json: AsJson = False,
) -> None:
    """Screen all factors, fix the least influential one, and rank the others.

    Ctrl-C stops everything; running the same command again carries on where it was.
    """
    from sim.catalogue import MODELS

    if preset not in PRESETS:
        raise typer.BadParameter(f"there is no preset {preset!r}: take {' or '.join(PRESETS)}")
    if model not in MODELS:
        raise typer.BadParameter(f"there is no model {model!r}: take one of {', '.join(MODELS)}")
    outputs = MODELS[model].outputs
    if output is not None and output not in outputs:
        raise typer.BadParameter(f"{model} has no output {output!r}: it has {', '.join(outputs)}")
    sizes = PRESETS[preset]
    plan = Plan(
        model=model,
        output=output or outputs[0],
        screening_rows=screening_rows or sizes.screening_rows,
        variance_rows=variance_rows or sizes.variance_rows,
        sampling=sampling or sizes.sampling,
        seed=seed,
    )
    try:
        report = _run(plan, directory, local_workers, url, token, as_json)
    except KeyboardInterrupt:
        print(
            f"\nInterrupted. Everything is stopped and nothing is lost: "
            f"run the same command again to carry on in {directory}.",
            file=sys.stderr,
        )
        raise
    if as_json:
        print_json(report.to_json())
    else:
        _print(report)


def _run(
    plan: Plan,
    directory: Path,
    local_workers: int | None,
    url: str | None,
    token: str | None,
    as_json: bool,
) -> Report:
    from rich.console import Console

    from rehyb.display import LineDisplay, LiveDisplay
    from rehyb.fleet import LocalFleet

    with interruptible(), ExitStack() as stack:
        tick = None
        if local_workers is not None:
            fleet = stack.enter_context(LocalFleet(directory, workers=local_workers))
            url, token, tick = fleet.url, fleet.token, fleet.supervise
        client = stack.enter_context(Client(url, token))
        console = Console()
        display: LiveDisplay | LineDisplay
        if console.is_terminal and not as_json:
            display = stack.enter_context(LiveDisplay(console))
        else:
            display = LineDisplay(sys.stderr)
        return Campaign(
            client,
            plan,
            directory,
            show=display.show,
            tick=tick or (lambda: None),
        ).run()


def _print(report: Report) -> None:
    from rich.console import Console

    from rehyb.display import report_parts

    # Paths and sentences are for copying: they are not to be broken at a terminal's edge.
    console = Console(soft_wrap=True)
    for part in report_parts(report):
        console.print(part)
