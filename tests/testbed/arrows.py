"""The drawing of rooms and arrows, made of the contracts that import-linter holds.

`python -m tests.testbed.arrows` writes it into docs/understand/architecture.md.
"""

import re
import textwrap
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
PAGES = (ROOT / "docs" / "understand" / "architecture.md",)
#: Characters of a line that a page shows without scrolling.
WIDTH = 96
BEGIN, END = "<!-- arrows -->", "<!-- end of arrows -->"


def contracts() -> Mapping[str, Any]:
    """Return what pyproject.toml says to import-linter."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    return dict(project["tool"]["importlinter"])


def drawing(linter: Mapping[str, Any]) -> str:
    """Return a line for every room with what it may import, and one for the layers inside it.

    A package that no contract names as a source may import all others.
    """
    roots = linter["root_packages"]
    forbidden: dict[str, list[str]] = {root: [] for root in roots}
    excepted: list[str] = []
    layers: dict[str, str] = {}
    for contract in linter["contracts"]:
        if contract["type"] == "forbidden":
            for source in contract["source_modules"]:
                forbidden.setdefault(source, []).extend(contract["forbidden_modules"])
            excepted += [line.split(" -> ")[1] for line in contract.get("ignore_imports", ())]
        elif contract["type"] == "layers":
            for container in contract.get("containers", ()):
                names = (re.sub(r"[()]", "", layer) for layer in contract["layers"])
                layers[container] = " -> ".join(names)
    for source in list(forbidden):
        # What is said of each of its parts is not said of the whole.
        if not forbidden[source] and any(name.startswith(f"{source}.") for name in forbidden):
            del forbidden[source]
    width = max(map(len, (*forbidden, *layers))) + 1
    imports = [
        _line(source, width, "->", _allowed(source, names, roots, excepted))
        for source, names in forbidden.items()
    ]
    inside = [_line(container, width, "= ", layer) for container, layer in layers.items()]
    return "\n".join([*imports, "", *inside])


def _line(room: str, width: int, sign: str, text: str) -> str:
    """Return a line of the drawing, wrapped under its own text."""
    begin = f"{room:{width}s}{sign} "
    indent = " " * len(begin)
    return textwrap.fill(
        text, WIDTH, initial_indent=begin, subsequent_indent=indent, break_on_hyphens=False
    )


def _allowed(source: str, forbidden: list[str], roots: list[str], excepted: list[str]) -> str:
    """Return the rooms that a room may import, with what of them it may not."""
    own = source.split(".")[0]
    rooms = []
    for root in roots:
        if root == own or root in forbidden:
            continue
        parts = [
            " but ".join(
                [name.removeprefix(f"{root}.")]
                + [each.removeprefix(f"{name}.") for each in excepted if each.startswith(name)]
            )
            for name in forbidden
            if name.startswith(f"{root}.")
        ]
        rooms.append(f"{root} (without {', '.join(parts)})" if parts else root)
    return ", ".join(rooms) or "nothing of ours"


def drawn(text: str, picture: str) -> str:
    """Return a page with this drawing between its marks."""
    before, rest = text.split(BEGIN)
    after = rest.split(END)[1]
    return f"{before}{BEGIN}\n```text\n{picture}\n```\n{END}{after}"


if __name__ == "__main__":
    for page in PAGES:
        page.write_text(drawn(page.read_text(), drawing(contracts())))
