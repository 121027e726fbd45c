"""What fitted functions say stands in a report, where it was asked for."""

from pathlib import Path

from analysis.reports.report import chapter, write_report
from tests.testbed.studies import described, results_of, study_plan, write_table

UNITS = {"a": "m", "y": "Nm/rad"}


def test_surrogates_stand_in_a_report_where_asked_or_say_why_not(tmp_path: Path) -> None:
    plan = study_plan("saltelli", rows=16)
    one = chapter(described(plan), write_table(tmp_path / "r.csv", plan, results_of(plan)))
    write_report(tmp_path / "r.html", [one], "y", UNITS, title="T", surrogates=True)
    text = (tmp_path / "r.html").read_text()
    assert "Surrogates on the same runs" in text and "polynomial chaos: S, ST" in text
    assert "Fitted to 80 runs" in text
    few = study_plan("saltelli", rows=2)
    table = write_table(tmp_path / "f.csv", few, results_of(few))
    one = chapter(described(few), table)
    write_report(tmp_path / "f.html", [one], "y", UNITS, title="T", surrogates=True)
    assert "There is no surrogate: a surrogate needs 15 runs" in (tmp_path / "f.html").read_text()
