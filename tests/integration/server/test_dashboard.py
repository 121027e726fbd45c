"""The Grafana dashboard asks for metrics that the coordinator has, and leaves none out."""

import json
import re
from pathlib import Path

from fastapi import FastAPI
from fastapi.testclient import TestClient
from prometheus_client.parser import text_string_to_metric_families

FILE = Path(__file__).parents[3] / "deploy" / "grafana" / "rehyb.json"


def test_the_dashboard_shows_every_metric_there_is_and_no_other(
    app: FastAPI, client: TestClient
) -> None:
    panels = json.loads(FILE.read_text())["panels"]
    asked = [target["expr"] for panel in panels for target in panel["targets"]]
    named = {name for expression in asked for name in re.findall(r"\brehyb_\w+", expression)}
    told = text_string_to_metric_families(client.get("/metrics").text)
    # When each was made is told too, and interests nobody.
    families = [family for family in told if not family.name.endswith("_created")]
    suffixes = re.compile(r"_(total|bucket)$")
    assert {suffixes.sub("", name) for name in named} == {family.name for family in families}
    for family in families:
        ending = {"counter": "_total", "histogram": "_bucket"}.get(family.type, "")
        assert family.name + ending in named
    labels = {label for e in asked for label in re.findall(r"by \((\w+)\)", e)}
    assert labels == {"state", "verdict", "outcome", "le"}
    assert len({panel["id"] for panel in panels}) == len(panels)
