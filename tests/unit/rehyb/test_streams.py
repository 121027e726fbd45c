"""What is printed where standard output has no μ."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

PRINTS = """
from rehyb.cli import main
from rehyb.cli.answers import Answer, answering
from rehyb.cli import app

@app.command()
@answering
def told() -> Answer:
    return Answer({"what": "\\u03bc* of Zo\\xeb"}, lambda: print("\\u03bc* of Zo\\xeb"))

main()
"""


@pytest.mark.parametrize(("options", "said"), [((), r"\u03bc* of Zo\xeb"), (("--json",), None)])
def test_what_an_encoding_lacks_is_escaped(options: tuple[str, ...], said: str | None) -> None:
    environment = os.environ | {"LC_ALL": "C", "PYTHONIOENCODING": "ascii"}
    ran = subprocess.run(
        [sys.executable, "-c", PRINTS, "told", *options],
        env=environment,
        cwd=Path(__file__).parents[3],
        capture_output=True,
        check=False,
    )
    assert (ran.returncode, ran.stderr) == (0, b"")
    if said is None:
        assert json.loads(ran.stdout.decode("ascii")) == {"what": "μ* of Zoë"}
    else:
        assert ran.stdout.decode("ascii").strip() == said
