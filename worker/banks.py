"""The bank by which a worker interprets: a file of its machine, looked at once, when it starts."""

import json
import logging
import subprocess
from pathlib import Path

from models.processes import python
from rehyb.errors import Invalid
from rehyb.interpretation import bank_file

log = logging.getLogger(__name__)

#: Seconds that a bank may take to be read.
READ_SECONDS = 120.0


def usable_bank(chosen: Path | None) -> tuple[str, Path] | None:
    """Return a bank's id and its file; None if none was `chosen` and there is none to use.

    A process of its own reads it: this one loads no NumPy.

    Raises:
        Invalid: the file that was chosen is no bank.
    """
    path = bank_file(chosen).resolve()
    if chosen is None and not path.exists():
        return None
    command = python("-m", "rehyb", "bank", "show", "--bank", str(path), "--json")
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=READ_SECONDS, check=False
        )
        said = done.stderr.strip().removeprefix("rehyb: ")
        if done.returncode == 0:
            return str(json.loads(done.stdout)["id"]), path
    except subprocess.TimeoutExpired:
        said = f"{path} takes longer than {READ_SECONDS:g} s to read"
    if chosen is not None:
        raise Invalid(said)
    log.warning("nothing is interpreted here: %s", said)
    return None
