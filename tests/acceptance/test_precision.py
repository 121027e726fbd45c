"""A study that is told how precise to be grows on a real fleet, and its bundle is checked."""

import json
import os
import subprocess
import sys
from pathlib import Path

from rehyb import Client
from tests.testbed.fleet.warm import WarmFleet

#: Runs the command where no extra is installed, as on the machine of a reader of a paper.
BASE_ONLY = """
import sys
for extra in ("fastapi", "sqlalchemy", "matplotlib", "sklearn", "openturns", "pyarrow"):
    sys.modules[extra] = None
from rehyb.cli import main
sys.argv = ["rehyb", *sys.argv[1:]]
main()
"""


def test_a_study_grows_to_its_precision_and_its_bundle_holds(tmp_path: Path) -> None:
    with WarmFleet(tmp_path / "fleet", workers=2) as fleet:
        environment = {**os.environ, "REHYB_URL": fleet.url, "REHYB_TOKEN": fleet.token}

        def run(*arguments: str) -> "subprocess.CompletedProcess[str]":
            return subprocess.run(
                [sys.executable, "-m", "rehyb", *arguments],
                env=environment,
                cwd=tmp_path,
                capture_output=True,
                text=True,
                timeout=180,
                check=False,
            )

        study = ("study", "submit", "--model", "ishigami", "--method", "saltelli", "--rows", "64")
        ran = run(*study, "--target", "0.1", "--up-to", "4096", "--json")
        assert ran.returncode == 0, ran.stderr
        answer = json.loads(ran.stdout)
        assert answer["reached"] and "is extended to 128 rows" in ran.stderr
        with Client(fleet.url, fleet.token) as client:
            progress = client.progress(answer["id"])
            snapshot = client.indices(answer["id"])
        assert progress["state"] == "complete"
        assert progress["rows"] == answer["rows"] == snapshot["rows_complete"]
        assert progress["precision"]["reached"] and progress["precision"]["settled"]
        factors = snapshot["outputs"]["y"]["factors"].values()
        for index in ("first_order", "total_order"):
            assert all(f[index]["high"] - f[index]["low"] <= 0.2 for f in factors)
        assert run("bundle", answer["id"], "--out", "b.zip").returncode == 0
    checked = subprocess.run(
        [sys.executable, "-c", BASE_ONLY, "reproduce", "b.zip", "--check", "--sample", "50"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=180,
        check=False,
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr
    assert checked.stdout.count("bit for bit") == 3
