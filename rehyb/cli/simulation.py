"""Commands that simulate here and now: `assess` and `validate`."""

import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rehyb.cli.answers import Answer, answering
from rehyb.cli.options import assignments, factor_value, number, optional, read_json
from rehyb.errors import RehybError, check_pictures
from rehyb.own_files import check_own
from rehyb.whole_files import whole_file

if TYPE_CHECKING:
    from models.factors import Factor
    from sim.assessment.assess import Assessment
    from sim.pictures.film import Film


@answering
def assess(
    settings: Annotated[
        list[str] | None,
        optional(
            "--set",
            metavar="FACTOR=VALUE",
            help="A factor that is not nominal, in SI units; repeat.",
        ),
    ] = None,
    record: Annotated[
        Path | None, optional(metavar="FILE.npz", help="Save the recorded motion.")
    ] = None,
    plot: Annotated[Path | None, optional(metavar="FILE.png", help="Draw the assessment.")] = None,
    video: Annotated[
        Path | None, optional(metavar="FILE.mp4", help="Film the assessment (.mp4 or .gif).")
    ] = None,
    replay: Annotated[
        str | None,
        optional(
            metavar="FILE.json",
            help="Repeat an instance of a study, from `rehyb study instance`; - reads stdin.",
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
    outside_range: Annotated[
        bool, typer.Option("--outside-range", help="Allow values far outside a factor's range.")
    ] = False,
    device: Annotated[
        str,
        typer.Option(help="nesm, nesm_passive, elbow_orthosis or an MJCF file (docs/devices.md)."),
    ] = "nesm",
) -> Answer:
    """Simulate one stiffness assessment of the elbow or the shoulder.

    Exit status 1 if the assessment fails: the simulated exercise, that is, not the command.
    """
    from sim.assessment.assess import assess as simulate

    if plot is not None:
        check_pictures()
    for path, kind in ((record, "record"), (plot, "picture"), (video, "film")):
        if path is not None:
            check_own(path, kind)
    values, setting = _parameters(replay, settings or (), outside_range)
    setting = {"target": target, "fidelity": fidelity, "device": device} | setting
    try:
        film = None if video is None else _film(video)
        watch = None if film is None else film.watch
        started = time.perf_counter()
        assessment = simulate(values, controller=controller, watch=watch, **setting)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None
    wall_seconds = time.perf_counter() - started
    written = _written(assessment, record, plot, film, video)
    content = {
        "outcome": assessment.outcome,
        **assessment.outputs,
        "wall_seconds": wall_seconds,
        "reason": assessment.reason,
        "parameters": values,
        "diagnostics": dict(assessment.diagnostics),
        "state": assessment.state,
    }
    text = "\n".join(filter(None, [*_lines(assessment), *map(str, written)]))
    return Answer(content, text, status=0 if assessment.outcome == "ok" else 1)


@answering
def validate(
    out: Annotated[Path, typer.Option(help="Folder for page and pictures.")] = Path("validation"),
) -> Answer:
    """Repeat the paper's validation experiments and say what agrees with its figures."""
    from analysis.reports.validation import write_validation
    from sim.validation import validate as repeat

    check_pictures()
    check_own(out / "validation.html", "page")
    report = repeat(out)
    rows = [asdict(row) for row in report.rows]
    page = write_validation(out / "validation.html", rows, report.pictures)
    content = {
        "rows": rows,
        "page": str(page),
        "pictures": [str(picture) for picture in report.pictures],
    }
    return Answer(content, partial(_print_validation, report, page))


def _parameters(
    replay: str | None, settings: Sequence[str], outside_range: bool
) -> tuple[dict[str, float], dict[str, str]]:
    """Return every factor's value; and target, fidelity and device of what is repeated."""
    from models.factors import no_factor
    from sim.models import ELBOW
    from sim.parameters.effects import effect_factors

    values = {factor.name: factor.nominal for factor in ELBOW.factors}
    effects = {factor.name: factor for factor in effect_factors()}
    known = {factor.name: factor for factor in ELBOW.factors} | effects
    setting: dict[str, str] = {}
    if replay is not None:
        parameters, setting = _replayed(replay)
        values.update(parameters)
    for name, value in assignments(settings).items():
        if name not in known:
            raise typer.BadParameter(
                no_factor("an assessment", name, (*values, "effect.NAME.PARAMETER"))
            )
        given = factor_value(known[name], value)
        anywhere = outside_range or name in effects
        values[name] = given if anywhere else _in_reach(known[name], given)
    return values, setting


def _in_reach(factor: "Factor", value: float) -> float:
    """Return `value`; typer.BadParameter if the simulation was never validated near it."""
    try:
        factor.check_reach(value)
    except ValueError as error:
        raise typer.BadParameter(f"{error}, or ask for it with --outside-range") from None
    return value


def _replayed(source: str) -> tuple[dict[str, float], dict[str, str]]:
    """Return parameters, and target, fidelity and device, of a replay bundle of an assessment."""
    from sim.models import ASSESSMENTS

    bundle = read_json(source)
    if not isinstance(bundle, dict) or not isinstance(bundle.get("parameters"), dict):
        raise typer.BadParameter(f"{source} is no replay bundle: it has no parameters")
    if bundle.get("model") not in ASSESSMENTS:
        raise typer.BadParameter(
            f"{source} is of model {bundle.get('model')!r}, which is no assessment: "
            f"take one of {', '.join(ASSESSMENTS)}"
        )
    parameters = {name: number(str(value), name) for name, value in bundle["parameters"].items()}
    return parameters, ASSESSMENTS[bundle["model"]].setting


def _film(path: Path) -> "Film":
    """Return a film to be taken; ValueError if `path` has no format of films."""
    from sim.pictures.film import Film, check_format

    check_format(path)
    return Film()


def _written(
    assessment: "Assessment",
    record: Path | None,
    plot: Path | None,
    film: "Film | None",
    video: Path | None,
) -> list[Path]:
    """Write what is wanted of an assessment, and return the files.

    Raises:
        RehybError: nothing renders here.
    """
    if film is not None and video is not None:
        from sim.pictures.rendering import GraphicsError

        try:
            film.write(video, assessment.outcome)
        except GraphicsError as error:
            raise RehybError(str(error)) from None
    if assessment.record is None:
        if record is not None or plot is not None:
            print("there is nothing to save or to draw: no motion was recorded", file=sys.stderr)
        record = plot = None
    if assessment.record is not None and record is not None:
        with whole_file(record) as fresh:
            assessment.record.save(fresh)
    if plot is not None:
        from sim.pictures.figures import assessment_figure

        assessment_figure(assessment, plot)
    return [path for path in (record, plot, video) if path is not None]


def _lines(assessment: "Assessment") -> Iterator[str]:
    from analysis.sensitivity.remarks import no_single_stiffness
    from sim.models import ELBOW

    outcome = assessment.outcome
    yield outcome if outcome == "ok" else f"{outcome}: {assessment.reason}"
    for name, value in assessment.outputs.items():
        unit = ELBOW.units[name].removesuffix("1")
        yield f"  {name:28} {value: 9.4f} {unit}".rstrip()
    if assessment.outputs:
        yield no_single_stiffness(assessment.outputs["stiffness_true_r2"])


def _print_validation(report: Any, page: Path) -> None:
    from rehyb.display import plain_table, whole_console

    table = plain_table("quantity", "measured", "expected", "unit", "")
    for row in report.rows:
        table.add_row(
            row.quantity,
            _text(row.measured),
            _text(row.expected),
            row.unit,
            "agrees" if row.agrees else "differs",
        )
    console = whole_console()
    console.print(table)
    for file in (page, *report.pictures):
        console.print(str(file))


def _text(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
