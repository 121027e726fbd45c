"""Commands about K_h with an interval: `interpret`, `bank build` and `bank show`."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from rehyb.banks import sample_on_fleet
from rehyb.cli.answers import Answer, Token, Url, answering
from rehyb.cli.close_loop import effect_study
from rehyb.cli.options import assignment, check_submitted, number, optional
from rehyb.client import Client, Json
from rehyb.client.close_loops import interpret_by_worker
from rehyb.errors import Invalid, RehybError, refusing
from rehyb.interpretation import bank_file, interpret_recording
from rehyb.own_files import check_own
from rehyb.whole_files import whole_file

app = typer.Typer(help="Banks of simulated recordings, which `rehyb interpret` reads.")

BankFile = Annotated[
    Path | None,
    optional(
        metavar="FILE.npz",
        help="The bank. Default: REHYB_BANK, else one in the user's data folder.",
    ),
]


@answering
def interpret(
    recording: Annotated[
        Path,
        typer.Argument(
            metavar="RECORDING",
            help="File of `rehyb assess --record`, or a measured session (folder or zip).",
        ),
    ],
    known: Annotated[
        list[str] | None,
        optional(
            metavar="NAME=VALUE:SD",
            help="What was measured on the patient, with its standard deviation; repeat.",
        ),
    ] = None,
    tolerance: Annotated[
        float | None, optional(help="Half width of K's 90 % interval that is wanted, Nm/rad.")
    ] = None,
    bank: BankFile = None,
    out: Annotated[Path | None, optional(metavar="FILE.html", help="Write a report, too.")] = None,
    submit: Annotated[
        bool, typer.Option("--submit", help="Have a worker of the coordinator do it: of a session.")
    ] = False,
    url: Url = None,
    token: Token = None,
    as_json: bool = False,
) -> None:
    """Say K_h and D_h with intervals, what they rest on, and what to measure next.

    Exit status 2 if the recording cannot be used.
    """
    if out is not None and out.suffix not in (".html", ".htm"):
        raise Invalid(f"--out writes a page: name it .html, not {out.name}")
    if out is not None:
        check_own(out, "page")
    measured = [_known(text) for text in known or ()]
    check_submitted(submit, url, token)

    def answered(found: Json) -> None:
        Answer(found, "\n".join(_lines(found))).show(as_json)

    if submit:
        if bank is not None:
            raise Invalid("--bank is this machine's: with --submit the worker's own counts")
        with Client(url, token) as client:
            interpret_by_worker(
                client,
                recording,
                known=measured,
                tolerance=tolerance,
                report=out,
                progress=lambda stage: typer.echo(stage, err=True),
                answered=answered,
            )
    else:
        interpret_recording(
            recording, bank, known=measured, tolerance=tolerance, report=out, answered=answered
        )
    if out is not None and not as_json:
        typer.echo(str(out))


def _known(text: str) -> tuple[str, float, float]:
    name, measured = assignment(text)
    value, colon, sd = measured.partition(":")
    if not colon:
        raise typer.BadParameter(
            f"{text!r} is not of the form name=value:sd; say how well it was measured"
        )
    return name, number(value, name), number(sd, f"the standard deviation of {name}")


def _lines(found: Json) -> Iterator[str]:
    """Yield an answer, line by line."""
    for name in ("stiffness", "damping"):
        entry = found[name]
        (low50, high50), (low90, high90) = entry["interval50"], entry["interval90"]
        yield (
            f"{name:10} {entry['median']:6.2f} {entry['unit']}, "
            f"50 %: {low50:.2f} to {high50:.2f}, 90 %: {low90:.2f} to {high90:.2f}"
        )
    for entry in found["stiffness_over_angle"]:
        low90, high90 = entry["interval90"]
        share = f"{100 * entry['share_of_travel']:.0f} %"
        yield f"  at {share:5} of the travel {entry['median']:6.2f}, {low90:.2f} to {high90:.2f}"
    if by_sets := found["if_muscles_of_bank"]:
        entry = by_sets["stiffness"]
        low90, high90 = entry["interval90"]
        yield "all this whatever the limb's muscles are; if they are one of the bank's sets:"
        yield f"  stiffness {entry['median']:.2f}, 90 %: {low90:.2f} to {high90:.2f}"
    else:
        yield "all this only if the limb's muscles are those of the bank"
    if not found["familiar"]:
        yield f"not familiar: {found['why_not']}"
    shares = [part for part in found["parts"] if part["share"] >= 0.05]
    if shares:
        listed = ", ".join(f"{part['name']} {100 * part['share']:.0f} %" for part in shares)
        yield f"the interval is made of: {listed}"
    for step in found["next"][:3]:
        yield (
            f"  {step['do']} ({step['minutes']:g} min): "
            f"half width {found['half_width']:.2f} -> {step['half_width_after']:.2f}"
        )
    yield from _tolerance(found)
    yield from found["advice"]


def _tolerance(found: Json) -> Iterator[str]:
    asked = found["tolerance"]
    if asked is None:
        return
    wanted = f"{asked['value']:g} Nm/rad"
    if asked["inside"]:
        yield f"inside {wanted}: the half width is {found['half_width']:.2f}"
    elif asked["plan"]:
        names = ", ".join(step["factor"] for step in asked["plan"]["steps"])
        width = asked["plan"]["half_width_after"]
        yield f"{wanted} in {asked['plan']['minutes']:g} min: measure {names} (then {width:.2f})"
    elif "all_steps" in asked:
        yield f"no plan reaches {wanted}: everything measured leaves {asked['all_steps']:.2f}"
    else:
        yield f"no plan for {wanted}: {asked['why_no_plan']}"


@app.command()
@answering
def build(
    rows: Annotated[int, typer.Option(min=1, help="Wearers without contact, in all.")] = 4096,
    contact_rows: Annotated[
        int,
        typer.Option(
            min=0, help="Wearers with contact, in all: what bushings get wrong. 0, or 60 and more."
        ),
    ] = 256,
    population: Annotated[
        Path | None, optional(metavar="FILE.json", help="Who may come. Default: rehyb's own.")
    ] = None,
    with_effect: Annotated[
        Path | None,
        optional(
            metavar="REPORT", help="report.json of `rehyb close-loop`: everybody has what it found."
        ),
    ] = None,
    seed: Annotated[
        int | None, optional(min=0, max=2**63, help="Seed of the draw. Default: 1.")
    ] = None,
    processes: Annotated[
        int | None, optional(min=1, help="Simulations at a time. Default: this machine's cores.")
    ] = None,
    out: BankFile = None,
    extend: Annotated[
        bool, typer.Option("--extend", help="Keep the rows that the file has already.")
    ] = False,
    submit: Annotated[
        bool,
        typer.Option(
            "--submit",
            help="Have the coordinator's workers simulate. Again, with more rows, it goes on.",
        ),
    ] = False,
    url: Url = None,
    token: Token = None,
) -> Answer:
    """Simulate a population's recordings and learn from them, into one file.

    The file is written at the end: interrupted, it stays as it was, and what was simulated is lost
    unless workers did it (--submit).
    """
    if submit and (extend or processes is not None):
        raise Invalid(
            "with --submit workers simulate and the studies keep the rows: leave --extend and "
            "--processes out"
        )
    check_submitted(submit, url, token)
    if find_spec("sklearn") is None:
        raise RehybError("to learn takes scikit-learn: pip install 'rehyb[interpret]'")
    from analysis.interpretation.bank.bank import load_bank
    from analysis.interpretation.bank.population import (
        default_population,
        read_population,
        with_effects,
    )
    from analysis.interpretation.build import describe, empty_bank, grow, learnt
    from analysis.interpretation.errors import InterpretationError

    path = bank_file(out)
    check_own(path, "bank")
    if out is None:
        path.parent.mkdir(parents=True, exist_ok=True)
    # What keeps the file from being written is said before anything is simulated.
    with whole_file(path) as partial, refusing(InterpretationError):
        if extend:
            if population is not None or with_effect is not None or seed is not None:
                raise Invalid(
                    "--extend keeps the bank's own population and seed: leave --population, "
                    "--with-effect and --seed out"
                )
            bank = load_bank(path)
        else:
            people = default_population() if population is None else read_population(population)
            if with_effect is not None:
                found = effect_study(
                    with_effect, model="elbow_recording", method="saltelli", rows=1
                )
                people = with_effects(people, found, str(with_effect))
            bank = empty_bank(people, 1 if seed is None else seed)
        with _bars() as show:
            if submit:
                with Client(url, token) as client:
                    bank = sample_on_fleet(
                        client, bank, rows=rows, contact_rows=contact_rows, progress=show
                    )
                bank = learnt(bank, show)
            else:
                bank = grow(
                    bank,
                    rows=rows,
                    contact_rows=contact_rows,
                    processes=processes or os.cpu_count() or 1,
                    progress=show,
                )
        bank.save(partial)
    content = describe(bank) | {"file": str(path)}
    failed = sum((*bank.bushing.failed.values(), *bank.contact.failed.values()))
    text = (
        f"{path}: bank {bank.id}, {len(bank.bushing)} recordings without and "
        f"{len(bank.contact)} with contact; {failed} assessments failed"
    )
    return Answer(content, text)


@app.command()
@answering
def show(bank: BankFile = None) -> Answer:
    """Say what a bank holds."""
    from analysis.interpretation.bank.bank import load_bank
    from analysis.interpretation.build import describe
    from analysis.interpretation.errors import InterpretationError

    with refusing(InterpretationError):
        content = describe(load_bank(bank_file(bank)))
    return Answer(content, "\n".join(f"{name:12} {value}" for name, value in content.items()))


@contextmanager
def _bars() -> Iterator[Callable[[str, int, int], None]]:
    """Yield what shows a bar for each thing that is done, on a terminal's error stream."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TimeRemainingColumn

    columns = ("{task.description}", BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    tasks: dict[str, TaskID] = {}
    with Progress(*columns, console=Console(stderr=True), disable=not sys.stderr.isatty()) as shown:

        def show(what: str, done: int, total: int) -> None:
            if what not in tasks:
                tasks[what] = shown.add_task(what, total=total)
            shown.update(tasks[what], completed=done)

        yield show
