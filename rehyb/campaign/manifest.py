"""What a campaign keeps in its directory, so that it resumes where it was interrupted."""

import json
import uuid
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rehyb.campaign.plans import Plan
from rehyb.client import Json
from rehyb.errors import CampaignError
from rehyb.whole_files import write_json

MANIFEST = "campaign.json"


def load_manifest(directory: Path, plan: Plan) -> Json:
    """Return the directory's manifest; make it first, so that its keys outlive a lost answer.

    Returns:
        {"plan", "phases": each with "key" and "study", "decision", "seconds"}.

    Raises:
        CampaignError: the directory holds a campaign with a different plan.
    """
    path = directory / MANIFEST
    directory.mkdir(parents=True, exist_ok=True)
    if path.exists():
        manifest: Json = json.loads(path.read_text())
        # A campaign that an earlier version began lacks what came later.
        later = {"most_rows": None, "target": None}
        kept: dict[str, Any] = manifest.get("plan", {})
        if {**later, **kept} != asdict(plan):
            words = ", ".join(f"{name} {value}" for name, value in kept.items())
            raise CampaignError(
                f"{directory} holds a different campaign ({words}): "
                f"ask for that one again, or use another directory"
            )
        return manifest
    manifest = {
        "plan": asdict(plan),
        "phases": [{"key": str(uuid.uuid4()), "study": None} for _ in range(2)],
        "decision": None,
        "seconds": 0.0,
    }
    write_json(path, manifest)
    return manifest
