"""A session's `session.json`: what each field may hold."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Any

from analysis.closeloop.contract import SCHEMA
from analysis.closeloop.errors import SessionError
from analysis.closeloop.session.columns import read_map
from analysis.closeloop.session.contents import (
    NOMINAL,
    AddedMass,
    ColumnMap,
    DeclaredEffect,
    HungLoad,
    Session,
    Trial,
)
from analysis.closeloop.session.files import SESSION_FILE, Fields, inside, like, read_json
from sim.effects.catalogue import BY_NAME, VISCOELASTIC, law_of

MAX_TRIALS = 200
MAX_JSON_BYTES = 1_000_000
#: m/s2: beyond, another unit is meant.
MOST_GRAVITY = 30.0
#: Any name may stand there.
ANY = "*"
#: What `session.json` may say: by name what stands inside, None if that is read elsewhere.
_KEYS: Mapping[str, Any] = {
    "schema": None,
    "model": None,
    "subject": {"height_m": None, "mass_kg": None},
    "gravity": None,
    "declared_effects": {"effect": None, "joint": None},
    "ignored_joints": None,
    "limb_joints": None,
    "sensors": {ANY: {"noise_rms": None, "calibrated": None}},
    "effort_filter_hz": None,
    "kinematic_cutoff_hz": None,
    "columns": None,
    "trials": {
        "file": None,
        "label": None,
        "group": None,
        "role": None,
        "added_mass": {"body": None, "mass_kg": None, "position": None},
        "payload": {"name": None, "body": None},
        "effort_filter_hz": None,
        "columns": None,
        "from": None,
        "to": None,
    },
}


def read_session(folder: Path, known_effects: Collection[str]) -> Session:
    """Read `session.json`; the trials' files are found but not yet read.

    `known_effects`: names that `declared_effects` may hold.

    Raises:
        SessionError: the folder or the file cannot be used.
    """
    if not folder.is_dir():
        raise SessionError(
            "there is no such folder; name one with a session.json", file=str(folder)
        )
    path = inside(folder, SESSION_FILE, field_name=SESSION_FILE)
    content = read_json(path, SESSION_FILE, MAX_JSON_BYTES, _once_each)
    if not isinstance(content, dict):
        raise SessionError("must hold one JSON object", file=SESSION_FILE)
    fields = Fields(content, SESSION_FILE)
    schema = fields.get("schema")
    if schema != SCHEMA or isinstance(schema, bool):
        raise fields.wrong("schema", f"must be {SCHEMA}, not {schema!r}")
    model = fields.text("model")
    if model != NOMINAL:
        inside(folder, model, field_name="model")
    wanted = 'such as {"height_m": 1.75, "mass_kg": 70}'
    subject = fields.part("subject", fields.get("subject", {}), wanted)
    filter_hz = _filter_hz(fields)
    declared = _declared(fields, known_effects)
    limbs = _joint_names(fields, "limb_joints")
    if fields.get("limb_joints") is None:
        limbs = tuple(entry.joint for entry in declared if entry.effect == VISCOELASTIC.name)
    _only_where_limbs_are(fields, declared, limbs)
    calibrated = _calibrated(fields, declared)
    return Session(
        folder=folder,
        model=model,
        height_m=subject.number("height_m", 1.75, low=0.5, high=2.5),
        mass_kg=subject.number("mass_kg", 70.0, low=10.0, high=300.0),
        gravity=_gravity(fields),
        declared=declared,
        ignored_joints=_joint_names(fields, "ignored_joints"),
        limb_joints=limbs,
        kinematic_cutoff_hz=_cutoff_hz(fields),
        noise=_noise(fields),
        calibrated=calibrated,
        trials=_trials(fields, folder, filter_hz),
        unknown=tuple(
            name.encode(errors="backslashreplace").decode() for name in _unread(content, _KEYS)
        ),
    )


def _once_each(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Make an object of its pairs; one of two equal names would be lost in silence."""
    content = dict(pairs)
    if len(content) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise SessionError(f"{twice} stands twice in one object", file=SESSION_FILE)
    return content


def _unread(content: Any, known: Mapping[str, Any] | None, where: str = "") -> Iterator[str]:
    """Yield where the file says something that no analysis reads: often a slip of the pen."""
    if known is None:
        return
    if isinstance(content, list):
        for number, entry in enumerate(content):
            yield from _unread(entry, known, f"{where}[{number}]")
    elif isinstance(content, dict):
        for name, value in content.items():
            place = f"{where}.{name}" if where else name
            if name in known or ANY in known:
                yield from _unread(value, known.get(name, known.get(ANY)), place)
            else:
                yield place


def unread_sensors(session: Session, recorded: Collection[str]) -> Session:
    """Return the session, with what it says of channels that no trial records as not read."""
    said = dict.fromkeys((*session.noise, *sorted(session.calibrated)))
    none = tuple(f"sensors.{name}" for name in said if name not in recorded)
    return replace(session, unknown=(*session.unknown, *none))


def said_of_unread(unknown: Sequence[str]) -> list[str]:
    """Say which keys mean nothing, and for which others they may stand."""
    if not unknown:
        return []
    known = {*_KEYS, *_KEYS["trials"], *_KEYS["declared_effects"], *_KEYS["subject"]}
    keys = [key.rpartition(".")[2] for key in unknown if not key.endswith(".effort")]
    near = dict.fromkeys(one for key in keys for one in like(key, known))
    said = "means nothing and was" if len(unknown) == 1 else "mean nothing and were"
    asked = f": is {' or '.join(near)} meant?" if near else ""
    return [f"{SESSION_FILE}: {', '.join(unknown)} {said} not read{asked}"]


def _declared(fields: Fields, known_effects: Collection[str]) -> tuple[DeclaredEffect, ...]:
    declared: list[DeclaredEffect] = []
    for number, entry in enumerate(fields.entries("declared_effects")):
        own = fields.part(f"declared_effects[{number}]", entry, 'with "effect" and "joint"')
        effect = own.text("effect")
        if effect not in known_effects:
            raise own.wrong(
                "effect", f"{effect!r} is unknown; take one of {', '.join(known_effects)}"
            )
        found = DeclaredEffect(effect=effect, joint=own.text("joint"))
        if found in declared:
            raise own.wrong("", f"{effect} of {found.joint} is declared twice")
        declared.append(found)
    return tuple(declared)


def _only_where_limbs_are(
    fields: Fields, declared: Sequence[DeclaredEffect], limbs: Collection[str]
) -> None:
    """Refuse a limb's effect at a joint where no limb is.

    Raises:
        SessionError: naming the declaration.
    """
    for number, entry in enumerate(declared):
        of_limb = entry.joint in limbs
        if law_of(entry.effect, of_limb=of_limb).limb and not of_limb:
            raise fields.wrong(
                f"declared_effects[{number}]",
                f"{entry.effect} is an effect of a limb, and {entry.joint!r} has none: declare its "
                "viscoelastic_joint, too, or list it in limb_joints",
            )


def _trials(fields: Fields, folder: Path, filter_hz: float | None) -> tuple[Trial, ...]:
    session_map = read_map(fields, "columns", folder)
    fields.there("trials")
    entries = fields.get("trials")
    if not isinstance(entries, list):
        wanted = 'a list of trials, such as [{"file": "a.csv"}]'
        raise fields.wrong("trials", f"must be {wanted}")
    if not entries:
        raise fields.wrong("trials", "must list at least one trial")
    if len(entries) > MAX_TRIALS:
        raise fields.wrong(
            "trials", f"lists {len(entries)} trials; at most {MAX_TRIALS} are analysed"
        )
    trials: list[Trial] = []
    parts: dict[Path, list[tuple[float, float]]] = {}
    for number, entry in enumerate(entries):
        own = fields.part(f"trials[{number}]", entry, 'with "file"')
        file = own.text("file")
        path = inside(folder, file, field_name=own.path("file")).resolve()
        span = _span(own)
        others = parts.setdefault(path, [])
        if any(span[0] < other[1] and other[0] < span[1] for other in others):
            raise own.wrong(
                "file",
                f"{file!r} is listed twice; list each trial once, or give each part of a file its "
                "own from and to",
            )
        others.append(span)
        trials.append(_trial(own, file, span, folder, session_map, filter_hz))
    _one_body_each(fields, trials)
    if all(trial.role == "holdout" for trial in trials):
        raise fields.wrong("trials", "must hold one that is fitted; every trial is a holdout")
    return tuple(trials)


def _span(trial: Fields) -> tuple[float, float]:
    """Return from when to when a trial lasts, s on the session's clock."""
    low, high = (
        end if trial.get(name) is None else trial.number(name, low=-inf)
        for name, end in (("from", -inf), ("to", inf))
    )
    if low >= high:
        raise trial.wrong("from", f"must be before to, and {low:g} is not before {high:g}")
    return low, high


def _trial(
    own: Fields,
    file: str,
    span: tuple[float, float],
    folder: Path,
    session_map: ColumnMap | None,
    filter_hz: float | None,
) -> Trial:
    """Return one entry of the trials; map and filter are the session's own, its defaults."""
    role = own.get("role", "fit")
    if role not in ("fit", "holdout"):
        raise own.wrong("role", f"must be 'fit' or 'holdout', not {role!r}")
    name = file if span == (-inf, inf) else f"{file} {span[0]:g} to {span[1]:g} s"
    label, group = own.get("label", name), own.get("group", name)
    if not (_is_text(label) and _is_text(group)):
        raise own.wrong("", "label and group must be text")
    own_map = read_map(own, "columns", folder)
    own_filter_hz = _filter_hz(own)
    return Trial(
        file=file,
        label=label,
        group=group,
        role=role,
        added_mass=_added_mass(own),
        payload=_payload(own),
        effort_filter_hz=filter_hz if own_filter_hz is None else own_filter_hz,
        source=own_map or session_map,
        span=span,
    )


def _added_mass(trial: Fields) -> AddedMass | None:
    entry = trial.get("added_mass")
    if entry is None:
        return None
    own = trial.part("added_mass", entry, 'with "body", "mass_kg" and "position"')
    wanted = "three numbers in m, in the body's frame"
    position = own.vector("position", most=10.0, wanted=wanted, default=[0, 0, 0])
    return AddedMass(
        body=own.text("body"), mass=own.number("mass_kg", high=1000.0), position=position
    )


def _payload(trial: Fields) -> HungLoad | None:
    entry = trial.get("payload")
    if entry is None:
        return None
    own = trial.part("payload", entry, 'with "name" and "body"')
    return HungLoad(name=own.text("name"), body=own.text("body"))


def _one_body_each(fields: Fields, trials: list[Trial]) -> None:
    """Refuse a payload that hangs on two bodies: it is one load, with one place.

    Raises:
        SessionError: naming the trial.
    """
    bodies: dict[str, str] = {}
    for number, trial in enumerate(trials):
        load = trial.payload
        if load is not None and bodies.setdefault(load.name, load.body) != load.body:
            raise fields.wrong(
                f"trials[{number}].payload.body",
                f"{load.name!r} hangs on {bodies[load.name]!r} in an earlier trial and on "
                f"{load.body!r} here; give a load that was moved another name",
            )


def _gravity(fields: Fields) -> tuple[float, float, float] | None:
    if fields.get("gravity") is None:
        return None
    wanted = "three numbers in m/s2, along x, y and z of the model's world"
    return fields.vector("gravity", most=MOST_GRAVITY, wanted=wanted)


def _filter_hz(fields: Fields) -> float | None:
    return None if fields.get("effort_filter_hz") is None else fields.number("effort_filter_hz")


def _cutoff_hz(fields: Fields) -> float | None:
    if fields.get("kinematic_cutoff_hz") is None:
        return None
    return fields.number("kinematic_cutoff_hz", low=0.1, high=1000.0)


def _sensors(fields: Fields) -> Iterator[tuple[str, Fields]]:
    """Yield the effort channels of which the user knows something, and what."""
    wanted = 'such as {"elbow.effort": {"noise_rms": 0.05}}'
    sensors = fields.part("sensors", fields.get("sensors", {}), wanted)
    for channel in sensors.content:
        if not channel.endswith(".effort"):
            raise sensors.wrong(channel, "is no effort channel; name JOINT.effort")
        own = sensors.part(channel, sensors.get(channel), 'with "noise_rms" or "calibrated"')
        if own.get("noise_rms") is None and own.get("calibrated") is None:
            raise sensors.wrong(channel, 'has neither "noise_rms" nor "calibrated"')
        yield channel, own


def _noise(fields: Fields) -> dict[str, float]:
    """Return what the user knows of the noise of effort channels, root mean square."""
    return {
        channel: own.number("noise_rms")
        for channel, own in _sensors(fields)
        if own.get("noise_rms") is not None
    }


def _calibrated(fields: Fields, declared: Sequence[DeclaredEffect]) -> frozenset[str]:
    """Return the effort channels that are known to be the torque, and no share of it.

    Raises:
        SessionError: a channel is said to be the torque, and declared to be a share of it.
    """
    known = set()
    shares = {f"{entry.joint}.effort" for entry in declared if BY_NAME[entry.effect].scales_effort}
    for channel, own in _sensors(fields):
        value = own.get("calibrated", False)
        if not isinstance(value, bool):
            raise own.wrong("calibrated", "must be true or false")
        if value and channel in shares:
            raise own.wrong("calibrated", "says that there is no torque_gain; declare one of both")
        if value:
            known.add(channel)
    return frozenset(known)


def _joint_names(fields: Fields, name: str) -> tuple[str, ...]:
    entries = fields.entries(name)
    if not all(isinstance(entry, str) for entry in entries):
        raise fields.wrong(name, "must be a list of joint names")
    return tuple(entries)


def _is_text(value: Any) -> bool:
    """Whether a JSON value is text that can be written: JSON can hold half a character."""
    return isinstance(value, str) and value == value.encode(errors="replace").decode()
