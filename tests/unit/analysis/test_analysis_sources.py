"""Whoever doubts a number finds where its formula is from, beside the code that computes it."""

import ast
import re
from pathlib import Path

import pytest

import analysis

ANALYSIS = Path(analysis.__file__).parent
FILES = [
    *sorted(ANALYSIS.glob("designs/*.py")),
    *sorted(ANALYSIS.glob("estimators/*.py")),
    *(ANALYSIS / f"{name}.py" for name in ("failures", "screening", "stopping", "comparison")),
    *(ANALYSIS / f"{name}.py" for name in ("convergence", "surrogate")),
]
#: A year of a publication, or a place in the paper.
SOURCE = re.compile(r"(19|20)\d\d|equation \d|paper, (section|figure) \d")
#: Functions that compute nothing: what a caller may ask for, or must not.
NO_FORMULA = {"check_level"}


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_every_public_function_cites_its_source(file: Path) -> None:
    tree = ast.parse(file.read_text())
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            cited = SOURCE.search(ast.get_docstring(node) or "")
            assert cited or node.name in NO_FORMULA, f"{file.name}: {node.name} cites nothing"
