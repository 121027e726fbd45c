"""The validation page stands alone and says what agrees with its source."""

from pathlib import Path

from analysis.reports.validation import write_validation


def test_one_page_has_every_quantity_its_source_and_the_pictures(tmp_path: Path) -> None:
    picture = tmp_path / "isometric_torque.png"
    picture.write_bytes(b"\x89PNG")
    row = {"quantity": "peak", "measured": 81.25, "unit": "Nm", "expected": "around 80 (figure 3)"}
    rows = [{**row, "agrees": True}, {**row, "quantity": "angle <b>", "agrees": False}]
    page = write_validation(tmp_path / "page.html", rows, [picture]).read_text()
    assert "1 of 2 quantities agree" in page
    assert "81.25" in page and "around 80 (figure 3)" in page and "differs" in page
    assert "angle &lt;b&gt;" in page
    assert 'alt="isometric torque" src="data:image/png;base64,iVBORw=="' in page
    assert "http" not in page
