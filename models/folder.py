"""A model's folder: `model.toml` and what it names, read under limits, packed and unpacked.

The format is docs/use/models.md's.
"""

import hashlib
import json
import re
import shutil
import tomllib
import zipfile
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any

from intake.zips import Limits, only_folder, unpack
from models.description import Description, Kind
from models.entries import DescriptionError

MODEL_FILE = "model.toml"
#: Of model.toml and of one line of it: a dotted key takes time that grows as its square.
MAX_TOML_BYTES, MAX_LINE = 500_000, 2_000
LIMITS = Limits(
    files=500,
    # Meshes of a whole robot, and room.
    unpacked=500_000_000,
    most="a model takes",
    folder="a model's folder",
)
#: Entries of factors and outputs that say how a model of kind `mjcf` is changed and read.
MJCF_ENTRIES = {"factors": ("sets", "scales"), "outputs": ("sensor", "reduce", "over")}

_ENTRY = re.compile(r"(?P<part>factors|outputs)\[(?P<number>\d+)\]")
_MODEL = ("name", "kind", "description", "time_limit", "deterministic")
#: An example of what runs a program.
_PROGRAM = '["python3", "model.py"]'


class ModelError(ValueError):
    """A model's folder cannot be used; the message says which file, what, and what is right."""

    def __init__(self, detail: str, *, file: str = MODEL_FILE) -> None:
        super().__init__(f"{file}: {detail}")
        self.detail, self.file = detail, file


@dataclass(frozen=True, kw_only=True)
class ModelFolder:
    """What a model's folder says."""

    path: Path
    description: Description
    #: The table of `model.toml` that its kind reads: `[mjcf]`, `[command]` or `[umbridge]`.
    run: Mapping[str, Any]
    #: For each factor and each output by name, what `MJCF_ENTRIES` lists of it.
    mjcf: Mapping[str, Mapping[str, Any]]

    def check_run(self, known: Collection[str]) -> None:
        """Raise a ModelError unless the table of its kind has `known` entries only."""
        for name in self.run:
            if name not in known:
                raise ModelError(
                    f"{self.description.kind}.{name[:80]} is unknown: "
                    f"expected {', '.join(sorted(known))}"
                )


def read_folder(path: Path) -> ModelFolder:
    """Read a model's folder.

    Raises:
        ModelError: something in it is missing or wrong.
    """
    said = _toml(path)
    model = _table(said, "model")
    kind = model.get("kind")
    if kind not in (Kind.MJCF, Kind.COMMAND, Kind.UMBRIDGE):
        raise ModelError(
            f"model.kind is {kind!r}: expected mjcf, command or umbridge; a Python model comes in "
            "a package and needs no folder"
        )
    for name in model:
        if name not in _MODEL:
            raise ModelError(f"model.{name[:80]} is unknown: expected {', '.join(_MODEL)}")
    for name in said:
        if name not in ("model", "factors", "outputs", kind):
            raise ModelError(f"[{name[:80]}] is unknown: expected model, factors, outputs, {kind}")
    mjcf: dict[str, Mapping[str, Any]] = {}
    tables: dict[str, Any] = {}
    for part, entries in MJCF_ENTRIES.items():
        tables[part], of_mjcf = _split(said.get(part), part, entries, kind)
        mjcf |= of_mjcf
    if kind == Kind.MJCF:
        for output in tables["outputs"]:
            if "curve" in output:
                output |= _axis(mjcf[str(output.get("name"))], said.get(kind))
    try:
        description = Description.from_json({**model, **tables, "code": _digest(path)})
    except DescriptionError as error:
        raise ModelError(f"{error}{_called(error.field, tables)}") from None
    folder = ModelFolder(path=path, description=description, run=_table(said, kind), mjcf=mjcf)
    _check_run(folder)
    return folder


def _called(field: str, tables: Mapping[str, Any]) -> str:
    """Say which factor or output an entry such as "factors[2].low" is of, if that has a name."""
    if (found := _ENTRY.match(field)) is None:
        return ""
    entry = tables[found["part"]][int(found["number"])]
    name = entry.get("name") if isinstance(entry, dict) else None
    return f" ({name[:80]})" if isinstance(name, str) and name else ""


def pack(folder: ModelFolder, out: Path) -> None:
    """Write a model's files as the zip file `out`, which `unpacked_into` reads."""
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in _names(folder.path):
            archive.write(folder.path / name, name)


def copied(folder: ModelFolder, target: Path) -> ModelFolder:
    """Copy a model's files to the new folder `target`, where nobody changes them, and read it.

    Raises:
        ModelError: they changed meanwhile.
    """
    for name in _names(folder.path):
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(folder.path / name, target / name)
    copy = read_folder(target)
    if copy.description.digest != folder.description.digest:
        raise ModelError(f"the files in {folder.path} change while they are copied")
    return copy


def unpacked_into(archive: Path, folder: Path) -> Path:
    """Unpack a model's zip file into the empty `folder` and return where `model.toml` is.

    Raises:
        ModelError: the file is no zip, holds no model, or would do harm.
    """

    def wrong(detail: str) -> ModelError:
        return ModelError(detail, file=archive.name)

    unpack(archive, folder, LIMITS, wrong)
    found = only_folder(folder, MODEL_FILE)
    if found is None:
        raise wrong(f"holds no {MODEL_FILE}")
    return found


def _toml(folder: Path) -> dict[str, Any]:
    path = folder / MODEL_FILE
    try:
        if path.stat().st_size > MAX_TOML_BYTES:
            raise ModelError(f"is larger than {MAX_TOML_BYTES // 1000} kB")
        # Some editors begin a file with a byte-order mark.
        text = path.read_text(encoding="utf-8-sig")
        if any(len(line) > MAX_LINE for line in text.splitlines()):
            raise ModelError(f"has a line of more than {MAX_LINE} characters")
        return tomllib.loads(text)
    except ModelError:
        raise
    except FileNotFoundError:
        raise ModelError(f"there is no such file in {folder}") from None
    except NotADirectoryError:
        raise ModelError(f"{folder} is a file: name the folder that it is in") from None
    except OSError as error:
        raise ModelError(f"cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ModelError("is not UTF-8 text") from None
    except RecursionError:
        raise ModelError("is nested too deeply") from None
    except ValueError as error:
        # tomllib.TOMLDecodeError, and numbers with too many digits.
        raise ModelError(f"is not TOML: {error}") from None


def _check_run(folder: ModelFolder) -> None:
    """Raise a ModelError unless `[command]` or `[umbridge]` is right; `[mjcf]` takes MuJoCo."""
    run = folder.run
    if folder.description.kind == Kind.COMMAND:
        folder.check_run({"run", "keep"})
        words = run.get("run")
        if not isinstance(words, list) or not words or not all(isinstance(w, str) for w in words):
            wrong = "is missing" if words is None else f"is {str(words)[:80]!r}"
            raise ModelError(f"command.run {wrong}: expected a list of texts, as {_PROGRAM}")
        if not isinstance(run.get("keep", False), bool):
            raise ModelError("command.keep must be true or false")
    elif folder.description.kind == Kind.UMBRIDGE:
        folder.check_run({"name", "config"})
        if not isinstance(run.get("name", ""), str):
            raise ModelError("umbridge.name must be a text: what the server calls its model")
        if not isinstance(run.get("config", {}), dict):
            raise ModelError("umbridge.config must be a table, which the server gets as it is")
        try:
            json.dumps(run.get("config"), allow_nan=False)
        except (TypeError, ValueError):
            raise ModelError(
                "umbridge.config goes to the server as JSON, which has no dates, inf or nan"
            ) from None


def _table(said: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    table = said.get(name)
    if not isinstance(table, dict):
        raise ModelError(f"must have a table [{name}]")
    return table


def _split(
    said: Any, part: str, entries: tuple[str, ...], kind: str
) -> tuple[list[Any], dict[str, Mapping[str, Any]]]:
    """Part the tables of factors or outputs into what describes them and what MJCF needs."""
    if not isinstance(said, list) or not all(isinstance(table, dict) for table in said):
        raise ModelError(f"must list its {part} as tables [[{part}]]")
    described: list[Any] = []
    of_mjcf: dict[str, Mapping[str, Any]] = {}
    for i, table in enumerate(said):
        # What a curve is over, others say of it, too.
        shared = () if kind == Kind.MJCF else ("over",)
        own = {name: table[name] for name in entries if name in table and name not in shared}
        if own and kind != Kind.MJCF:
            raise ModelError(f"{part}[{i}].{next(iter(own))} is for models of kind mjcf only")
        described.append({name: value for name, value in table.items() if name not in own})
        of_mjcf[str(table.get("name"))] = own
    return described, of_mjcf


def _axis(read: Mapping[str, Any], run: Any) -> dict[str, Any]:
    """Return the axis of a curve that a sensor makes: time, or the share of a sensor's travel."""
    over = read.get("over", "time")
    if over != "time" or not isinstance(run, dict):
        return {"over": str(over)}
    first, last = run.get("record_from", 0.0), run.get("duration")
    if (
        not isinstance(first, int | float)
        or not isinstance(last, int | float)
        or not -inf < first < last < inf
    ):
        # Whoever reads the table says what is wrong with it.
        return {"over": "time"}
    return {"over": "time", "over_unit": "s", "low": float(first), "high": float(last)}


def _names(folder: Path) -> list[str]:
    """Return the files of a folder, as posix paths in it, sorted.

    Raises:
        ModelError: a link leads out of the folder, or there are too many files or bytes.
    """
    names, size = [], 0
    for path in folder.rglob("*"):
        name = path.relative_to(folder).as_posix()
        if any(part.startswith(".") or part == "__pycache__" for part in Path(name).parts):
            continue
        if not path.resolve().is_relative_to(folder.resolve()):
            raise ModelError(
                "leads out of the model's folder; keep every file inside it", file=name
            )
        if path.is_file():
            names.append(name)
            size += path.stat().st_size
    if len(names) > LIMITS.files or size > LIMITS.unpacked:
        raise ModelError(
            f"the folder holds {len(names)} files of {size / 1e6:.0f} MB; at most {LIMITS.files} "
            f"of {LIMITS.unpacked / 1e6:.0f} MB belong to a model"
        )
    return sorted(names)


def _digest(folder: Path) -> str:
    """Return a digest of the names and contents of a model's files."""
    digest = hashlib.sha256()
    for name in _names(folder):
        try:
            with (folder / name).open("rb") as file:
                content = hashlib.file_digest(file, "sha256").hexdigest()
        except OSError as error:
            raise ModelError(f"cannot be read: {error.strerror}", file=name) from None
        digest.update(f"{name}\0{content}\0".encode())
    return digest.hexdigest()
