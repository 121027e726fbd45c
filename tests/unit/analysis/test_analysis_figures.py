"""What the figures promise: a picture of any snapshot, also of an empty or a failed one."""

from pathlib import Path
from typing import Any

import pytest
from analysis_studies import results_of, study_plan

from analysis.figures import campaign_figure, screening_figure, variance_figure
from analysis.service import analyse
from analysis.snapshot import empty_snapshot


def snapshots(rows: int, failed: list[tuple[int, int]]) -> tuple[dict[str, Any], dict[str, Any]]:
    plans = [study_plan(method, rows) for method in ("morris", "saltelli")]
    first, second = (analyse(plan, results_of(plan, failed=failed)) for plan in plans)
    return first, second


@pytest.mark.parametrize("case", ["whole", "failing", "one row", "empty"])
def test_every_state_of_a_study_can_be_drawn(case: str, tmp_path: Path) -> None:
    phase1, phase2 = {
        "whole": lambda: snapshots(12, []),
        "failing": lambda: snapshots(12, [(0, 0), (3, 1), (5, 2)]),
        "one row": lambda: snapshots(1, []),
        "empty": lambda: tuple(empty_snapshot(study_plan(m, 3)) for m in ("morris", "saltelli")),
    }[case]()
    screening_figure(phase1, "y", tmp_path / "screening.png", "Nm/rad")
    variance_figure(phase2, "y", tmp_path / "variance.png")
    campaign_figure(phase1, phase2, "y", tmp_path / "campaign.png", "Nm/rad")
    for name in ("screening", "variance", "campaign"):
        assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")


def test_the_unit_and_the_failures_are_written_in_the_picture(tmp_path: Path) -> None:
    phase1, phase2 = snapshots(12, [(0, 0), (3, 1)])
    campaign_figure(phase1, phase2, "y", tmp_path / "campaign.svg", "Nm/rad")
    picture = (tmp_path / "campaign.svg").read_text()
    for text in ("(Nm/rad)", "diverged", "phase 1: 2 of 48", "phase 2: 2 of 60", "90 % intervals"):
        assert f"<!-- {text}" in picture or text in picture


def test_a_figure_refuses_the_wrong_method_or_output(tmp_path: Path) -> None:
    phase1, phase2 = snapshots(2, [])
    with pytest.raises(ValueError, match="shows studies of method morris, not saltelli"):
        screening_figure(phase2, "y", tmp_path / "x.png")
    with pytest.raises(ValueError, match="shows studies of method saltelli, not morris"):
        variance_figure(phase1, "y", tmp_path / "x.png")
    with pytest.raises(ValueError, match="has no output 'w': it has y, z"):
        campaign_figure(phase1, phase2, "w", tmp_path / "x.png")
