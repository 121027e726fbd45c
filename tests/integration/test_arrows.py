"""The arrows between the rooms run one way, as docs/understand/architecture.md draws them."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
ROOMS = ("rehyb", "intake", "models", "sim", "analysis", "server", "worker", "migrations")


def contracts_broken(tree: Path) -> str:
    """Return what import-linter says of the rooms in `tree`; nothing if every contract is kept."""
    ran = subprocess.run(
        [sys.executable, "-c", "from importlinter.cli import lint_imports_command as run; run()"],
        cwd=tree,
        env=os.environ | {"PYTHONPATH": str(tree), "COLUMNS": "200"},
        capture_output=True,
        text=True,
        check=False,
    )
    return ran.stdout + ran.stderr if ran.returncode else ""


def test_every_contract_between_the_rooms_is_kept() -> None:
    assert contracts_broken(ROOT) == ""


#: A file, what it must not import, and words of the contract that says so.
WRONG_ARROWS = [
    ("server/store/tokens.py", "server.logic.tokens", "which do not"),
    ("server/logic/tokens.py", "server.store.tokens", "which do not"),
    ("sim/effects/laws/limb.py", "sim.body.skeleton", "from an effect's law"),
    ("analysis/designs/points.py", "analysis.sensitivity.judgement.screening", "designs, indices"),
    ("server/app.py", "worker.agent", "The coordinator knows no client"),
    ("server/app.py", "models.running.pool", "Only workers and the face evaluate models"),
    ("rehyb/again.py", "worker.agent", "The face starts workers"),
    ("rehyb/again.py", "migrations.env", "alone migrates"),
    ("server/app.py", "intake.zips", "alone read what strangers send"),
    ("migrations/env.py", "server.states", "Migrations know"),
]


def test_an_arrow_against_the_rooms_breaks_a_contract(tmp_path: Path) -> None:
    for room in ROOMS:
        shutil.copytree(ROOT / room, tmp_path / room, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    for source, target, _ in WRONG_ARROWS:
        with (tmp_path / source).open("a") as file:
            file.write(f"\nimport {target}\n")
    broken = contracts_broken(tmp_path)
    for source, target, contract in WRONG_ARROWS:
        assert contract in broken
        module = source.removesuffix(".py").replace("/", ".")
        assert f"{module} -> {target}" in broken
