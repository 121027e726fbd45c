"""Conditions beside Table 1."""

import re
from pathlib import Path

import pytest

from sim.models import ELBOW
from sim.parameters.conditions import CONDITIONS, DEFAULT_CONDITIONS, MUSCLES, split
from sim.parameters.wearer import TABLE_1


def test_what_is_not_in_table_1_is_off_unless_a_study_asks_for_it() -> None:
    assert ELBOW.sampled == TABLE_1
    assert all(f.low <= f.nominal <= f.high for f in CONDITIONS)
    assert all(f.bounds[0] <= f.low < f.high <= f.bounds[1] for f in CONDITIONS)
    assert {f.name for f in CONDITIONS} == set(vars(DEFAULT_CONDITIONS)) - {"effects"}


def test_wearer_and_conditions_are_told_apart_by_their_names() -> None:
    wearer, conditions = split({"forearm_mass": 1.2, "cuff_friction": 0.1})
    assert (wearer.forearm_mass, conditions.cuff_friction) == (1.2, 0.1)
    with pytest.raises(ValueError, match="the elbow has no factor 'weather'"):
        split({"weather": 1.0})


def test_a_choice_is_told_by_its_name_or_its_number() -> None:
    assert MUSCLES == ("paper", "holzbaur2005", "physiological")
    for number, name in enumerate(MUSCLES):
        assert split({"muscles": name})[1] == split({"muscles": float(number)})[1]
    assert split({})[1].muscles == MUSCLES.index("paper")
    with pytest.raises(ValueError, match="muscles must be paper, holzbaur2005 or physiological, n"):
        split({"muscles": "mine"})
    with pytest.raises(ValueError, match="or a number of these from 0, not"):
        split({"muscles": 0.5})
    with pytest.raises(ValueError, match="activation must be a number, not 'low'"):
        split({"activation": "low"})


def test_a_factor_that_was_replaced_says_what_to_write_instead() -> None:
    with pytest.raises(ValueError, match="write muscles=paper for refitted_muscles=0, and musc"):
        split({"refitted_muscles": 0.0})


def test_lengths_are_over_the_nominal_ones_that_a_study_may_choose() -> None:
    """Section 2.2.1 has 36.37 and 34.9 cm, section 2.3 what is the default."""
    wearer, _ = split({"nominal_upper_arm_length": 0.3637, "nominal_forearm_length": 0.349})
    assert wearer.upper_arm_scale == pytest.approx(0.3337 / 0.3637)
    assert wearer.forearm_scale == pytest.approx(0.319 / 0.349)
    assert split({})[0].upper_arm_scale == split({})[0].forearm_scale == 1.0


def test_the_page_on_failures_names_the_conditions_that_cannot_be_0() -> None:
    page = (Path(__file__).parents[4] / "docs/understand/failures.md").read_text()
    told = page.split("of which 0 means nothing:")[1].partition(".")[0]
    assert set(re.findall("`(.+?)`", told)) == {f.name for f in CONDITIONS if f.reach[0] > 0.0}
