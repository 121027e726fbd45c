"""The `rehyb` command: one module per noun, errors as one sentence.

Exit status: 0 done, 1 failed, 2 used wrongly, 130 interrupted (docs/use/files.md).
"""

import sys
from importlib import metadata
from typing import Annotated

import typer

from rehyb.cli import campaigns, close_loop, inspect, interpretation, models, simulation
from rehyb.cli.answers import print_line
from rehyb.cli.operate import database, pilots, services, tokens
from rehyb.cli.study import analyses, files, precision, reports, studies, surrogates
from rehyb.cli.study import control as control  # its commands join those of `studies`
from rehyb.errors import WRONG_PATHS, Invalid, RehybError
from rehyb.streams import print_any_character
from rehyb.threads import limit_threads

app = typer.Typer(
    help="Simulate, sample and rank what makes a robot's arm-stiffness measurement wrong.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
studies.app.command()(surrogates.surrogate)
studies.app.command()(files.export)
studies.app.command("analyse")(analyses.analyse_study)
studies.app.command()(precision.watch)
studies.app.command("with-effect")(close_loop.with_effect)
studies.app.command("of-session")(close_loop.of_session)
app.add_typer(studies.app, name="study")
app.add_typer(campaigns.app, name="campaign")
app.add_typer(database.app, name="db")
app.add_typer(tokens.app, name="token")
app.add_typer(models.app, name="model")
app.add_typer(interpretation.app, name="bank")
app.add_typer(models.umbridge, name="umbridge")
app.command()(services.up)
app.command()(services.page)
app.command()(services.coordinator)
app.command()(services.analysis)
app.command()(pilots.pilots)
app.command()(studies.workers)
app.command()(reports.report)
app.command()(files.bundle)
app.command()(files.reproduce)
app.command()(simulation.assess)
app.command()(simulation.validate)
app.command()(close_loop.close_loop)
app.command()(inspect.inspect)
app.command()(analyses.analyse)
app.command()(interpretation.interpret)


def _say_version(wanted: bool) -> None:
    """Print the version, and leave."""
    if wanted:
        print(f"rehyb {metadata.version('rehyb')}")
        raise typer.Exit


@app.callback()
def every_command(
    *,
    version: Annotated[
        bool,
        typer.Option("--version", callback=_say_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    """Simulate, sample and rank what makes a robot's arm-stiffness measurement wrong."""


def main() -> None:
    """Run the command; a failure is one sentence on stderr."""
    limit_threads()
    print_any_character()
    try:
        app(prog_name="rehyb")
    except RehybError as error:
        print_line(f"rehyb: {error}", err=True)
        sys.exit(2 if isinstance(error, Invalid) else 1)
    except OSError as error:
        # A disk that is full, a port that cannot be listened on.
        where = f"{error.filename}: " if error.filename else ""
        print(f"rehyb: {where}{error.strerror or error}", file=sys.stderr)
        sys.exit(2 if isinstance(error, WRONG_PATHS) else 1)
