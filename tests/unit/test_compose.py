"""docker-compose.yml, read as Compose reads it: what it starts exists, and it is one system."""

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from server.settings import Settings

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docker-compose.yml").read_text()
COMPOSE: dict[str, Any] = yaml.safe_load(TEXT)
SERVICES: dict[str, dict[str, Any]] = COMPOSE["services"]
#: Of the Compose specification; a misspelt key would be refused by it, but not by YAML.
KEYS = {
    "build",
    "command",
    "depends_on",
    "entrypoint",
    "environment",
    "hostname",
    "image",
    "ports",
    "profiles",
    "restart",
    "stop_grace_period",
    "volumes",
}


def test_there_are_a_coordinator_an_analysis_workers_and_on_demand_a_postgresql() -> None:
    assert set(SERVICES) == {"coordinator", "analysis", "worker", "db"}
    assert {name for name, service in SERVICES.items() if "profiles" in service} == {"db"}
    assert "container_name" not in TEXT, "then `--scale worker=4` would not work"


@pytest.mark.parametrize("name", SERVICES)
def test_a_service_uses_what_is_defined(name: str) -> None:
    service = SERVICES[name]
    assert set(service) <= KEYS
    assert ("build" in service) != ("image" in service)
    assert set(service.get("depends_on", [])) <= set(SERVICES)
    for volume in service.get("volumes", []):
        assert volume.split(":")[0] in COMPOSE["volumes"]


@pytest.mark.parametrize("name", ["coordinator", "analysis", "worker"])
def test_a_service_of_ours_is_built_here_and_configured_with_settings_that_exist(name: str) -> None:
    service = SERVICES[name]
    assert (ROOT / service["build"] / "Dockerfile").exists()
    known = {f"REHYB_{field.upper()}" for field in Settings.model_fields} | {"REHYB_URL"}
    assert set(service["environment"]) <= known
    assert service.get("command", "coordinator") in ("coordinator", "analysis")


def test_the_coordinator_is_open_to_this_machine_only_and_found_by_the_others() -> None:
    (port,) = SERVICES["coordinator"]["ports"]
    assert port == "127.0.0.1:8787:8787"
    assert SERVICES["worker"]["environment"]["REHYB_URL"] == "http://coordinator:8787"
    assert Settings.model_fields["port"].default == 8787


def test_coordinator_and_analysis_share_a_database_and_no_secret_is_written_down() -> None:
    coordinator, analysis = SERVICES["coordinator"], SERVICES["analysis"]
    assert coordinator["volumes"] == analysis["volumes"]
    name = "REHYB_DATABASE_URL"
    assert coordinator["environment"][name] == analysis["environment"][name]
    assert coordinator["environment"]["REHYB_TOKEN"].startswith("${REHYB_TOKEN:?")


def test_every_variable_has_a_default_or_a_sentence() -> None:
    for variable in re.findall(r"\$\{([^}]*)\}", TEXT):
        assert re.search(r":[-?].", variable), variable
