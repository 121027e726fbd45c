"""The manifests for Kubernetes: what they say is allowed, hangs together, and holds no secret."""

from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml
from typer.main import get_command

from server.settings import Settings
from worker.cli import app as worker_app

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "deploy" / "kubernetes"
Json = dict[str, Any]
FILES = [file.read_text() for file in sorted(FOLDER.glob("*.yaml"))]
OBJECTS: list[Json] = [thing for text in FILES for thing in yaml.safe_load_all(text)]
#: KEDA's own kinds; of its ScaledJob, what it makes is a Job.
KEDA = "keda.sh/v1alpha1"
OWN = [thing for thing in OBJECTS if thing["apiVersion"] != KEDA]
(SCALED,) = (thing for thing in OBJECTS if thing["kind"] == "ScaledJob")
JOB = {
    "apiVersion": "batch/v1",
    "kind": "Job",
    "metadata": SCALED["metadata"],
    "spec": SCALED["spec"]["jobTargetRef"],
}
WITH_PODS = [thing for thing in (*OWN, JOB) if "template" in thing.get("spec", {})]
SERVICES = [thing for thing in OWN if thing["kind"] == "Service"]
#: What programs of ours read from the environment.
READ = {f"REHYB_{field.upper()}" for field in Settings.model_fields} | {"REHYB_URL", "REHYB_BANK"}


def title(thing: Json) -> str:
    return f"{thing['kind']} {thing['metadata']['name']}"


def pod(thing: Json) -> Json:
    return dict(thing["spec"]["template"]["spec"])


def told_of(service: Json) -> set[str]:
    """Return the variables that each pod gets for a service, unless its service links are off."""
    if service["spec"].get("clusterIP") == "None":
        return set()
    name = service["metadata"]["name"].upper().replace("-", "_")
    found = {f"{name}_SERVICE_HOST", f"{name}_SERVICE_PORT", f"{name}_PORT"}
    for port in service["spec"]["ports"]:
        named = port["name"].upper().replace("-", "_")
        link = f"{name}_PORT_{port['port']}_{port.get('protocol', 'TCP')}"
        found |= {f"{name}_SERVICE_PORT_{named}", link}
        found |= {f"{link}_{part}" for part in ("PROTO", "PORT", "ADDR")}
    return found


@pytest.mark.parametrize("thing", [*OWN, JOB], ids=title)
def test_kubernetes_would_take_it(thing: Json) -> None:
    version = kubernetes_validate.latest_version()
    kubernetes_validate.validate(thing, version, strict=True)


@pytest.mark.parametrize("thing", WITH_PODS, ids=title)
def test_a_pod_may_do_little_and_use_so_much(thing: Json) -> None:
    spec = pod(thing)
    assert spec["securityContext"]["runAsNonRoot"] is True
    assert spec["automountServiceAccountToken"] is False
    for container in spec["containers"]:
        security = container["securityContext"]
        assert security["readOnlyRootFilesystem"] is True
        assert security["allowPrivilegeEscalation"] is False
        assert security["capabilities"] == {"drop": ["ALL"]}
        assert {*container["resources"]["limits"]} == {"cpu", "memory"}
        mounted = {mount["name"] for mount in container["volumeMounts"]}
        claimed = thing["spec"].get("volumeClaimTemplates", [])
        there = [*spec["volumes"], *(claim["metadata"] for claim in claimed)]
        assert mounted == {volume["name"] for volume in there}


@pytest.mark.parametrize("thing", WITH_PODS, ids=title)
def test_what_serves_is_probed_and_secrets_come_from_the_secret(thing: Json) -> None:
    for container in pod(thing)["containers"]:
        if container.get("ports"):
            assert {"readinessProbe", "livenessProbe"} <= set(container)
        for variable in container["env"]:
            name = variable["name"]
            if any(word in name for word in ("TOKEN", "PASSWORD", "DATABASE_URL")):
                assert variable["valueFrom"]["secretKeyRef"]["name"] == "rehyb"
            if name.startswith("REHYB_"):
                assert name in ("REHYB_URL", "REHYB_WORKER_GROUP") or name.removeprefix(
                    "REHYB_"
                ).lower() in (Settings.model_fields)
    assert "kind: Secret" not in "".join(FILES)


def test_a_service_is_named_like_a_setting_of_ours() -> None:
    # Which is why pods must not be told of services; without one they might be.
    assert set().union(*map(told_of, SERVICES)) & READ == {"REHYB_PORT"}


@pytest.mark.parametrize("thing", WITH_PODS, ids=title)
def test_no_pod_takes_the_address_of_a_service_for_a_setting(thing: Json) -> None:
    spec = pod(thing)
    told = set().union(*map(told_of, SERVICES)) if spec.get("enableServiceLinks", True) else set()
    assert not told & READ


def test_services_and_budgets_find_pods_and_urls_find_services() -> None:
    labels = [thing["spec"]["template"]["metadata"]["labels"] for thing in WITH_PODS]
    ports = {}
    for thing in OWN:
        if thing["kind"] == "Service":
            assert thing["spec"]["selector"] in labels
            ports[thing["metadata"]["name"]] = thing["spec"]["ports"][0]["port"]
        if thing["kind"] == "PodDisruptionBudget":
            assert thing["spec"]["selector"]["matchLabels"] in labels
    assert ports["rehyb"] == Settings.model_fields["port"].default
    for thing in WITH_PODS:
        for variable in pod(thing)["containers"][0]["env"]:
            if variable["name"] == "REHYB_URL":
                assert variable["value"] == f"http://rehyb:{ports['rehyb']}"


def test_workers_are_started_with_options_that_exist() -> None:
    known = {option for parameter in get_command(worker_app).params for option in parameter.opts}
    workers = [thing for thing in WITH_PODS if thing["kind"] == "Job"]
    assert len(workers) == 2 and pod(workers[0]) == pod(workers[1])
    arguments = pod(workers[0])["containers"][0]["args"]
    assert {argument for argument in arguments if argument.startswith("--")} <= known
    cores = arguments[arguments.index("--processes") + 1]
    assert pod(workers[0])["containers"][0]["resources"]["limits"]["cpu"] == cores


def test_keda_asks_what_the_coordinator_tells() -> None:
    (trigger,) = SCALED["spec"]["triggers"]
    about = trigger["metadata"]
    (container,) = SCALED["spec"]["jobTargetRef"]["template"]["spec"]["containers"]
    (group,) = (one["value"] for one in container["env"] if one["name"] == "REHYB_WORKER_GROUP")
    # Of what its own workers may have: no others come of it.
    assert about["url"].endswith(f":8787/v1/work?group={group}")
    assert about["valueLocation"] == "waiting"
    (login,) = (thing for thing in OBJECTS if thing["kind"] == "TriggerAuthentication")
    assert trigger["authenticationRef"]["name"] == login["metadata"]["name"]
    assert login["spec"]["secretTargetRef"][0]["name"] == "rehyb"
