"""The Dockerfile and what docs/operate says of it, read as a container engine would."""

import json
import re
import shlex
import tomllib
from pathlib import Path

from server.settings import Settings

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
OPERATION = (ROOT / "docs" / "operate" / "fleet.md").read_text()
STATE = "/var/lib/rehyb"


def instructions() -> list[tuple[str, str]]:
    """Return (instruction, arguments) in order, without comments and continued lines in one."""
    text = (ROOT / "Dockerfile").read_text()
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    joined = "\n".join(lines).replace("\\\n", " ")
    return [(line.split(maxsplit=1)[0], line.split(maxsplit=1)[1]) for line in joined.splitlines()]


def arguments(name: str) -> list[str]:
    return [rest for instruction, rest in instructions() if instruction == name]


def test_the_recipe_is_one_that_an_engine_knows() -> None:
    known = {"FROM", "WORKDIR", "COPY", "RUN", "ENV", "VOLUME", "USER", "ENTRYPOINT"}
    assert {name for name, _ in instructions()} == known
    assert instructions()[0][0] == "FROM"
    minimum = PROJECT["project"]["requires-python"].removeprefix(">=")
    version = re.fullmatch(r"python:(\d+\.\d+)-slim", arguments("FROM")[0])
    assert version is not None
    assert tuple(map(int, version[1].split("."))) >= tuple(map(int, minimum.split(".")))


def test_everything_that_is_installed_is_copied_and_there() -> None:
    copied = {source for rest in arguments("COPY") for source in rest.split()[:-1]}
    assert all((ROOT / source).exists() for source in copied)
    packages = PROJECT["tool"]["setuptools"]["packages"]["find"]["include"]
    assert {package.rstrip("*") for package in packages} <= copied
    named = {PROJECT["project"]["readme"], *PROJECT["project"]["license-files"], "pyproject.toml"}
    assert named <= copied
    (run,) = arguments("RUN")
    extras = re.search(r"'\.\[([a-z,]+)\]'", run)
    assert extras is not None
    assert set(extras[1].split(",")) <= set(PROJECT["project"]["optional-dependencies"])


def test_it_does_not_run_as_root_and_writes_only_where_it_may() -> None:
    assert arguments("USER") == ["nobody"]
    assert f"install -d -o nobody {STATE}" in arguments("RUN")[0]
    environment = dict(word.split("=") for word in arguments("ENV")[0].split())
    # Where a worker keeps its spool by default, and where libraries put their caches.
    assert environment == {"HOME": STATE, "XDG_STATE_HOME": STATE}
    assert arguments("VOLUME") == [STATE]
    assert arguments("WORKDIR")[-1] == STATE


def test_what_it_starts_is_installed() -> None:
    (entry,) = arguments("ENTRYPOINT")
    assert json.loads(entry) == ["rehyb"]
    assert "rehyb" in PROJECT["project"]["scripts"]


def test_the_documented_line_starts_a_worker_that_keeps_its_results() -> None:
    (line,) = re.findall(r"^docker run .*$", OPERATION, re.M)
    words = shlex.split(line)
    given = {
        option: words[words.index(option) + 1]
        for option in ("--entrypoint", "-e", "--env-file", "-v", "--stop-timeout")
    }
    assert given["--entrypoint"] in PROJECT["project"]["scripts"]
    assert given["-e"].split("=")[0] == "REHYB_URL"
    assert given["-e"].endswith(f":{Settings.model_fields['port'].default}")
    assert given["-v"].endswith(f":{STATE}")
    # As long as systemd's unit above it gives a worker to finish.
    assert f"TimeoutStopSec={given['--stop-timeout']}\n" in OPERATION
    assert given["--env-file"] in OPERATION.split("## In containers")[0]
    # What follows the image's name goes to the worker.
    assert words[words.index("rehyb") :] == ["rehyb", "--memory-mb", "1500"]
