"""What a model's file says is told in sentences of bounded length."""

from intake.xml import listed


def test_names_are_listed_as_far_as_a_sentence_has_room() -> None:
    assert listed(["elbow", "", "wrist"]) == "elbow, wrist"
    assert listed(["n" * 61]) == "n" * 60
    assert listed([""] + ["n"] * 30) == ", ".join(["n"] * 20)
    assert listed([""]) == "none with a name"
