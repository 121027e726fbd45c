"""Every way in which a session can be bad, with words of the one error that it gets."""

import json
import shutil
from collections.abc import Callable
from math import pi
from pathlib import Path
from typing import Any

from tests.testbed.sessions.small import HEADER

Spoil = Callable[[Path], None]
HUGE = 'diaginertia="1e99 1e99 1e99"'


def csv_text(change: Callable[[str], str]) -> Spoil:
    def spoil(path: Path) -> None:
        (path / "a.csv").write_text(change((path / "a.csv").read_text()), newline="")

    return spoil


def csv_bytes(content: bytes) -> Spoil:
    return lambda path: (path / "a.csv").write_bytes(content) and None


def model(old: str, new: str) -> Spoil:
    def spoil(path: Path) -> None:
        text = (path / "device.xml").read_text()
        assert old in text
        (path / "device.xml").write_text(text.replace(old, new, 1))

    return spoil


def words(**changes: Any) -> Spoil:
    def spoil(path: Path) -> None:
        content = json.loads((path / "session.json").read_text()) | changes
        (path / "session.json").write_text(json.dumps(content))

    return spoil


def raw(content: bytes) -> Spoil:
    return lambda path: (path / "session.json").write_bytes(content) and None


def linked(name: str, target: str) -> Spoil:
    def spoil(path: Path) -> None:
        (path.parent / "outside").mkdir()
        for outside in ("secret.csv", "secret.xml", "secret.json"):
            (path.parent / "outside" / outside).write_text("secret")
        (path / name).unlink(missing_ok=True)
        (path / name).symlink_to(target)

    return spoil


def line_of(text: str, number: int, change: Callable[[list[str]], list[str]]) -> str:
    lines = text.split("\n")
    lines[number - 1] = ",".join(change(lines[number - 1].split(",")))
    return "\n".join(lines)


def decimal_commas(path: Path) -> None:
    """Write numbers as much of Europe does, and say which separator is used."""

    def change(text: str) -> str:
        header, _, body = text.partition("\n")
        return header.replace(",", ";") + "\n" + body.replace(",", ";").replace(".", ",")

    csv_text(change)(path)
    names = {name: name for name in HEADER.split(",")}
    words(columns={"separator": "semicolon", "map": names})(path)


def constant(text: str, column: int, value: str, first: str | None = None) -> str:
    """Write one value into a column from the second sample on."""
    header, one, *others = text.rstrip("\n").split("\n")
    rows = [line.split(",") for line in (one, *others)]
    for row in rows[1:]:
        row[column] = value
    rows[0][column] = rows[0][column] if first is None else first
    return "\n".join([header, *map(",".join, rows)]) + "\n"


def wrapped(text: str) -> str:
    """Take a turn from every angle of the elbow from the twelfth line on."""
    lines = text.rstrip("\n").split("\n")
    for number in range(11, len(lines)):
        cells = lines[number].split(",")
        cells[2] = f"{float(cells[2]) - 2 * pi:.7g}"
        lines[number] = ",".join(cells)
    return "\n".join(lines) + "\n"


def copied(name: str, trial: str) -> Spoil:
    def spoil(path: Path) -> None:
        words(trials=[{"file": "a.csv"}, {"file": trial}])(path)
        if name:
            (path / name).symlink_to("a.csv")

    return spoil


def recorded_once(path: Path) -> None:
    """List a copy of the only recording as its holdout."""
    shutil.copy(path / "a.csv", path / "b.csv")
    words(trials=[{"file": "a.csv"}, {"file": "b.csv", "role": "holdout"}])(path)


def bag(path: Path) -> None:
    """Give a robot's log as it is for a trial."""
    (path / "a.mcap").write_bytes(b"\x89MCAP0\r\n")
    words(trials=[{"file": "a.mcap"}])(path)


BAD: dict[str, tuple[Spoil, str]] = {
    # session.json
    "no session.json": (lambda p: (p / "session.json").unlink(), "session.json: there is no such"),
    "an empty file": (raw(b""), "session.json, line 1: is not JSON"),
    "a list": (raw(b"[]"), "must hold one JSON object"),
    "UTF-16": (raw('{"schema": 1}'.encode("utf-16")), "not UTF-8"),
    "a key twice": (raw(b'{"schema": 1, "schema": 1}'), "schema stands twice"),
    "brackets without end": (raw(b"[" * 100_000), "nested too deeply"),
    "a number without end": (raw(b'{"schema": ' + b"1" * 5000 + b"}"), "too many digits"),
    "a huge file": (raw(b" " * 1_000_001), "larger than"),
    "a text for a schema": (words(schema="1"), "schema must be 1"),
    "a slip in the key of the model": (
        raw(b'{"schema": 1, "modell": "device.xml"}'),
        "model is missing; is modell meant",
    ),
    "a slip in the key of the trials": (
        raw(b'{"schema": 1, "model": "device.xml", "trails": []}'),
        "trials is missing; is trails meant",
    ),
    "no model": (words(model=None), "model must be a name"),
    "a model of zero bytes in its name": (words(model="a\0b"), "relative path"),
    "a model of half a letter": (words(model="\ud800.xml"), "cannot be the name of a file"),
    "a model too long to be a name": (words(model="x" * 5000), "cannot be the name of a file"),
    "a folder for a model": (
        words(model="."),
        "is a folder, not a file, but .* names it",
    ),
    "a model on a drive": (words(model="C:device.xml"), "relative path"),
    "a model on another machine": (words(model="\\\\host\\device.xml"), "relative path"),
    "a model two folders up": (words(model="sub/../../device.xml"), "leaves the session's folder"),
    "a link out of the folder": (linked("a.csv", "../outside/secret.csv"), "leaves the session's"),
    "a model that is a link": (linked("device.xml", "../outside/secret.xml"), "leaves the session"),
    "a session that is a link": (linked("session.json", "../outside/secret.json"), "leaves the"),
    "a bag for a trial": (bag, "is no CSV file: `rehyb inspect a.mcap --out DIR` writes one"),
    "a link to itself": (linked("a.csv", "a.csv"), "cannot be the name of a file|no such file"),
    "trials as an object": (
        words(trials={"file": "a.csv"}),
        r"trials must be a list of trials, such as \[\{",
    ),
    "a word for whether an effort is calibrated": (
        words(sensors={"elbow.effort": {"calibrated": "yes"}}),
        r"sensors.elbow.effort.calibrated must be true or false",
    ),
    "a sensor of which nothing is said": (
        words(sensors={"elbow.effort": {}}),
        'has neither "noise_rms" nor "calibrated"',
    ),
    "a gain of an effort that is calibrated": (
        words(
            sensors={"elbow.effort": {"calibrated": True}},
            declared_effects=[{"effect": "torque_gain", "joint": "elbow"}],
        ),
        "calibrated says that there is no torque_gain; declare one of both",
    ),
    "no trials": (words(trials=[]), "trials must list at least one trial"),
    "holdouts alone": (
        words(trials=[{"file": "a.csv", "role": "holdout"}]),
        "trials must hold one that is fitted; every trial is a holdout",
    ),
    "a trial as text": (words(trials=["a.csv"]), r"trials\[0\] must be an object"),
    "too many trials": (words(trials=[{"file": "a.csv"}] * 201), "at most 200"),
    "one file by two names": (copied("", "./a.csv"), "listed twice"),
    "a copy of a recording as its holdout": (recorded_once, "same samples as a.csv"),
    "one file by a link": (copied("b.csv", "b.csv"), "listed twice"),
    "a role of nothing": (words(trials=[{"file": "a.csv", "role": []}]), "'fit' or 'holdout'"),
    "a label of half a letter": (
        words(trials=[{"file": "a.csv", "label": "\ud800"}]),
        "label and group must be text",
    ),
    "a filter of zero": (words(effort_filter_hz=0), "effort_filter_hz must be more than 0"),
    "a filter beyond numbers": (words(effort_filter_hz=10**400), "must be a finite number"),
    "a height in centimetres": (words(subject={"height_m": 175}), "at most 2.5"),
    "a subject of text": (words(subject="tall"), "subject must be an object"),
    "an effect twice": (
        words(declared_effects=[{"effect": "viscoelastic_joint", "joint": "elbow"}] * 2),
        "declared twice",
    ),
    "a limb's effect where no limb is": (
        words(declared_effects=[{"effect": "stretch_reflex", "joint": "elbow"}]),
        r"declared_effects\[0\] stretch_reflex is an effect of a limb, and 'elbow' has none",
    ),
    "every joint ignored": (
        words(ignored_joints=["shoulder", "elbow"], declared_effects=[]),
        "leaves no joint",
    ),
    "a mass below zero": (
        words(
            trials=[{"file": "a.csv", "added_mass": {"body": "forearm", "mass_kg": -1}}],
        ),
        "mass_kg must be more than 0",
    ),
    "a payload on two bodies": (
        words(
            trials=[
                {"file": "a.csv", "to": 1, "payload": {"name": "tool", "body": "forearm"}},
                {"file": "a.csv", "from": 2, "payload": {"name": "tool", "body": "upper"}},
            ],
        ),
        "give a load that was moved another name",
    ),
    "a place of two numbers": (
        words(
            trials=[
                {
                    "file": "a.csv",
                    "added_mass": {"body": "forearm", "mass_kg": 1, "position": [0, 0]},
                }
            ],
        ),
        "three numbers",
    ),
    # the model
    "a model of bytes": (lambda p: (p / "device.xml").write_bytes(b"\xff\xfe<") and None, "UTF-8"),
    "a URDF file without a link": (
        lambda p: (p / "device.xml").write_text("<robot/>") and None,
        "must have joints",
    ),
    "a body whose inertia only a mesh has": (
        model(
            '<body name="upper_arm">',
            '<body name="upper_arm"><body name="hand"><joint name="wrist"/>'
            '<geom type="mesh" mesh="m"/></body>',
        ),
        "'hand' takes its inertia from a mesh",
    ),
    "an attached model": (
        model("<worldbody>", '<asset><model name="m" file="m.xml"/></asset><worldbody>'),
        "attached model|external file",
    ),
    "a closed chain": (
        model("</worldbody>", '</worldbody><equality><joint joint1="elbow"/></equality>'),
        "closes the chain",
    ),
    "a generator of bodies": (
        model("<worldbody>", '<worldbody><replicate count="1000000"><body/></replicate>'),
        "generator of bodies",
    ),
    "bodies nested to death": (
        model("<worldbody>", "<worldbody>" + "<body>" * 5000 + "</body>" * 5000),
        "nests elements",
    ),
    "a body a thousand kilometres long": (
        model('<body name="forearm" pos="0.3 0 0">', '<body name="forearm" pos="1e6 0 0">'),
        "'forearm' has places of 1e\\+06; lengths are in m",
    ),
    "a centre of mass beyond all stars": (
        model('<inertial pos="0.15 0 0"', '<inertial pos="0 -1e99 0"'),
        "'upper_arm' has places of 1e\\+99",
    ),
    "a link in micrograms": (model('mass="2"', 'mass="2e9"'), "has masses of 2e\\+09; .* in kg"),
    **{
        f"an option of {said}": (
            model("<worldbody>", f"<option {said}/><worldbody>"),
            f"device.xml: <option> has {told}; it must be finite and at most",
        )
        for said, told in (
            ('gravity="0 0 -inf"', "gravity=-inf"),
            ('gravity="0 0 -1e300"', "gravity=-1e\\+300"),
            ('wind="inf 0 0" density="1"', "wind=inf"),
            ('density="1e300"', "density=1e\\+300"),
        )
    },
    **{
        f"a joint with {attribute}={value}": (
            model('name="shoulder"', f'name="shoulder" {attribute}="{value}"'),
            f"device.xml: joint 'shoulder' has {attribute}={said}; it must be finite and at most",
        )
        for attribute, value, said in (
            ("damping", "1e300", "1e\\+300"),
            ("armature", "1e200", "1e\\+200"),
            ("stiffness", "1e300", "1e\\+300"),
            ("frictionloss", "1e308", "1e\\+308"),
            ("ref", "1e300", "1e\\+300"),
            ("springref", "inf", "inf"),
        )
    },
    "a range that ends on one side": (
        model('name="elbow"', 'name="elbow" limited="true" range="-inf 1"'),
        "'elbow' has range=-inf; both ends must be finite; leave out a range that has none",
    ),
    **{
        f"{said} of a part": (
            model("</worldbody>", f"{before}</worldbody>{after}"),
            f"has {said}=1e\\+99; it must be finite and at most",
        )
        for said, before, after in (
            ("inertia", f'<body><inertial mass="1" pos="0 0 0" {HUGE}/></body>', ""),
            ("gear", "", '<actuator><motor joint="elbow" gear="1e99"/></actuator>'),
        )
    },
    "a link that weighs less than nothing": (
        model(
            "<inertial",
            '<body name="hand"><inertial pos="0.1 0 0" mass="-1" diaginertia="1 1 1"/></body>'
            "<inertial",
        ),
        "device.xml: <inertial> of body 'hand' has mass='-1'; none is below 0",
    ),
    "a damper that drives": (
        model('name="elbow"', 'name="elbow" damping="-0.5"'),
        "joint 'elbow' has damping=-0.5; it cannot be below 0",
    ),
    "a crowd of bodies": (model("<worldbody>", "<worldbody>" + "<body/>" * 201), "at most 200"),
    "a time step of nothing": (
        model("<worldbody>", '<option timestep="nan"/><worldbody>'),
        "<option> has timestep='nan'; every number must be finite",
    ),
    "a time step backwards": (
        model("<worldbody>", '<option timestep="-1"/><worldbody>'),
        "timestep='-1'; it must be a finite number above 0",
    ),
    "a joint without a name": (model('name="elbow"', ""), "each with a name|names it|unknown"),
    "no joint": (
        lambda p: (p / "device.xml").write_text("<mujoco><worldbody/></mujoco>") and None,
        "must have joints",
    ),
    # a trial
    "an empty trial": (csv_bytes(b""), "a.csv, column time, line 1"),
    "a log of another robot": (
        csv_text(lambda t: t.replace("shoulder.", "neck.", 1).replace("elbow.", "hip.")),
        r"shoulder.position.*is missing.*so are elbow.position, elbow.effort",
    ),
    "a header alone": (csv_text(lambda t: t.split("\n")[0]), "has 0 samples"),
    "a few samples": (csv_text(lambda t: "\n".join(t.split("\n")[:30])), "has 29 samples"),
    "a table of UTF-16": (csv_bytes(HEADER.encode("utf-16")), "not UTF-8"),
    "zero bytes": (csv_text(lambda t: t.replace("0.005", "0\0005", 1)), "line 3: holds a zero"),
    "semicolons": (csv_text(lambda t: t.replace(",", ";")), "columns by commas"),
    "tabs": (csv_text(lambda t: t.replace(",", "\t")), "columns by commas"),
    "a column without a name": (csv_text(lambda t: t.replace("time,", "time,,", 1)), "no name"),
    "a column twice": (
        csv_text(lambda t: t.replace("elbow.velocity", "elbow.position", 1)),
        "a.csv, column elbow.position, line 1: stands twice",
    ),
    "too many columns": (
        csv_text(lambda t: t.replace("\n", "," + ",".join(map(str, range(500))) + "\n", 1)),
        "at most 500",
    ),
    "a short line": (csv_text(lambda t: line_of(t, 12, lambda c: c[:-1])), "line 12: has 4 cells"),
    "a decimal comma": (
        csv_text(lambda t: line_of(t, 12, lambda c: ['"0,5"', *c[1:]])),
        "a.csv, column time, line 12: holds '0,5', with a decimal comma; .* as 0.5",
    ),
    "decimal commas under a declared separator": (
        decimal_commas,
        "with a decimal comma; write decimals with a point",
    ),
    "an effort that is constant but for one sample": (
        csv_text(lambda t: constant(t, 4, "1.5")),
        "column elbow.effort, line 3: is constant at 1.5 while elbow moves",
    ),
    "an encoder that is stuck but for one sample": (
        csv_text(lambda t: constant(t, 1, "-0.2", first="0.1")),
        "column shoulder.position, line 3: is constant at -0.2 in .* of .* samples, and jumps",
    ),
    "one position that no joint reaches": (
        csv_text(lambda t: line_of(t, 12, lambda row: [*row[:2], "55", *row[3:]])),
        "column elbow.position, line 12: jumps from .* to 55 rad .* so fast between slower ones",
    ),
    "an encoder that wraps": (
        csv_text(lambda t: wrapped(t)),
        "column elbow.position, line 12: jumps from .* by about 2 pi, .* the encoder wraps",
    ),
    "a range in degrees that is meant in radians": (
        model('name="elbow"', 'name="elbow" limited="true" range="-0.1 0.04"'),
        "column elbow.position, line 2: is .* most of it outside of the range that the model",
    ),
    "NaN": (
        csv_text(lambda t: line_of(t, 12, lambda c: [*c[:-1], "NaN"])),
        "a.csv, column elbow.effort, line 12: holds nan",
    ),
    "a number beyond anything": (
        csv_text(lambda t: line_of(t, 12, lambda c: [*c[:-1], "1e200"])),
        "a.csv, column elbow.effort, line 12: holds 1e\\+200",
    ),
    "time that stands still": (
        csv_text(lambda t: line_of(t, 12, lambda c: ["0.045", *c[1:]])),
        "a.csv, column time, line 12: must increase|line 13: must increase",
    ),
    "a cell without end": (
        csv_text(lambda t: line_of(t, 12, lambda c: ["1" * 200_000, *c[1:]])),
        "line 12",
    ),
}
