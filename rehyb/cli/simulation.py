"""Commands that simulate here and now: `assess` and `validate`."""

import json
import sys
import time
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from rehyb.cli.options import AsJson, assignment, number, print_json
from rehyb.errors import RehybError


def assess(
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="FACTOR=VALUE",
            help="A factor that is not nominal, in SI units; repeat.",
            show_default=False,
        ),
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(metavar="FILE.npz", help="Save the recorded motion.", show_default=False),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(metavar="FILE.png", help="Draw the assessment.", show_default=False),
    ] = None,
    video: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.mp4", help="Film the assessment (.mp4 or .gif).", show_default=False
        ),
    ] = None,
    replay: Annotated[
        str | None,
        typer.Option(
            metavar="FILE.json",
            help="Repeat an instance of a study, from `rehyb study instance`; - reads stdin.",
            show_default=False,
        ),
    ] = None,
    controller: Annotated[
        str, typer.Option(help="pid: as in the authors' code. pd: equation 19 to the letter.")
    ] = "pid",
    fidelity: Annotated[
        str, typer.Option(help="How finely the interface is divided: screening to reference.")
    ] = "campaign",
    target: Annotated[
        str, typer.Option(help="elbow, shoulder_flexion, shoulder_abduction or shoulder_rotation.")
    ] = "elbow",
    device: Annotated[
        str, typer.Option(help="nesm, elbow_orthosis or an MJCF file (docs/devices.md).")
    ] = "nesm",
    as_json: AsJson = False,
) -> None:
    """Simulate one stiffness assessment of the elbow or the shoulder.

    Exit status 1 if the assessment fails: the simulated exercise, that is, not the command.
    """
    from sim.assessment.assess import assess as simulate
    from sim.models import ELBOW
    from sim.parameters.effects import EFFECT_FACTORS

    values = {factor.name: factor.nominal for factor in ELBOW.factors}
    effects = {factor.name for factor in EFFECT_FACTORS}
    if replay is not None:
        parameters, target, fidelity, device = _replayed(replay)
        values.update(parameters)
    for name, value in map(assignment, settings or ()):
        if name not in values and name not in effects:
            raise typer.BadParameter(
                f"there is no factor {name!r}: take {', '.join(values)} or effect.NAME.PARAMETER"
            )
        values[name] = number(value, name)
    watch = None
    try:
        if video is not None:
            from sim.pictures.film import Film, check_format

            check_format(video)
            film = Film()
            watch = film.watch
        started = time.perf_counter()
        assessment = simulate(
            values,
            controller=controller,
            fidelity=fidelity,
            target=target,
            device=device,
            watch=watch,
        )
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None
    wall_seconds = time.perf_counter() - started
    if video is not None:
        _film(film, video, assessment.outcome)
    if assessment.record is None:
        if record is not None or plot is not None:
            print("there is nothing to save or to draw: no motion was recorded", file=sys.stderr)
        record = plot = None
    else:
        if record is not None:
            assessment.record.save(record)
        if plot is not None:
            from sim.pictures.figures import assessment_figure

            assessment_figure(assessment, plot)
    if as_json:
        print_json(
            {
                "outcome": assessment.outcome,
                **assessment.outputs,
                "wall_seconds": wall_seconds,
                "reason": assessment.reason,
                "parameters": values,
                "diagnostics": dict(assessment.diagnostics),
                "state": assessment.state,
            }
        )
    else:
        _print_assessment(assessment.outcome, assessment.reason, assessment.outputs)
        for path in (record, plot, video):
            if path is not None:
                typer.echo(str(path))
    if assessment.outcome != "ok":
        raise typer.Exit(1)


def validate(
    out: Annotated[Path, typer.Option(help="Folder for the pictures.")] = Path("validation"),
    as_json: AsJson = False,
) -> None:
    """Repeat the paper's validation experiments and say what agrees with its figures."""
    from sim.validation import validate as repeat

    report = repeat(out)
    if as_json:
        print_json(
            {
                "rows": [asdict(row) for row in report.rows],
                "pictures": [str(picture) for picture in report.pictures],
            }
        )
    else:
        _print_validation(report)


def _replayed(source: str) -> tuple[dict[str, float], str, str, str]:
    """Return parameters, target, fidelity and device of a replay bundle of an assessment."""
    from sim.models import ASSESSMENTS

    try:
        bundle = json.loads(sys.stdin.read() if source == "-" else Path(source).read_text())
    except OSError as error:
        raise typer.BadParameter(f"{source} cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise typer.BadParameter(f"{source} is not JSON: {error}") from None
    if not isinstance(bundle, dict) or not isinstance(bundle.get("parameters"), dict):
        raise typer.BadParameter(f"{source} is no replay bundle: it has no parameters")
    if bundle.get("model") not in ASSESSMENTS:
        raise typer.BadParameter(
            f"{source} is of model {bundle.get('model')!r}, which is no assessment: "
            f"take one of {', '.join(ASSESSMENTS)}"
        )
    _, target, fidelity, device = ASSESSMENTS[bundle["model"]]
    parameters = {name: number(str(value), name) for name, value in bundle["parameters"].items()}
    return parameters, target, fidelity, device


def _film(film: Any, path: Path, outcome: str) -> None:
    """Write a film; if nothing renders here, that is one sentence and exit status 1."""
    from sim.pictures.rendering import GraphicsError

    try:
        film.write(path, outcome)
    except GraphicsError as error:
        raise RehybError(str(error)) from None


def _print_assessment(outcome: str, reason: str, outputs: Mapping[str, float]) -> None:
    typer.echo(outcome if outcome == "ok" else f"{outcome}: {reason}")
    from sim.models import ELBOW

    for name, value in outputs.items():
        typer.echo(f"  {name:28} {value: 9.4f} {ELBOW.units[name]}")


def _print_validation(report: Any) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    table = Table("quantity", "measured", "expected", "unit", "", box=SIMPLE_HEAD, pad_edge=False)
    for row in report.rows:
        table.add_row(
            row.quantity,
            _text(row.measured),
            _text(row.expected),
            row.unit,
            "agrees" if row.agrees else "differs",
        )
    console = Console(soft_wrap=True)
    console.print(table)
    for picture in report.pictures:
        console.print(str(picture))


def _text(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
