"""A study as one file that can be checked without us: a zip archive with a manifest.

    manifest.json  versions, code, seed, failures by cause, and size and SHA-256 of the others
    study.json     the study's description, as `GET /v1/studies/{id}` gives it
    results.csv    every result with its parameters
    indices.json   the coordinator's snapshot of exactly these results
    failures.json  the ledger: every failed instance with its reason and its worker
    model.json     of a model that is not rehyb's own: its description
    model.zip      ... and of an uploaded one its files, so that anyone can run it

The same study gives the same bytes. Reading writes nothing to disk by a name from the archive, and
never unpacks more than an honest bundle could hold.
"""

import csv
import hashlib
import json
import shutil
import tempfile
import zipfile
import zlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from platform import python_version
from typing import IO, Any

from rehyb.client import Client, Json
from rehyb.errors import Conflict, Invalid
from rehyb.files import check_names
from rehyb.own_files import check_own
from rehyb.whole_files import whole_file

FORMAT = 1
MANIFEST = "manifest.json"
RESULTS = "results.csv"
#: Beside the manifest, in this order.
MEMBERS = ("study.json", RESULTS, "indices.json", "failures.json")
MODEL, MODEL_ARCHIVE = "model.json", "model.zip"
#: After these, where the model is not rehyb's own.
OF_MODEL = (MODEL, MODEL_ARCHIVE)

#: What a bundle may unpack to. Results take about 300 bytes each.
MOST_BYTES = 8 * 2**30
MOST_JSON_BYTES = 2**28
MOST_MODEL_BYTES = 2**30
#: How much smaller than itself a member of a bundle may be: tables of numbers shrink to a third,
#: and a ledger of equal failures to a fortieth.
MOST_SHRUNK = 200

_CHUNK = 2**20


@dataclass(frozen=True, kw_only=True)
class Bundle:
    """What a bundle says, read and limited but not yet believed."""

    manifest: Json
    study: Json
    indices: Json
    failures: list[Json]
    #: SHA-256 of each member as it is in the archive.
    found: Mapping[str, str]
    #: A file with the results, for as long as the folder it was put into lasts.
    results: Path
    #: Description of a model that is not rehyb's own.
    model: Json | None = None
    #: Its files, if it was uploaded.
    model_archive: Path | None = None


def write_bundle(client: Client, study_id: str, out: Path) -> str:
    """Write a study's bundle, and return the SHA-256 of the file.

    Raises:
        Conflict: the indices that the coordinator has are not yet those of all results.
        Invalid: a name in its model clashes with one in its table of results.
        RehybError: the coordinator does not know the study, or does not answer.
    """
    check_own(out, "bundle")
    with whole_file(out) as partial, tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        study = client.study(study_id)
        check_names(study)
        client.results_csv(study_id, folder / RESULTS)
        indices = client.indices(study_id)
        outcomes, workers = _counted(folder / RESULTS)
        if indices["evaluations"] != dict(sorted(outcomes.items())):
            raise Conflict(
                f"study {study_id} has {sum(outcomes.values())} results and indices of "
                f"{sum(indices['evaluations'].values())}: wait until it is complete, or pause it"
            )
        contents: dict[str, Any] = {
            "study.json": study,
            "indices.json": indices,
            "failures.json": client.all_instances(study_id, state="failed", page=1000),
        }
        members = [*MEMBERS]
        if "@" in study["model"]:
            members.append(MODEL)
            contents[MODEL] = _described(client, study["model"])
            if contents[MODEL]["kind"] == "mjcf":
                members.append(MODEL_ARCHIVE)
                client.model_archive(study["model"], folder / MODEL_ARCHIVE)
        for member, content in contents.items():
            (folder / member).write_text(_text(content))
        known = {worker["id"]: worker for worker in client.workers()}
        manifest = {
            "format": FORMAT,
            "study": study_id,
            "seed": study["seed"],
            "results": sum(outcomes.values()),
            "failures": {name: n for name, n in sorted(outcomes.items()) if name != "ok"},
            "identity": client.instance(study_id, 0, 0)["identity"],
            "workers": [
                {
                    "id": worker,
                    "host_class": known.get(worker, {}).get("host_class"),
                    "versions": known.get(worker, {}).get("versions", {}),
                }
                for worker in sorted(workers)
            ],
            "bundled_with": versions(),
            "files": {
                member: {
                    "sha256": digest_of(folder / member),
                    "bytes": (folder / member).stat().st_size,
                }
                for member in members
            },
        }
        (folder / MANIFEST).write_text(_text(manifest))
        with zipfile.ZipFile(partial, "w") as archive:
            for member in (MANIFEST, *members):
                _add(archive, member, folder / member)
    return digest_of(out)


def read_bundle(path: Path, folder: Path) -> Bundle:
    """Read a bundle; its results are put into `folder`, under a name that it cannot choose.

    Raises:
        Invalid: the file is no bundle, is cut short or damaged, or unpacks to more than a bundle
            does; the message says which.
    """
    try:
        # An unknown packing is a RuntimeError of zipfile.
        with zipfile.ZipFile(path) as archive:
            _inspect(path, archive)
            found = {}
            parts: dict[str, Any] = {}
            for member in (MANIFEST, *MEMBERS, *_there(archive)):
                digest = hashlib.sha256()
                with archive.open(member) as source:
                    if member in (RESULTS, MODEL_ARCHIVE):
                        _copy(source, folder / member, digest)
                    else:
                        parts[member] = _json(path, member, source, digest)
                found[member] = digest.hexdigest()
    except (zipfile.BadZipFile, EOFError, RuntimeError, zlib.error) as error:
        raise Invalid(f"{path} is no bundle, or is damaged: {error}") from None
    for member in (MANIFEST, "study.json", "indices.json", MODEL):
        if not isinstance(parts.get(member, {}), dict):
            raise Invalid(f"{path}: {member} is not a JSON object")
    if parts[MANIFEST].get("format") != FORMAT:
        raise Invalid(
            f"{path} has format {parts[MANIFEST].get('format')!r}, and this version reads {FORMAT}"
        )
    ledger = parts["failures.json"]
    if not isinstance(ledger, list) or not all(isinstance(line, dict) for line in ledger):
        raise Invalid(f"{path}: failures.json is not a list of JSON objects")
    return Bundle(
        manifest=parts[MANIFEST],
        study=parts["study.json"],
        indices=parts["indices.json"],
        failures=ledger,
        found=found,
        results=folder / RESULTS,
        model=parts.get(MODEL),
        model_archive=folder / MODEL_ARCHIVE if MODEL_ARCHIVE in found else None,
    )


def versions() -> dict[str, str]:
    """Return the versions here that the indices' bits may depend on."""
    return {name: version(name) for name in ("rehyb", "numpy", "scipy")} | {
        "python": python_version()
    }


def in_words(found: object) -> str:
    """Say which versions these are, one after another."""
    pairs = found.items() if isinstance(found, dict) else ()
    return ", ".join(f"{name} {value}" for name, value in pairs) or "nothing known"


def _there(archive: zipfile.ZipFile) -> list[str]:
    """Return what a bundle holds of its model."""
    names = set(archive.namelist())
    return [member for member in OF_MODEL if member in names]


def _described(client: Client, version: str) -> Json:
    from rehyb.client.models import description_of

    return description_of(client.model(version)).as_json()


def _inspect(path: Path, archive: zipfile.ZipFile) -> None:
    """Refuse an archive before anything of it is unpacked."""
    members = archive.infolist()
    names = Counter(member.filename for member in members)
    wanted = {MANIFEST, *MEMBERS}
    if strange := sorted(set(names) - wanted - {*OF_MODEL}):
        raise Invalid(f"{path} is no bundle: it holds {strange[0]!r}, which no bundle has")
    if missing := sorted(wanted - set(names)):
        raise Invalid(f"{path} is no bundle: it has no {', '.join(missing)}")
    if twice := [name for name, n in names.items() if n > 1]:
        raise Invalid(f"{path} is no bundle: it has {twice[0]} twice")
    if sum(member.compress_size for member in members) > path.stat().st_size:
        raise Invalid(f"{path} is no bundle: its members overlap")
    for member in members:
        most = {RESULTS: MOST_BYTES, MODEL_ARCHIVE: MOST_MODEL_BYTES}.get(
            member.filename, MOST_JSON_BYTES
        )
        if member.file_size > most or member.file_size > MOST_SHRUNK * (member.compress_size + 100):
            raise Invalid(
                f"{path} is no bundle: {member.filename} unpacks from {member.compress_size:,} to "
                f"{member.file_size:,} bytes, more than one ever does"
            )
        if member.flag_bits & 1:
            raise Invalid(f"{path} is no bundle: {member.filename} is encrypted")


def _json(path: Path, member: str, source: IO[bytes], digest: Any) -> Any:
    data = source.read(MOST_JSON_BYTES + 1)
    digest.update(data)
    try:
        return json.loads(data)
    except (ValueError, RecursionError) as error:
        raise Invalid(f"{path}: {member} is not JSON: {error}") from None


def _copy(source: IO[bytes], target: Path, digest: Any) -> None:
    with target.open("wb") as file:
        while chunk := source.read(_CHUNK):
            digest.update(chunk)
            file.write(chunk)


def _counted(results: Path) -> tuple[Counter[str], set[str]]:
    """Return how many results have each outcome, and who reported any."""
    outcomes, workers = Counter[str](), set[str]()
    with results.open(newline="") as file:
        for line in csv.DictReader(file):
            outcomes[line["outcome"]] += 1
            workers.add(line["worker"])
    return outcomes, workers


def _add(archive: zipfile.ZipFile, member: str, path: Path) -> None:
    # Without the hour of day, so that the same study gives the same bytes.
    info = zipfile.ZipInfo(member, date_time=(1980, 1, 1, 0, 0, 0))
    info.compress_type = zipfile.ZIP_DEFLATED
    info.external_attr = 0o644 << 16
    info.file_size = path.stat().st_size
    with path.open("rb") as source, archive.open(info, "w") as target:
        shutil.copyfileobj(source, target, _CHUNK)


def _text(content: Any) -> str:
    return json.dumps(content, indent=1, sort_keys=True, allow_nan=False) + "\n"


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file, 64 hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
