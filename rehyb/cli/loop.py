"""The command that closes the loop with measured data: `close-loop`."""

import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import typer

from rehyb.cli.options import AsJson, print_json
from rehyb.errors import Invalid, RehybError


def close_loop(
    session: Annotated[
        Path, typer.Argument(metavar="SESSION_FOLDER", help="Folder with session.json and trials.")
    ],
    out: Annotated[Path, typer.Option(help="Folder for report, repaired model and residuals.")],
    as_json: AsJson = False,
) -> None:
    """Trace the residual of measured trials to an effect the declared model lacks, and add it.

    Exit status 2 if the session cannot be analysed; then nothing is written.
    """
    if find_spec("matplotlib") is None:
        raise RehybError("the report needs pictures: pip install 'rehyb[figures]'")
    from analysis.closeloop.errors import SessionError
    from analysis.closeloop.loop import close_loop as close

    def show(stage: str) -> None:
        if sys.stderr.isatty():
            print(f"rehyb: {stage}", file=sys.stderr)

    try:
        report = close(session, out, show)
    except SessionError as error:
        raise Invalid(str(error)) from None
    if as_json:
        print_json(report)
    else:
        _print(report, out)


def _print(report: dict[str, Any], out: Path) -> None:
    typer.echo(report["verdict"])
    for effect in report["effects"]:
        typer.echo(f"  {effect['name']} at {effect['joint']}")
        for name, entry in effect["parameters"].items():
            low, high = entry["ci90"]
            typer.echo(
                f"    {name:20} {entry['value']: 9.4g} [{low:.4g}, {high:.4g}] {entry['unit']}"
            )
        if effect["indistinguishable_from"]:
            typer.echo(f"    looks like {', '.join(effect['indistinguishable_from'])}")
    for joint, error in report["error"]["holdout"].items():
        typer.echo(
            f"  held-out error of {joint}: {error['before']:.4g} -> {error['after']:.4g} "
            f"{error['unit']} (floor {error['floor']:.4g})"
        )
    for joint, values in report["impedance"].items():
        k = values["stiffness"]
        typer.echo(f"  stiffness of {joint}: {k['before']:.4g} -> {k['after']:.4g} {k['unit']}")
    for joint, entry in report["unexplained"].items():
        typer.echo(
            f"  unexplained at {joint}: {entry['rms']:.3g} {entry['unit']}, depends on "
            f"{', '.join(entry['depends_on']) or 'nothing recorded'}"
        )
    for line in (*report["advice"], *report["warnings"]):
        typer.echo(f"  {line}")
    typer.echo(str(out / "report.html"))
