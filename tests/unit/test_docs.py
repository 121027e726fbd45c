"""What README and docs name exists: targets, commands, routes, settings, outputs, links."""

import re
import subprocess
from pathlib import Path

import pytest
from pydantic import SecretStr
from typer.testing import CliRunner

from rehyb.cli import app
from server.app import create_app
from server.settings import Settings
from sim.assessment.validity import FAILURES
from sim.models import ELBOW
from sim.parameters.conditions import CONDITIONS
from sim.robot.device import DEVICES

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
ARCHITECTURE = (ROOT / "docs" / "understand" / "architecture.md").read_text()
SIMULATION = (ROOT / "docs" / "understand" / "simulation.md").read_text()
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def test_every_make_target_in_the_readme_exists_and_says_what_it_does() -> None:
    help_text = subprocess.run(
        ["make", "help"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    for target in set(re.findall(r"\bmake ([a-z]+)\b", README)):
        assert f"make {target} " in help_text or target == "help"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_leads_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text()):
        if "://" not in target:
            assert (page.parent / target).exists(), target


def test_every_rehyb_command_in_the_readme_exists() -> None:
    code = "\n".join(
        re.findall(r"`([^`\n]+)`", README) + re.findall(r"```sh\n(.*?)```", README, re.S)
    )
    commands = set(re.findall(r"\brehyb ((?:study |campaign )?[a-z-]+)", code))
    lists = re.findall(r"rehyb study ([a-z]+(?:\|[a-z]+)+)", README)
    assert lists
    commands |= {f"study {verb}" for verbs in lists for verb in verbs.split("|")}
    assert {"up", "assess", "validate", "study submit", "study indices"} <= commands
    for command in commands:
        ran = CliRunner().invoke(app, [*command.split(), "--help"])
        assert ran.exit_code == 0, f"rehyb {command}: {ran.output}"


def test_every_documented_route_is_served_and_every_route_is_documented(tmp_path: Path) -> None:
    settings = Settings(database_url=f"sqlite:///{tmp_path}/db", token=SecretStr("t"))
    paths = create_app(settings).openapi()["paths"]
    served = {
        f"{method.upper()} {re.sub(r'{[a-z_]+}', '{id}', path)}"
        for path, methods in paths.items()
        for method in methods
    }
    documented = set()
    for row in re.findall(r"^\| (`(?:GET|POST|DELETE) .*?) \|", ARCHITECTURE, flags=re.MULTILINE):
        verb = "GET"
        for word in re.findall(r"`([^`]+)`", row):
            verb, _, path = word.rpartition(" ") if " " in word else (verb, "", word)
            documented.add(f"{verb} {path}")
    assert served == documented


def test_every_setting_is_in_the_readme() -> None:
    for name in Settings.model_fields:
        assert f"REHYB_{name.upper()}" in README


def test_every_output_and_failure_is_explained() -> None:
    for output in ELBOW.outputs:
        assert output.removesuffix("_paper").removesuffix("_authors") in README
    for failure in FAILURES:
        assert f"`{failure}`" in SIMULATION


def test_every_condition_and_every_device_is_explained() -> None:
    for factor in CONDITIONS:
        assert f"| `{factor.name}` |" in SIMULATION
    for device in DEVICES:
        assert f"`{device}`" in (ROOT / "docs" / "use" / "devices.md").read_text()
