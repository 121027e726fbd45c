"""No chain of imports within closing the loop is long."""

import ast
from functools import cache
from pathlib import Path

import analysis.closeloop

ROOT = Path(analysis.closeloop.__file__).parent
FILES = {
    ".".join(("analysis.closeloop", *path.relative_to(ROOT).with_suffix("").parts)): path
    for path in ROOT.rglob("*.py")
}
#: Modules that a chain of imports may hold, the first and the last included.
FLOORS = 10


def imported(module: str) -> set[str]:
    """Return the modules of closing the loop that a module imports, lazily or not."""
    found = set()
    for node in ast.walk(ast.parse(FILES[module].read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return found & set(FILES)


@cache
def chain(module: str) -> tuple[str, ...]:
    """Return the longest chain of imports from a module down."""
    return module, *max((chain(other) for other in imported(module)), key=len, default=())


def test_no_chain_of_imports_is_longer_than_its_floors() -> None:
    longest = max((chain(module) for module in FILES), key=len)
    assert len(longest) <= FLOORS, " -> ".join(longest)
