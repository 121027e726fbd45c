"""What this machine is, as far as it decides which bits a simulation comes out with."""

import json
import os
import re
import secrets
import socket
import subprocess
from pathlib import Path

from models.processes import python
from rehyb.errors import Invalid, RehybError
from sim.evaluation import code, versions

#: Seconds the canary may take: half a second of simulation, and MuJoCo's first start from a disk
#: that sleeps.
CANARY_SECONDS = 120.0
#: x86-64 and ARM. More of them would only part machines that compute the same bits.
VECTOR_FLAGS = ("sse4_2", "avx", "avx2", "fma", "avx512f", "asimd", "sve")
_GROUP = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,39}")
#: Evaluates the nominal elbow and prints a digest of the bits of its outputs. Rehyb's own models
#: are described there, too, since that loads NumPy.
_CANARY = """
import hashlib, json, time
from sim.evaluation import evaluate
from sim.models import MODELS
done = evaluate("elbow", {})
bits = json.dumps([done.outcome, [float(value).hex() for value in done.outputs.values()]])
own = [model.version for model in MODELS.values()]
print(json.dumps([hashlib.sha256(bits.encode()).hexdigest()[:16], done.wall_seconds, own]))
"""


class CanaryError(RehybError):
    """This machine cannot evaluate the nominal elbow."""


def new_id(group: str) -> str:
    """Return what a coordinator shall call this worker, which no other is called.

    Args:
        group: of workers alike, for whoever starts them (REHYB_WORKER_GROUP); empty: of none.

    Raises:
        Invalid: the id names a file, and the group cannot be part of that.
    """
    if group and not _GROUP.fullmatch(group):
        raise Invalid(f"REHYB_WORKER_GROUP is up to 40 letters, digits and ._-, not {group[:60]!r}")
    # A host may be called anything; an @ is after a group only, and a coordinator takes no id that
    # begins with a dash.
    host = re.sub(r"[^A-Za-z0-9._-]", "-", socket.gethostname()).lstrip("-") or "host"
    made = f"{host}-{os.getpid()}-{secrets.token_hex(3)}"
    return f"{group}@{made}" if group else made


def describe() -> tuple[dict[str, str], list[str]]:
    """Return the versions of all that decides the bits, and of rehyb's own models.

    Among the former is a digest of some of the bits; the latter are "name@digest".

    Raises:
        CanaryError: the nominal elbow cannot be evaluated here.
    """
    digest, _, own = canary()
    return {**versions(), "cpu": cpu(), "code": code(), "canary": digest}, own


def cpu(path: Path = Path("/proc/cpuinfo")) -> str:
    """Return the processor's vector instructions, by which libraries choose their code."""
    try:
        flags = path.read_text().split()
    except OSError:
        return "unknown"
    return " ".join(flag for flag in VECTOR_FLAGS if flag in flags) or "none"


def canary(program: str = _CANARY) -> tuple[str, float, list[str]]:
    """Evaluate the nominal elbow in a process of its own.

    Returns:
        A digest of the bits of its outputs, how many seconds the evaluation took, and the versions
        of rehyb's own models.

    Raises:
        CanaryError: it crashes, hangs, or comes out as nothing that can be compared.
    """
    try:
        ran = subprocess.run(
            python("-c", program),
            capture_output=True,
            text=True,
            timeout=CANARY_SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise CanaryError(
            f"the nominal elbow took more than {CANARY_SECONDS:g} s: this machine is too slow, "
            "or MuJoCo hangs on it"
        ) from None
    if ran.returncode != 0:
        lines = ran.stderr.strip().splitlines() or [f"exit status {ran.returncode}"]
        raise CanaryError(f"the nominal elbow cannot be evaluated on this machine: {lines[-1]}")
    digest, seconds, own = json.loads(ran.stdout)
    return str(digest), float(seconds), own
