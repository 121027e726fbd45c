"""A first session from a log: the contract's columns in SI units, and a `session.json`."""

import csv
import json
import shutil
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np

from analysis.closeloop.errors import SessionError
from analysis.closeloop.logs.assignment import AS_SAID
from analysis.closeloop.logs.belief import SIGNALS, Belief
from analysis.closeloop.logs.clock import how_to_say_the_clock, stretches
from analysis.closeloop.logs.joints import joint_name, joints_in
from analysis.closeloop.logs.log import Numbers
from analysis.closeloop.logs.streams import on_one_clock
from analysis.closeloop.magnitudes import SAID, are_magnitudes
from analysis.closeloop.unit_names import UNITS
from intake.words import counted
from intake.xml import all_listed, listed

#: What signals without any unit are taken for.
WITHOUT_UNIT = {
    "position": "rad",
    "velocity": "rad/s or m/s",
    "acceleration": "rad/s2 or m/s2",
    "effort": "Nm or N",
}


def of_currents(beliefs: Sequence[Belief], joints: Sequence[str]) -> list[str]:
    """Say how to make a torque of each current that stands for the effort of its joint."""
    said: dict[int, str] = {}
    efforts = {b.joint for b in beliefs if b.quantity == "effort" and not b.wanted}
    for belief in beliefs:
        if belief.quantity != "current" or belief.wanted or belief.joint in {None, *efforts}:
            continue
        assert belief.joint is not None
        name, unit = belief.channel.name, belief.unit if belief.unit in UNITS else "A"
        said.setdefault(
            belief.joint,
            f"{name} is a current: say --as '{name}={joints[belief.joint]}.effort*NM_PER_{unit}', "
            "with the motor's torque constant times its gear's ratio for the factor; without it a "
            "current of 1 A is taken for 1 Nm, and no torque, mass or stiffness found is right",
        )
    return [*said.values()]


def of_magnitudes(beliefs: Sequence[Belief]) -> list[str]:
    """Say of efforts, or of the currents in their place, that they lack their sign."""
    having: dict[str, dict[int, Numbers]] = {"position": {}, "effort": {}}
    for belief in sorted(beliefs, key=lambda belief: belief.quantity == "current"):
        quantity = "effort" if belief.quantity == "current" else belief.quantity
        if quantity in having and belief.joint is not None and not belief.wanted:
            having[quantity].setdefault(belief.joint, belief.channel.values)
    efforts = having["effort"]
    joints = {
        str(joint): [(position, efforts[joint])]
        for joint, position in having["position"].items()
        if joint in efforts and len(position) == len(efforts[joint])
    }
    return [SAID] if are_magnitudes(joints) else []


def write_session(
    folder: Path,
    stem: str,
    beliefs: Sequence[Belief],
    joints: Sequence[str],
    model: Path | None = None,
) -> list[str]:
    """Write `session.json` and one CSV file in the contract's columns to a new or empty folder.

    Samples that miss a number or repeat a stamp are left out.

    Args:
        folder: made if it is not there.
        joints: names by the beliefs' joint numbers.
        model: the robot's MJCF or URDF, copied; None writes the name `robot.xml` for one to come.
            Joints of it that the log does not show are ignored in the session.

    Returns:
        What is left to settle, in sentences.

    Raises:
        SessionError: the log has no clock, position or effort, or the folder holds files.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise SessionError("is not an empty folder", file=str(folder))
    taken: dict[str, Belief] = {}
    others: dict[str, list[str]] = {}
    # A current stands for an effort only where there is none, and what was said goes before all.
    ranked = sorted(beliefs, key=lambda belief: belief.quantity == "current")
    for belief in sorted(ranked, key=lambda belief: belief.why != AS_SAID):
        quantity = "effort" if belief.quantity == "current" else belief.quantity
        if quantity in SIGNALS and not belief.wanted and belief.joint is not None:
            name = f"{joints[belief.joint]}.{quantity}"
            if taken.setdefault(name, belief) is not belief:
                others.setdefault(name, []).append(belief.channel.name)
    places = {id(belief): place for place, belief in enumerate(ranked)}
    taken = dict(sorted(taken.items(), key=lambda item: places[id(item[1])]))
    taken, of_others = _of_the_model(taken, joints_in(model) if model else [])
    for quantity in ("position", "effort"):
        if not any(name.endswith(f".{quantity}") for name in taken):
            channels = _moving(beliefs)
            why = (
                f"no {quantity} is known among {all_listed(channels)}: name its channel, as in "
                f"--as 'CHANNEL=elbow.{quantity}*FACTOR_TO_SI'"
                if channels
                else "no column beside the clock holds numbers that change: `rehyb inspect` "
                "without --out says what the others hold"
            )
            raise SessionError(why, file=stem)
    position = next(b for name, b in taken.items() if name.endswith(".position"))
    time = position.channel.time
    if time is None:
        raise SessionError(f"no clock is known: {how_to_say_the_clock(beliefs)}", file=stem)
    remarks = of_others + [
        f"{taken[name].channel.name} is taken for {name}, and not {' or '.join(channels)}: for "
        f"another say --as '{channels[0]}={name}'"
        for name, channels in others.items()
        if name in taken
    ]
    efforts = [(name, b.channel.name) for name, b in taken.items() if name.endswith(".effort")]
    taken, of_streams = on_one_clock(taken)
    if not any(name in taken for name, _ in efforts):
        joint = next(name for name in taken if name.endswith(".position")).removesuffix(".position")
        raise SessionError(
            f"no effort is left: {'; '.join(of_streams)}; if one is of a joint with a position, "
            f"say which, as by --as '{efforts[0][1]}={joint}.effort*FACTOR_TO_SI'",
            file=stem,
        )
    remarks += of_streams
    remarks += _of_unsure(taken)
    time = next(iter(taken.values())).channel.time
    assert time is not None
    table = np.column_stack([time, *(b.scale * b.channel.values for b in taken.values())])
    whole = np.asarray(np.isfinite(table).all(axis=1))
    if not whole.any():
        raise SessionError(
            f"no sample has a number in each of {listed(b.channel.name for b in taken.values())}: "
            "leave out what is no signal of a joint, by --as 'CHANNEL=-', or interpolate them on "
            "one clock",
            file=stem,
        )
    if not whole.all():
        said = counted(
            int(np.sum(~whole)), "sample without a number was", "samples without a number were"
        )
        remarks.append(f"{said} left out")
    begins = {int(whole[:at].sum()): name for name, at in position.channel.trials}
    parts, repeated, restarts = _parts(table[whole], begins)
    if repeated:
        said = counted(
            repeated, "sample that repeats a stamp was", "samples that repeat a stamp were"
        )
        remarks.append(f"{said} left out")
    if restarts:
        remarks.append(
            f"the clock begins anew {counted(restarts, 'time', 'times')}: each part is a trial, "
            "and begins 1 s after the one before"
        )
    folder.mkdir(parents=True, exist_ok=True)
    files = [f"{stem}.csv" if len(parts) == 1 else f"{stem}_{n + 1}.csv" for n in range(len(parts))]
    trials = [
        {"file": file, **({"label": label} if label else {})}
        for file, (label, _) in zip(files, parts, strict=True)
    ]
    for name, (_, part) in zip(files, parts, strict=True):
        with (folder / name).open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["time", *taken])
            # A clock that counts from 1970 needs all its digits.
            writer.writerows(
                [[repr(float(row[0])), *(f"{x:.9g}" for x in row[1:])] for row in part]
            )
    name = model.name if model else "robot.xml"
    if model is not None:
        shutil.copyfile(model, folder / name)
    else:
        remarks.append(f"put the robot's MJCF or URDF into the folder as {name}")
    session: dict[str, object] = {"schema": 1, "model": name, "trials": trials}
    if model is not None and (ignored := _not_recorded(taken, joints_in(model))):
        session["ignored_joints"] = ignored
        remarks.append(
            f"the log has no position of {listed(ignored)}: they are in ignored_joints of "
            "session.json, and taken to stand still"
        )
    (folder / "session.json").write_text(json.dumps(session, indent=2) + "\n")
    return remarks


def _of_the_model(
    taken: Mapping[str, Belief], known: Sequence[str]
) -> tuple[dict[str, Belief], list[str]]:
    """Return the signals that may be of a model's joints, and say which others there are.

    What the log does not name is of none once joints of the model are recorded; what it does may be
    one that has another name there, unless they all are.
    """
    recorded = {name.removesuffix(".position") for name in taken if name.endswith(".position")}
    called = {
        name.rpartition(".")[0] for name, b in taken.items() if b.why == AS_SAID or joint_name(b)
    }
    may_be = {*known} if recorded >= {*known} else {*known, *called}
    if not recorded & {*known}:
        return dict(taken), []
    found = {name: b for name, b in taken.items() if name.rpartition(".")[0] in may_be}
    others = [b.channel.name for name, b in taken.items() if name not in found]
    said = f"{all_listed(others)}: of no joint of the model, and left out"
    return found, [said] if others else []


def _moving(beliefs: Sequence[Belief]) -> list[str]:
    """Return the channels that may be signals of a joint, those first of which nothing is known."""
    numbers = [b for b in beliefs if b.quantity != "time" and len(_finite(b)) > 1]
    moving = [b for b in numbers if np.ptp(_finite(b)) > 0.0]
    known = (*SIGNALS, "current")
    return [b.channel.name for b in sorted(moving, key=lambda b: b.wanted or b.quantity in known)]


def _finite(belief: Belief) -> Numbers:
    return belief.channel.values[np.isfinite(belief.channel.values)]


def _not_recorded(taken: Collection[str], known: Sequence[str]) -> list[str]:
    """Return the joints of a model without a position among the signals `taken`.

    None where one of those is of no joint that is known: it may be any of them.
    """
    recorded = {
        joint
        for joint, _, signal in (name.rpartition(".") for name in taken)
        if signal == SIGNALS[0]
    }
    if not recorded <= set(known):
        return []
    return [joint for joint in known if joint not in recorded]


def _of_unsure(taken: Mapping[str, Belief]) -> list[str]:
    """Say in which unit signals whose unit nobody wrote are taken, those of one unit at once."""
    unsure: dict[tuple[str, str], list[str]] = {}
    for name, belief in taken.items():
        if belief.unit.endswith("?"):
            quantity = name.rpartition(".")[2]
            unit = belief.unit.rstrip("?") or WITHOUT_UNIT[quantity]
            unsure.setdefault((quantity, unit), []).append(name)
    remarks = []
    for (quantity, unit), names in unsure.items():
        channels = [taken[name].channel.name for name in names]
        what = (
            f"{names[0]} in {unit}; if it" if len(names) == 1 else f"{quantity} in {unit}; if one"
        )
        remarks.append(
            f"{listed(channels)} {'is' if len(names) == 1 else 'are'} taken for {what} is not, say "
            f"--as '{channels[0]}={names[0]}*FACTOR_TO_SI'"
        )
    return remarks


def _parts(table: Numbers, begins: Mapping[int, str]) -> tuple[list[tuple[str, Numbers]], int, int]:
    """Return the trials of a table with what the log calls each, "" if nothing.

    A trial begins where one does in the log (`begins`), and where the clock begins anew. Such
    trials are shifted, so that the clock of the session goes on. Stamps that repeat are left out:
    after the trials come how many they are, and how often the clock begins anew.
    """
    parts, repeated, restarts, end, label = [], 0, 0, -np.inf, ""
    for samples in stretches(table[:, 0], [*begins]):
        label = begins.get(samples.start, label)
        part = table[samples]
        highest = np.maximum.accumulate(part[:, 0])
        later = np.concatenate([[True], part[1:, 0] > highest[:-1]])
        repeated += int(np.sum(~later))
        part = part[later]
        if part[0, 0] <= end:
            part[:, 0] += end + 1.0 - part[0, 0]
            restarts += 1
        end = part[-1, 0]
        parts.append((label, part))
    return parts, repeated, restarts
