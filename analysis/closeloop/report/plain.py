"""What every report says of its session, and how its content becomes plain JSON."""

from typing import Any

import numpy as np

from analysis.closeloop.session.recording import Recording

CONVENTION = "restoring"


def session_entry(recording: Recording) -> dict[str, Any]:
    """Return what was recorded, and at which rates it was analysed."""
    session, sampling = recording.session, recording.sampling
    return {
        "folder": session.folder.name,
        "model": session.model,
        "trials": [
            {"file": t.file, "label": t.label, "group": t.group, "role": t.role}
            for t in session.trials
        ],
        "rate_hz": sampling.recorded,
        "kinematic_cutoff_hz": sampling.cutoff,
        "kinematic_cutoff_from": sampling.cutoff_from,
        "fit_cutoff_hz": sampling.fit_cutoff,
    }


def finite(content: Any) -> Any:
    """Return JSON content with plain numbers; what is not finite becomes null."""
    if isinstance(content, dict):
        return {key: finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [finite(value) for value in content]
    if isinstance(content, np.floating | np.integer):
        content = content.item()
    if isinstance(content, float) and not np.isfinite(content):
        return None
    return content
