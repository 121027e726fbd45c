"""What a clinician reads."""

from pathlib import Path

import pytest

from analysis.interpretation.page import in_words, tolerance_in_words, write_page

ENTRY = {"median": 4.7, "interval50": [4.5, 4.9], "interval90": [4.1, 5.2], "unit": "Nm/rad"}
STEP = {
    "do": "measure forearm_length to 0.005: tape",
    "factor": "forearm_length",
    "to": 0.005,
    "minutes": 2,
    "half_width_after": 0.4,
}
FOUND = {
    "recording": "down.csv",
    "bank": "0123456789ab",
    "known": [{"name": "forearm_mass", "value": 1.2, "sd": 0.1}],
    "stiffness": ENTRY,
    "damping": ENTRY | {"unit": "Nm s/rad"},
    "stiffness_over_angle": [ENTRY | {"share_of_travel": 0.5, "angle": 1.0}],
    "familiar": True,
    "why_not": None,
    "half_width": 0.55,
    "muscle_model": "any",
    "if_muscles_of_bank": {"stiffness": ENTRY | {"interval90": [4.4, 4.9]}},
    "parts": [{"name": "forearm_length", "share": 0.4}],
    "next": [STEP],
    "tolerance": {
        "value": 0.5,
        "inside": False,
        "plan": {"steps": [STEP], "minutes": 2, "half_width_after": 0.4},
    },
    "regression": {"affine": 4.2, "paper": 0.1},
    "advice": [],
}


def test_the_interval_comes_first_and_needs_nothing_from_outside(tmp_path: Path) -> None:
    write_page(tmp_path / "a.html", FOUND, before=0.7)
    page = (tmp_path / "a.html").read_text()
    assert page.index("between 4.10 and 5.20") < page.index("What to do next")
    narrow = page.index("one of the sets that the bank knows, 4.70 Nm/rad, between 4.40")
    assert page.index("between 4.10 and 5.20 with 90 % probability, whatever") < narrow
    assert "To come below 0.5 Nm/rad in 2 minutes measure forearm_length." in page
    assert "Without it the half width is 0.70 Nm/rad, with it 0.55." in page
    assert "Wiegner and Watts 1986" in page
    assert "http" not in page
    assert "Do not rely" not in page


def test_a_strange_recording_says_first_that_it_cannot_be_relied_on(tmp_path: Path) -> None:
    strange = {"familiar": False, "why_not": "the <angle> is odd", "advice": ["close the loop"]}
    write_page(
        tmp_path / "a.html",
        FOUND | strange | {"next": [], "regression": None, "if_muscles_of_bank": None},
    )
    page = (tmp_path / "a.html").read_text()
    assert page.index("Do not rely on these intervals") < page.index("between 4.10")
    assert "The &lt;angle&gt; is odd" in page
    assert "This holds if the limb's muscles are those of the bank" in page.replace("&#39;", "'")


@pytest.mark.parametrize(
    ("interval", "words"),
    [
        ([4.1, 5.2], "stiffer than relaxed healthy"),
        ([0.6, 1.2], "as stiff as relaxed healthy"),
        ([1.2, 3.0], "cannot be told from"),
        ([-3.0, 0.1], "less stiff than"),
    ],
)
def test_where_the_interval_lies_is_said_in_words(interval: list[float], words: str) -> None:
    assert words in in_words({"stiffness": ENTRY | {"interval90": interval}})


def test_a_tolerance_that_nothing_reaches_is_said() -> None:
    asked = {"value": 0.1, "inside": False, "plan": None}
    assert "No plan" in tolerance_in_words({"tolerance": asked})
    strange = asked | {"why_no_plan": "it is odd"}
    said = tolerance_in_words({"tolerance": strange})
    assert said == "There is no plan for 0.1 Nm/rad: it is odd."
    assert "as was wanted" in tolerance_in_words({"tolerance": asked | {"inside": True}})
