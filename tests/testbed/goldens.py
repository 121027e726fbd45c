"""What a user sees, as text files, so that two trees of rehyb can be compared by `diff -r`.

`python -m tests.testbed.goldens FOLDER [help] [openapi] [assess] [study] [sessions]` writes all
parts, or those that are named. Run it in both trees with the same versions of the libraries on the
same machine: a restructuring changes nothing. Identifiers, dates and durations are left out. About
four minutes of two idle cores.
"""

import csv
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow.parquet
import typer
from pydantic import SecretStr
from typer.testing import CliRunner

import rehyb.cli
import worker.cli
from rehyb import Client
from rehyb.fleet import LocalFleet
from server.app import create_app
from server.settings import Settings
from tests.testbed.sessions.synthetic import write_session

#: Terminal and threads change what is printed, and the last bits of sums.
FIXED = {"COLUMNS": "100", "TERM": "dumb", "NO_COLOR": "1", "OPENBLAS_NUM_THREADS": "1"}
#: Differs between two runs of the same tree.
VOLATILE = {"id", "study", "created_at", "updated_at", "edition", "wall_seconds", "seq", "worker"}
VOLATILE |= {"host", "host_class", "received_at"}
ASSESSMENTS: tuple[tuple[str, ...], ...] = (
    (),
    ("--fidelity", "screening"),
    ("--target", "shoulder_flexion"),
    ("--device", "elbow_orthosis"),
    ("--set", "effect.coulomb_friction.torque=0.5"),
    ("--set", "forearm_mass=10", "--outside-range"),
)
STUDIES: dict[str, dict[str, Any]] = {
    "ishigami_morris": {"model": "ishigami", "method": "morris", "rows": 40},
    "ishigami_saltelli": {"model": "ishigami", "method": "saltelli", "rows": 128},
    "ishigami_pairs": {"model": "ishigami", "method": "saltelli_second_order", "rows": 64},
    "bushing_morris": {"model": "elbow_bushing", "method": "morris", "rows": 6},
    "bushing_saltelli": {"model": "elbow_bushing", "method": "saltelli", "rows": 16},
}
#: One session of each verdict and of each way to be named.
SESSIONS: dict[str, tuple[str, ...]] = {
    "adequate": (),
    "one": ("coulomb_friction",),
    "two": ("coulomb_friction", "payload"),
    "between": ("torque_gain",),
    "unexplained": ("tremor",),
}
SECONDS = 300.0


def printed(*arguments: str) -> str:
    """Return what `rehyb` prints, or what it says where it fails."""
    command = [sys.executable, "-m", "rehyb", *arguments]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    return ran.stdout or ran.stderr


def steady(record: dict[str, Any]) -> str:
    """Return a record as JSON without what differs between two runs."""
    kept = {key: value for key, value in record.items() if key not in VOLATILE}
    return json.dumps(kept, indent=1, sort_keys=True)


def help_texts() -> Iterator[tuple[str, str]]:
    """Yield the help of every command."""

    def walk(app: typer.Typer, command: Any, words: list[str]) -> Iterator[tuple[str, str]]:
        ran = CliRunner().invoke(app, [*words[1:], "--help"], prog_name=words[0])
        yield f"help/{'_'.join(words)}.txt", ran.output
        for name, inner in sorted(getattr(command, "commands", {}).items()):
            yield from walk(app, inner, [*words, name])

    for name, app in (("rehyb", rehyb.cli.app), ("rehyb-worker", worker.cli.app)):
        yield from walk(app, typer.main.get_command(app), [name])


def openapi() -> Iterator[tuple[str, str]]:
    """Yield the schema of the REST interface."""
    with tempfile.TemporaryDirectory() as folder:
        settings = Settings(database_url=f"sqlite:///{folder}/db", token=SecretStr("t"))
        yield "openapi.json", steady(create_app(settings).openapi())


def assessments() -> Iterator[tuple[str, str]]:
    """Yield single assessments."""
    for options in ASSESSMENTS:
        name = "_".join(options).replace("--", "").replace("=", "_") or "nominal"
        yield f"assess/{name}.json", steady(json.loads(printed("assess", "--json", *options)))


def studies() -> Iterator[tuple[str, str]]:
    """Yield studies as JSON, as printed, and their results as CSV and Parquet."""
    with (
        tempfile.TemporaryDirectory() as name,
        LocalFleet(Path(name), workers=2) as fleet,
        Client(fleet.url, fleet.token) as client,
    ):
        for title, request in STUDIES.items():
            study = client.submit({"name": title, "seed": 5, **request})
            deadline = time.monotonic() + SECONDS
            while (indices := client.indices(study["id"]))["rows_complete"] < study["rows"]:
                fleet.supervise()
                assert time.monotonic() < deadline, f"{title} was not done in {SECONDS} s"
                time.sleep(0.2)
            yield f"study/{title}.study.json", steady(study)
            yield f"study/{title}.indices.json", steady(indices)
            where = ("--url", fleet.url, "--token", fleet.token)
            text = printed("study", "indices", study["id"], *where)
            yield f"study/{title}.printed.txt", text.replace(study["id"], "ID")
            file = Path(name) / title
            client.results_csv(study["id"], file)
            with file.open() as table:
                yield f"study/{title}.csv.txt", _in_order(list(csv.DictReader(table)))
            printed(
                "study", "export", study["id"], "--format", "parquet", "--out", f"{file}.p", *where
            )
            read = pyarrow.parquet.read_table(f"{file}.p")
            schema = str(read.schema.remove_metadata())
            yield f"study/{title}.parquet.txt", f"{schema}\n{_in_order(read.to_pylist())}"


def _in_order(rows: list[dict[str, Any]]) -> str:
    header = ",".join(rows[0])
    ordered = sorted(rows, key=lambda row: (int(row["row"]), int(row["position"])))
    return "\n".join([header, *map(steady, ordered)])


def sessions() -> Iterator[tuple[str, str]]:
    """Yield what closing the loop writes, the page as its words."""
    for name, effects in SESSIONS.items():
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "out"
            write_session(Path(folder) / name, 3, effects)
            printed("close-loop", str(Path(folder) / name), "--out", str(out))
            for file in ("report.json", "model_after.xml"):
                yield f"sessions/{name}/{file}", (out / file).read_text()
            digest = hashlib.sha256((out / "residuals.csv").read_bytes()).hexdigest()
            yield f"sessions/{name}/residuals.sha256", digest
            page = re.sub(
                r"(?s)<(style|script).*?</\1>|<[^>]+>", " ", (out / "report.html").read_text()
            )
            yield f"sessions/{name}/page.txt", re.sub(r"\s+", " ", page)


PARTS = {
    "help": help_texts,
    "openapi": openapi,
    "assess": assessments,
    "study": studies,
    "sessions": sessions,
}


def main(folder: Path, names: list[str]) -> None:
    os.environ.update(FIXED)
    for name in names or PARTS:
        for path, content in PARTS[name]():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_text(content)
        print(f"{name}: written", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
