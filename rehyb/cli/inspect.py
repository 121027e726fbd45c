"""The command that looks at a log before any session exists: `inspect`."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rehyb.cli.answers import Answer, answering, print_rows
from rehyb.cli.options import optional
from rehyb.client import Json
from rehyb.errors import needs_extra, refusing

if TYPE_CHECKING:
    from analysis.closeloop.logs.belief import Belief


@answering
def inspect(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="CSV, .mat, .npz, .json, HDF5, .bag, .mcap, .db3, or the folder of a ROS 2 bag.",
        ),
    ],
    said: Annotated[
        list[str] | None,
        optional(
            "--as",
            metavar="CHANNEL=JOINT.QUANTITY*SCALE",
            help="What you know better, as 'column 14=elbow.effort*11.976'; repeat.",
        ),
    ] = None,
    rate: Annotated[
        float | None,
        optional(
            metavar="HZ", min=1e-3, max=1e6, help="Samples a second of a log without a clock."
        ),
    ] = None,
    out: Annotated[Path | None, optional(metavar="DIR", help="Write a first session here.")] = None,
    model: Annotated[
        Path | None, optional(metavar="FILE", help="The robot's MJCF or URDF, for the session.")
    ] = None,
) -> Answer:
    """List the channels of a robot's log with what they seem to be, and write a first session.

    Exit status 2 if the log, or the model, cannot be read; then nothing is written.
    """
    from analysis.closeloop.errors import SessionError
    from analysis.closeloop.logs.assignment import AS_SAID, assigned, of_factors
    from analysis.closeloop.logs.blocks import of_either
    from analysis.closeloop.logs.draft import of_currents, of_magnitudes, write_session
    from analysis.closeloop.logs.inspection import (
        believe,
        of_hertz,
        of_no_joint,
        of_rates,
        of_turns,
    )
    from analysis.closeloop.logs.joints import (
        joints_in,
        of_only_joint,
        of_order,
        of_other_joints,
        of_parted_joints,
    )
    from analysis.closeloop.logs.reading import read_log
    from analysis.closeloop.logs.variants import of_followed, of_variants
    from analysis.closeloop.session.mjcf import check_model

    try:
        with needs_extra(file.name, "logs"), refusing(SessionError):
            if model:
                check_model(model)
            log = read_log(file)
            known = joints_in(model) if model else []
            believed = believe(log, rate, known)
            beliefs, joints = assigned(believed, said or (), known)
            there = sorted({b.joint for b in beliefs if b.joint is not None})
            left = write_session(out, file.stem, beliefs, joints, model) if out else []
            left += of_currents(beliefs, joints)
            left += of_other_joints([joints[number] for number in there], known)
            left += of_parted_joints(beliefs, joints) + of_magnitudes(beliefs)
            left += of_variants(beliefs) + of_followed(beliefs)
            left += (
                of_no_joint(beliefs) + of_either(beliefs) + of_hertz(beliefs) + of_turns(beliefs)
            )
            left += of_factors(believed, said or ())
            if not any(b.why == AS_SAID and b.joint is not None for b in beliefs):
                left += of_only_joint(beliefs, known) + of_order(beliefs, known)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None
    rows = [_row(belief, joints) for belief in beliefs]
    clocks = _clocks(beliefs)
    remarks = [*log.remarks, *([] if rate else of_rates(log, beliefs)), *left]
    return Answer(
        {"kind": log.kind, "clocks": clocks, "channels": rows, "remarks": remarks},
        lambda: _print(log.kind, clocks, rows, [*remarks, *([str(out)] if out else [])]),
    )


def _row(belief: "Belief", joints: list[str]) -> Json:
    """Return one line of the table."""
    import numpy as np

    values = belief.channel.values[np.isfinite(belief.channel.values)]
    return {
        "channel": belief.channel.name,
        "seems": f"{belief.quantity}{' (wanted)' if belief.wanted else ''}",
        "joint": "" if belief.joint is None else joints[belief.joint],
        "unit": belief.unit,
        "least": float(f"{values.min():.4g}") if len(values) else None,
        "most": float(f"{values.max():.4g}") if len(values) else None,
        "missing": len(belief.channel.values) - len(values),
        "why": belief.why,
    }


def _clocks(beliefs: "list[Belief]") -> list[Json]:
    """Return each clock of the log once, with how many samples go by it."""
    from analysis.closeloop.logs.clock import clock_of

    times = {
        b.channel.time.tobytes(): b.channel.time for b in beliefs if b.channel.time is not None
    }
    return [{"samples": len(time), **asdict(clock_of(time))} for time in times.values()]


def _print(kind: str, clocks: list[Json], rows: list[Json], lines: list[str]) -> None:
    typer.echo(f"{kind}, {len(rows)} channels")
    for clock in clocks:
        typer.echo(
            f"clock: {clock['samples']} samples at {clock['rate']:.4g} Hz, steps spread by "
            f"{clock['jitter']:.1%}, {clock['gaps']} gaps (longest step "
            f"{clock['longest_gap']:.3g} s), {clock['repeated']} stamps that do not increase"
            + (f", begins anew {clock['restarts']} times" if clock["restarts"] else "")
        )
    print_rows(("channel", "seems", "joint", "unit", "least", "most", "missing", "why"), rows)
    for line in lines:
        typer.echo(line)
