"""What README and docs name exists: targets, commands, routes, settings, outputs, links."""

import ast
import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path
from unittest.mock import MagicMock, create_autospec

import pytest
from pydantic import SecretStr
from typer.testing import CliRunner

import rehyb
from analysis.designs.distributions import Distribution
from analysis.sensitivity.judgement.trust import FEWEST_ROWS
from benchmarks.measurement import BEGIN, END
from rehyb import Client
from rehyb.cli import app
from server.app import create_app
from server.logic.study.plans import FactorChoice
from server.routes.study.studies import StudyBody
from server.settings import Settings
from sim.assessment.validity import FAILURES
from sim.effects.catalogue import BY_NAME, OF_ROBOTS
from sim.models import ELBOW, MODELS
from sim.parameters.conditions import CONDITIONS
from sim.robot.device import DEVICES
from tests.testbed import arrows
from tests.testbed.coordinators import records

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
DOCS = ROOT / "docs"
REST = (DOCS / "use" / "rest.md").read_text()
SETTINGS = (DOCS / "operate" / "settings.md").read_text()
NAMED_FAILURES = (DOCS / "understand" / "failures.md").read_text()
INDICES = [DOCS / "README.md", *sorted(DOCS.glob("*/README.md"))]
PAGES = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
#: Of every page, in Python.
EXAMPLES = [
    (page, code)
    for page in PAGES
    for code in re.findall(r"^```python\n(.*?)^```", page.read_text(), re.M | re.S)
]
#: Words of a page that is read in one sitting, without figures that a command wrote.
MOST_WORDS = 1500


def test_every_make_target_in_the_readme_exists_and_says_what_it_does() -> None:
    help_text = subprocess.run(
        ["make", "help"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    for target in set(re.findall(r"\bmake ([a-z]+)\b", README)):
        assert f"make {target} " in help_text or target == "help"


def test_every_model_that_ships_is_named_where_a_study_chooses_one() -> None:
    text = (DOCS / "use" / "studies.md").read_text()
    table = text.partition("## Choose a model\n")[2].partition("\n## ")[0]
    named = {
        name for row in table.splitlines() if row.startswith("| `") for name in _names(row[2:])
    }
    assert set(MODELS) <= named


def _names(row: str) -> list[str]:
    return re.findall(r"`([a-z_0-9]+)`", row.partition(" | ")[0])


def test_the_readme_s_example_asks_for_rows_enough_and_prints_whether_to_trust_them() -> None:
    (code,) = re.findall(r"```python\n(.*?)```", README, re.S)
    assert min(map(int, re.findall(r'"rows": (\d+)', code))) >= FEWEST_ROWS
    assert '["trust"]["sentence"]' in code


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
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
        f"{method.upper()} {re.sub(r'{(?!row|position)[a-z_]+}', '{id}', path)}"
        for path, methods in paths.items()
        for method in methods
    }
    documented = set()
    for row in re.findall(r"^\| (`(?:GET|POST|DELETE) .*?) \|", REST, flags=re.MULTILINE):
        verb = "GET"
        for word in re.findall(r"`([^`]+)`", row):
            verb, _, path = word.rpartition(" ") if " " in word else (verb, "", word)
            documented.add(f"{verb} {path}")
    assert served == documented


def test_every_setting_is_documented_and_named_by_the_command_that_it_is_for() -> None:
    said = CliRunner().invoke(app, ["coordinator", "--help"]).output
    for name in Settings.model_fields:
        assert f"`REHYB_{name.upper()}`" in SETTINGS
        assert re.search(rf"\bREHYB_{name.upper()}\b", said), name


def test_every_output_and_failure_is_explained() -> None:
    suffix = r"_(paper|authors|upper_arm|forearm)$"
    for output in ELBOW.outputs:
        assert re.sub(suffix, "", output) in README
    for failure in FAILURES:
        assert f"`{failure}`" in NAMED_FAILURES


def test_every_effect_is_explained_with_its_parameters_and_their_units() -> None:
    page = (DOCS / "use" / "effects.md").read_text()
    rows = dict(re.findall(r"^\| (`[a-z_]+`(?: \([a-z]+\))?) \| (.*) \|$", page, re.M))
    laws = [(effect, " (limb)" if effect.limb else "") for effect in BY_NAME.values()]
    laws += [(effect, " (robot)") for effect in OF_ROBOTS]
    assert rows.keys() == {f"`{effect.name}`{where}" for effect, where in laws}
    for effect, where in laws:
        told = [f"`{name}` ({p.unit}) {p.description}" for name, p in effect.parameters.items()]
        expected = f"{effect.signature} | {'; '.join(told)}"
        assert rows[f"`{effect.name}`{where}"] == expected


def test_every_condition_and_every_device_is_explained() -> None:
    conditions = (DOCS / "understand" / "conditions.md").read_text()
    for factor in CONDITIONS:
        assert f"| `{factor.name}` | {factor.unit} |" in conditions
    for device in DEVICES:
        assert f"`{device}`" in (DOCS / "use" / "devices.md").read_text()


def test_every_page_is_in_an_index() -> None:
    linked = {
        (index.parent / target.split("#")[0]).resolve()
        for index in INDICES
        for target in re.findall(r"\]\(([^)]+\.md)", index.read_text())
    }
    # The help of `rehyb assess --device` names this one, which points on.
    assert set(PAGES) - linked == {DOCS / "devices.md"}


@pytest.mark.parametrize(
    ("page", "code"), EXAMPLES, ids=[f"{page.stem}{n}" for n, (page, _) in enumerate(EXAMPLES)]
)
def test_every_example_calls_what_there_is(
    page: Path, code: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Others' packages are not called, and a coordinator's answers are empty."""
    client = create_autospec(Client)
    inside = client.return_value.__enter__.return_value = client.return_value
    monkeypatch.setattr(rehyb, "Client", client)
    for name in ("pandas", "xarray"):
        monkeypatch.setitem(sys.modules, name, MagicMock())
    exec(compile(code, str(page), "exec"), {})
    assert client.called or "Client" not in code
    for call in inside.submit.call_args_list:
        asked = StudyBody.model_validate(call.args[0]).model_dump(exclude_unset=True)
        factors = [FactorChoice(**factor) for factor in asked.pop("factors", ())]
        assert records.plan(**asked, factors=factors or None, sampling="sobol_blocks").rows


def test_the_page_of_studies_has_every_distribution() -> None:
    said = re.findall(r"^\| `({\"kind\".*?})` \|", (DOCS / "use" / "studies.md").read_text(), re.M)
    found = [Distribution.from_json(json.loads(one)) for one in said]
    assert {type(one) for one in found} == set(Distribution.__subclasses__())


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_page_is_short(page: Path) -> None:
    text = re.sub(f"{BEGIN}.*?{END}", "", page.read_text(), flags=re.DOTALL)
    assert len(text.split()) < MOST_WORDS


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_code_that_a_page_names_exists(page: Path) -> None:
    text = page.read_text()
    for name in re.findall(r"`([\w/]+/\w+\.(?:py|xml|js))`", text):
        assert (ROOT / name).is_file(), name
    for name in re.findall(r"python -m ((?:benchmarks|sim|tests)[\w.]+)", text):
        assert importlib.util.find_spec(name) is not None, name


def test_pages_that_code_names_exist() -> None:
    rooms = ("rehyb", "sim", "analysis", "server", "worker", "migrations", "benchmarks", "tests")
    for path in (path for room in rooms for path in (ROOT / room).rglob("*.py")):
        for name in re.findall(r"\bdocs/[a-z0-9_/-]+", path.read_text()):
            found = (ROOT / name).is_dir() or (ROOT / f"{name}.md").is_file()
            assert found or list(ROOT.glob(f"{name}-*.md")) or path == Path(__file__), (path, name)


def test_every_step_of_a_walk_exists() -> None:
    steps = re.findall(r"`([\w/]+\.py):([\w.]+)`", (DOCS / "understand" / "walks.md").read_text())
    assert steps
    for file, name in steps:
        found: ast.AST | None = ast.parse((ROOT / file).read_text())
        for part in name.split("."):
            inside = getattr(found, "body", ())
            found = next((node for node in inside if getattr(node, "name", None) == part), None)
        assert found is not None, f"{file}:{name}"


@pytest.mark.parametrize("page", arrows.PAGES, ids=lambda page: page.name)
def test_the_drawing_is_that_of_the_contracts(page: Path) -> None:
    text = page.read_text()
    picture = arrows.drawing(arrows.contracts())
    assert arrows.drawn(text, picture) == text, "run python -m tests.testbed.arrows"


def test_a_drawing_says_what_a_room_may_import_and_its_layers() -> None:
    linter = {
        "root_packages": ["a", "b", "c"],
        "contracts": [
            {"type": "forbidden", "source_modules": ["a"], "forbidden_modules": ["b", "c"]},
            {"type": "forbidden", "source_modules": ["b"], "forbidden_modules": ["c.heavy"]},
            {"type": "layers", "containers": ["b"], "layers": ["top", "(mid)", "x | y"]},
        ],
    }
    assert arrows.drawing(linter).splitlines() == [
        "a -> nothing of ours",
        "b -> a, c (without heavy)",
        "c -> a, b",
        "",
        "b =  top -> mid -> x | y",
    ]
