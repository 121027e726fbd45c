"""What the numbers of a study promise: each public function says which paper or equation it is."""

import ast
import re
from pathlib import Path

import pytest

import analysis

ROOT = Path(str(analysis.__file__)).parent

#: Modules that carry or show numbers, and make none.
CARRIERS = {
    *("reports/hover.py", "reports/html.py", "reports/pictures.py", "reports/report.py"),
    *("reports/tables.py", "reports/validation.py", "reports/figures/shared.py"),
    *("sensitivity/records.py", "sensitivity/remarks.py", "sensitivity/table.py"),
    *("given/answer.py", "given/check.py", "given/table/reading.py", "given/table/refusals.py"),
    *("given/rows/sample.py", "given/table/cells.py", "given/table/csv_head.py"),
    *("files/results_csv.py", "files/netcdf.py", "files/parquet.py"),
    *("interpretation/answer.py", "interpretation/build.py", "interpretation/errors.py"),
    *("interpretation/bank/archive.py", "interpretation/contract.py"),
    *("interpretation/page.py", "interpretation/recording.py", "interpretation/bank/sampling.py"),
    *("reports/figures/failures.py", "reports/paper.py"),
    *("sensitivity/curves/findings.py", "interpretation/inference/fitted.py"),
}

#: An author and a year, or a place in the paper or in an ADR.
SOURCE = re.compile(
    r"[A-Z]\w+,? (?:and \w+ |et al\.?,? )?\(?(?:18|19|20)\d\d\b"
    r"|paper'?s?,? (?:equations?|figures?|sections?) \d"
    r"|docs/decisions/\d{4}"
)

#: Everything that anybody adds is in here, unless it is named above.
MODULES = [
    path
    for path in sorted(ROOT.rglob("*.py"))
    if str(path.relative_to(ROOT)) not in CARRIERS and "closeloop" not in path.parts
]

#: Where every formula of an index is: here each function says it itself.
FORMULAS = [path for path in MODULES if path.parent.name in ("designs", "estimators")]


def unsourced(text: str) -> list[str]:
    """Return the public functions without a source, in their own docstring or their module's."""
    module = ast.parse(text)
    if SOURCE.search(" ".join((ast.get_docstring(module) or "").split())):
        return []
    return [
        node.name
        for node in module.body
        if isinstance(node, ast.FunctionDef | ast.ClassDef)
        and not node.name.startswith("_")
        and not SOURCE.search(" ".join((ast.get_docstring(node) or "").split()))
    ]


def test_every_module_that_only_carries_numbers_is_there() -> None:
    assert all((ROOT / name).is_file() for name in CARRIERS)


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_public_function_cites_its_source(path: Path) -> None:
    assert unsourced(path.read_text()) == []


@pytest.mark.parametrize("path", FORMULAS, ids=lambda path: path.name)
def test_functions_of_designs_and_estimators_cite_it_themselves(path: Path) -> None:
    silent = [
        node.name
        for node in ast.parse(path.read_text()).body
        if isinstance(node, ast.FunctionDef)
        and not node.name.startswith(("_", "check_"))
        and not SOURCE.search(" ".join((ast.get_docstring(node) or "").split()))
    ]
    assert silent == []


@pytest.mark.parametrize(
    ("docstring", "missing"),
    [
        ("Jansen 1999.", []),
        ("As in Campolongo et al. 2011.", []),
        ("Owen (1997) says so.", []),
        ("The paper's figure 10.", []),
        ("Return the first 1999 rows.", ["f"]),
        ("Well known.", ["f"]),
    ],
)
def test_a_source_is_an_author_with_a_year_or_a_place(docstring: str, missing: list[str]) -> None:
    text = f'"""A module."""\n\ndef f():\n    """{docstring}"""\n\ndef _g():\n    pass\n'
    assert unsourced(text) == missing
