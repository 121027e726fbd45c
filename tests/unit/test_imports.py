"""What a file imports when it is imported itself, and how long it may grow."""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2]
ROOMS = ("rehyb", "intake", "models", "sim", "analysis", "server", "worker", "migrations")


def imports(path: Path) -> list[tuple[str, bool]]:
    """Return the modules a file imports and whether at its top level."""
    tree = ast.parse(path.read_text())
    top = set(map(id, tree.body))
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(alias.name, id(node) in top) for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            found += [(f"{node.module}.{alias.name}", id(node) in top) for alias in node.names]
    return found


def test_the_face_imports_the_other_rooms_lazily() -> None:
    for path in (ROOT / "rehyb").rglob("*.py"):
        for module, at_top in imports(path):
            heavy = module.split(".")[0] in {"server", "worker", "analysis", "sim"}
            assert not (heavy and at_top), f"{path.relative_to(ROOT)} imports {module} at its top"


def test_a_worker_imports_what_closes_loops_only_when_it_does() -> None:
    for path in (ROOT / "worker").rglob("*.py"):
        for module, at_top in imports(path):
            assert not (module.startswith("analysis") and at_top), path.relative_to(ROOT)


def test_no_python_file_has_outgrown_its_room() -> None:
    for room in (*ROOMS, "benchmarks"):
        for path in (ROOT / room).rglob("*.py"):
            lines = len(path.read_text().splitlines())
            assert lines <= 400, f"{path.relative_to(ROOT)} has {lines} lines"
