"""A limb in a simulated device that declares an impedance, and another one in truth."""

import json
from pathlib import Path
from typing import Any

from analysis.closeloop.loop import analyse
from tests.testbed.sessions.plants import Beyond, Plant, write_recordings

STIFFNESS, DAMPING = 4.0, 0.3
#: The limb as it is in the true model.
LIMP = f'springref="1.2" stiffness="{STIFFNESS}" damping="{DAMPING}"'
ATTRIBUTES = 'armature="0.02" frictionloss="0"'


def rubbing(friction: float) -> str:
    """Return the attributes of a joint with friction, Nm."""
    return ATTRIBUTES.replace('frictionloss="0"', f'frictionloss="{friction}"')


def answer(
    folder: Path,
    plant: Plant,
    truth: str,
    beyond: Beyond | None = None,
    *more: str,
    rate: float = 100.0,
) -> dict[str, Any]:
    """Return the answer to a session of a plant with an impedance and `more` declared there."""
    write_recordings(folder, plant, 2, truth=truth, beyond=beyond, rate=rate, seconds=8.0, trials=4)
    session = json.loads((folder / "session.json").read_text())
    names = ("viscoelastic_joint", *more)
    session["declared_effects"] = [{"effect": name, "joint": "elbow"} for name in names]
    (folder / "session.json").write_text(json.dumps(session))
    return analyse(folder).report
