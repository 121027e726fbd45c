"""Models of one's own: the examples, and copies of them with something changed."""

import shutil
import tomllib
from collections.abc import Mapping
from pathlib import Path

EXAMPLES = Path(__file__).parents[2] / "examples" / "models"


def edited(example: str, scratch: Path, changes: Mapping[str, str] | None = None) -> Path:
    """Return a copy of an example in `scratch`, whose texts have other words.

    Raises:
        ValueError: a text that is to be changed is not there.
    """
    folder = Path(shutil.copytree(EXAMPLES / example, scratch / example))
    for old, new in (changes or {}).items():
        files = [path for path in folder.iterdir() if old in path.read_text()]
        if not files:
            raise ValueError(f"{old!r} stands in no file of {example}")
        for path in files:
            path.write_text(path.read_text().replace(old, new))
    return folder


def laid_out(target: Path) -> Path:
    """Lay the example package out in the folder `target` as an installer does, and return it."""
    project = tomllib.loads((EXAMPLES / "package" / "pyproject.toml").read_text())["project"]
    shutil.copytree(EXAMPLES / "package" / "rehyb_example", target / "rehyb_example")
    info = target / f"rehyb_example-{project['version']}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    )
    points = project["entry-points"]["rehyb.models"].items()
    (info / "entry_points.txt").write_text(
        "[rehyb.models]\n" + "".join(f"{name} = {where}\n" for name, where in points)
    )
    (info / "RECORD").write_text("rehyb_example/__init__.py,,\n")
    return target
