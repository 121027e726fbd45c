"""The command that closes the loop with measured data: `close-loop`."""

import json
import re
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from rehyb.cli.answers import Answer, Token, Url, answering, study_submitted
from rehyb.cli.options import check_submitted, optional
from rehyb.cli.study.size import Yes, check_study
from rehyb.client import Client, Json
from rehyb.client.close_loops import close_loop_by_worker
from rehyb.errors import Invalid, check_pictures, refusing
from rehyb.own_files import check_own, check_own_files
from rehyb.whole_files import write_json

#: Time before stages are told where nobody may be looking, s.
QUIET = 5.0
#: Share of an error's power above its noise that is most of it.
MOST = 0.5
#: What `study of-session --out` writes.
MODEL_FILES = ("model.toml", "robot.xml", "path.csv")


@answering
def close_loop(
    session: Annotated[
        Path,
        typer.Argument(metavar="SESSION", help="Folder with session.json and trials, or its zip."),
    ],
    out: Annotated[Path, typer.Option(help="Folder for report, repaired model and residuals.")],
    submit: Annotated[
        bool, typer.Option("--submit", help="Have a worker of the coordinator do it.")
    ] = False,
    url: Url = None,
    token: Token = None,
) -> Answer:
    """Trace the residual of measured trials to an effect the declared model lacks, and add it.

    Exit status 2 if the session cannot be analysed; then nothing is written.
    """
    check_submitted(submit, url, token)
    _check_folder(out)
    with naming_older(out):
        if submit:
            with Client(url, token) as client:
                report = close_loop_by_worker(client, session, out, _showing())
        else:
            report = _close_here(session, out)
    return Answer(report, "\n".join(_lines(report, out)))


def _check_folder(out: Path) -> None:
    """Raise Invalid unless what a report replaces in `out` is an earlier report."""
    from analysis.closeloop.contract import REPORT_FILES

    check_own_files(out, REPORT_FILES, by="report.json", kind="report")


@contextmanager
def naming_older(out: Path) -> Iterator[None]:
    """Within the block, what is refused says that a report in `out` is of an earlier call."""
    try:
        yield
    except Invalid as error:
        older = out / "report.json"
        if not older.exists():
            raise
        raise Invalid(f"{error}; nothing was written, and {older} is an older answer") from None


def _close_here(session: Path, out: Path) -> Json:
    check_pictures()
    from analysis.closeloop.errors import SessionError
    from analysis.closeloop.loop import close_loop as close
    from analysis.closeloop.session.archive import opened

    with refusing(SessionError), opened(session) as folder:
        return close(folder, out, _showing())


def _showing() -> Callable[[str], None]:
    """Return what says on standard error which stage begins.

    A file or a pipe gets what takes long alone, with the time, so that an error stays one line.
    """
    begin, last = time.monotonic(), ""

    def show(stage: str) -> None:
        nonlocal last
        seconds = time.monotonic() - begin
        if sys.stderr.isatty():
            print(f"rehyb: {stage}", file=sys.stderr)
        elif seconds >= QUIET and stage != last:
            print(f"rehyb: {stage}, after {seconds:.0f} s", file=sys.stderr, flush=True)
            last = stage

    return show


@answering
def with_effect(
    report: Annotated[
        Path, typer.Argument(metavar="REPORT", help="report.json of `rehyb close-loop`.")
    ],
    model: Annotated[
        str, typer.Option(help="elbow_effects, or elbow_bushing_effects for a quick look.")
    ] = "elbow_effects",
    method: Annotated[str, typer.Option(help="morris or saltelli.")] = "morris",
    rows: Annotated[int, typer.Option(min=1, help="Rows of the design.")] = 40,
    seed: Annotated[int, typer.Option(help="Seed of the design.")] = 1,
    from_none: Annotated[
        bool,
        typer.Option(
            "--from-none", help="Sample each effect from none to what was found, not its interval."
        ),
    ] = False,
    out: Annotated[
        Path | None, optional(metavar="FILE.json", help="Write the study instead of submitting.")
    ] = None,
    yes: Yes = False,
    url: Url = None,
    token: Token = None,
) -> Answer:
    """Submit a study in which a found effect's parameters are uncertain, beside Table 1's."""
    study = effect_study(
        report, model=model, method=method, rows=rows, seed=seed, from_none=from_none
    )
    if out is not None:
        check_own(out, "draft")
        write_json(out, study)
        return Answer({"file": str(out)}, f"{out}: submit it with rehyb study submit {out}")
    with Client(url, token) as client:
        check_study(client, study, yes)
        return study_submitted(client.submit(study))


def effect_study(report: Path, **design: Any) -> Json:
    """Return the study of the effects in a report.json; Invalid if there are none to be had."""
    from analysis.closeloop.report.effect_study import EffectStudyError, study_with_effects

    try:
        return study_with_effects(json.loads(report.read_text(encoding="utf-8")), **design)
    except (json.JSONDecodeError, UnicodeDecodeError):
        raise Invalid(f"{report} is not JSON") from None
    except EffectStudyError as error:
        raise Invalid(f"{report}: {error}") from None


@answering
def of_session(
    session: Annotated[Path, typer.Argument(metavar="SESSION", help="The session's folder.")],
    report: Annotated[
        Path, typer.Argument(metavar="REPORT", help="The folder that `rehyb close-loop` wrote.")
    ],
    method: Annotated[str, typer.Option(help="morris or saltelli.")] = "saltelli",
    rows: Annotated[int, typer.Option(min=1, help="Rows of the design.")] = 64,
    seed: Annotated[int, typer.Option(help="Seed of the design.")] = 1,
    name: Annotated[
        str | None, optional(help="What to call the model. Default: after the session's folder.")
    ] = None,
    out: Annotated[
        Path | None, optional(metavar="DIR", help="Write the model's folder instead of submitting.")
    ] = None,
    yes: Yes = False,
    url: Url = None,
    token: Token = None,
) -> Answer:
    """Submit a study of the repaired robot, in which what was found is uncertain as it was found.

    The robot follows a recorded trial; the outputs are the torques that its joints need for it.
    """
    from analysis.closeloop.as_model import NothingToSampleError, write_model
    from analysis.closeloop.errors import SessionError
    from analysis.closeloop.session.archive import opened
    from rehyb.cli.models import added

    called = name or re.sub(r"[^a-z0-9_]+", "_", session.resolve().stem.lower())[:40]
    with tempfile.TemporaryDirectory(prefix="rehyb-robot-") as scratch:
        folder = out or Path(scratch) / "robot"
        check_own_files(folder, MODEL_FILES, by="model.toml", kind="draft")
        try:
            with refusing(SessionError, NothingToSampleError), opened(session) as recorded:
                lacks = write_model(recorded, report, folder, called)
        except FileNotFoundError as error:
            raise Invalid(f"{error.filename}: there is no such file") from None
        except (ValueError, KeyError, TypeError) as error:
            raise Invalid(f"{report} is no report of `rehyb close-loop`: {error}") from None
        for sentence in lacks:
            print(f"left out: {sentence}", file=sys.stderr)
        if out is not None:
            return Answer(
                {"folder": str(out), "left_out": lacks},
                f"{out}: look at it with rehyb model check {out}",
            )
        with Client(url, token) as client:
            version = added(client, folder)
            study: Json = {"name": f"{called} as repaired", "model": version, "method": method}
            study |= {"rows": rows, "seed": seed}
            check_study(client, study, yes)
            return study_submitted(client.submit(study))


def _lines(report: Json, out: Path) -> Iterator[str]:
    """Yield what a report says, line by line."""
    yield report["verdict"]
    yield from _of_the_rest(report)
    for effect in report["effects"]:
        yield f"  {effect['name']} at {effect.get('where', effect['joint'])}"
        for name, entry in effect["parameters"].items():
            if entry["value"] is None:
                yield f"    {name:20} not determined"
                continue
            yield _sized(name, entry["value"], entry["ci90"], entry["unit"])
        if effect["indistinguishable_from"]:
            yield f"    looks like {', '.join(effect['indistinguishable_from'])}"
    for entry in report.get("declared", ()):
        yield from _of_declared(entry)
    if report["error"]["holdout"]:
        yield "  held-out error (root mean square; the model as declared -> as repaired)"
    for joint, error in report["error"]["holdout"].items():
        floor = "no floor" if error["floor"] is None else f"floor {error['floor']:.4g}"
        yield (
            f"    {joint}: {error['before']:.4g} -> {error['after']:.4g} {error['unit']} ({floor})"
        )
    for joint, values in report["impedance"].items():
        k = values["stiffness"]
        found = f"{k['before']:.4g} -> {k['after']:.4g} {k['unit']}"
        known = report["identified"].get(joint, {"stiffness": True})["stiffness"]
        yield f"  stiffness of {joint}: {found}{'' if known else ', not identified'}"
    for joint, entry in report["unexplained"].items():
        yield f"  unexplained at {joint}: {entry['rms']:.3g} {entry['unit']}"
        yield f"    rms of {entry['rms_of']}"
        yield f"    depends on {', '.join(entry['depends_on']) or 'nothing recorded'}"
    for line in (*report["advice"], *report["warnings"]):
        yield f"  {line}"
    yield str(out / "report.html")


def _of_the_rest(report: Json) -> Iterator[str]:
    """Yield a line for each joint of which the effects that were found leave most of the error."""
    if report["verdict"] != "effect_found":
        return
    for joint, error in report["error"]["holdout"].items():
        noise = (error["floor"] or 0.0) ** 2
        there, left = error["before"] ** 2 - noise, error["after"] ** 2 - noise
        if left > MOST * there > 0.0:
            share = min(left / there, 1.0)
            above = " above its noise" if noise else ""
            yield f"  most of the error of {joint} is left: {100 * share:.0f} % of its power{above}"


def _sized(label: str, value: float, interval: Sequence[float], unit: str) -> str:
    """Return a parameter's line; what has no dimension has no unit."""
    (low, high), said = interval, "" if unit == "1" else f" {unit}"
    return f"    {label:20} {value: 9.4g} [{low:.4g}, {high:.4g}]{said}"


def _of_declared(entry: Json) -> Iterator[str]:
    """Yield what was found of a declared effect or load, line by line."""
    called = f" {entry['name']}" if "name" in entry else ""
    yield f"  declared {entry['effect']}{called} at {entry.get('joint') or entry['body']}"
    for name, found in entry["parameters"].items():
        # A place has a value and an interval along each axis.
        parts = [(name, found["value"], found["ci90"])]
        if isinstance(found["value"], list):
            every = found["ci90"] or [None] * len(found["value"])
            axes = [f"{name}_{axis}" for axis in "xyz"]
            parts = [*zip(axes, found["value"], every, strict=True)]
        for label, value, interval in parts:
            if value is None:
                yield f"    {label:20} not determined"
                continue
            yield _sized(label, value, interval or (value, value), found["unit"])
