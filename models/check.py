"""Look at a zipped model, in a process of its own, and say as JSON whether it can be used.

`python -m models.check FILE` prints one line: {"answer": its description} or {"error": ...}. A
caller that takes files from strangers runs this: nothing of theirs is unpacked, parsed or given to
MuJoCo in the process that asks.
"""

import tempfile
from pathlib import Path
from typing import Any

from intake.looks import look
from models.description import Kind
from models.folder import ModelError, read_folder, unpacked_into


def check(file: Path) -> dict[str, Any]:
    """Return the description of the `mjcf` model in the zip file, as JSON.

    Raises:
        ModelError: it cannot be used.
    """
    with tempfile.TemporaryDirectory(prefix="rehyb-model-") as scratch:
        folder = read_folder(unpacked_into(file, Path(scratch)))
        if folder.description.kind != Kind.MJCF:
            raise ModelError(
                f"model.kind is {folder.description.kind}, which is code: only its description is "
                "sent, and workers are told of the folder (rehyb-worker --models)"
            )
        # MuJoCo takes a second to load: not for what is no model at all.
        from models.mjcf.simulate import Simulation

        Simulation(folder).check_factors()
    return folder.description.as_json()


if __name__ == "__main__":
    look(check, ModelError, lambda detail, file: ModelError(detail, file=file))
