"""Table 1 and the wearer it describes."""

import pytest

from sim.models import ELBOW, MODELS
from sim.parameters.conditions import CONDITIONS, DEFAULT_CONDITIONS, split
from sim.parameters.wearer import NOMINAL, NOMINAL_WEARER, TABLE_1, wearer_of
from sim.robot.control import Gains


def test_every_nominal_value_lies_in_its_range() -> None:
    assert all(factor.low < factor.nominal < factor.high for factor in TABLE_1)


def test_the_ranges_are_those_of_table_1() -> None:
    assert {f.name: (f.low, f.high) for f in TABLE_1} == {
        "upper_arm_length": (0.2728, 0.3778),
        "forearm_length": (0.2827, 0.3455),
        "upper_arm_mass": (0.3, 3.41),
        "forearm_mass": (0.1, 1.82),
        "upper_arm_elasticity": (100.5, 974.43),
        "forearm_elasticity": (100.5, 974.43),
    }


def test_masses_and_tissue_add_up_to_the_papers_totals() -> None:
    assert NOMINAL["upper_arm_mass"] + 0.489 == pytest.approx(2.25)
    assert NOMINAL["forearm_mass"] + 0.351 == pytest.approx(1.313, abs=0.005)


def test_a_factor_left_out_is_nominal() -> None:
    wearer = wearer_of({"forearm_mass": 1.5})
    assert wearer.forearm_mass == 1.5
    assert wearer.upper_arm_length == NOMINAL_WEARER.upper_arm_length


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"forearm_lenght": 0.3}, "no factor 'forearm_lenght'"),
        ({"forearm_mass": 0.0}, "must be positive"),
        ({"forearm_mass": float("nan")}, "must be positive"),
        ({"forearm_mass": float("inf")}, "must be positive"),
    ],
)
def test_a_value_that_is_no_wearer_is_refused_in_a_sentence(
    values: dict[str, float], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        wearer_of(values)


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


def test_lengths_are_over_the_nominal_ones_that_a_study_may_choose() -> None:
    """Section 2.2.1 has 36.37 and 34.9 cm, section 2.3 what is the default."""
    wearer, _ = split({"nominal_upper_arm_length": 0.3637, "nominal_forearm_length": 0.349})
    assert wearer.upper_arm_scale == pytest.approx(0.3337 / 0.3637)
    assert wearer.forearm_scale == pytest.approx(0.319 / 0.349)
    assert split({})[0].upper_arm_scale == split({})[0].forearm_scale == 1.0


def test_gains_are_multiples_of_the_devices_own() -> None:
    _, conditions = split({"proportional_gain": 2.0, "derivative_gain": 0.5, "integral_gain": 0.0})
    own = Gains(kp=50.0, kv=15.0, ki=25.0)
    assert own.under(conditions) == Gains(kp=100.0, kv=7.5, ki=0.0)
    assert own.under(DEFAULT_CONDITIONS) == own


def test_every_model_names_its_factors_and_outputs_once() -> None:
    for model in MODELS.values():
        names = [factor.name for factor in model.factors]
        assert len(set(names)) == len(names)
        assert len(set(model.outputs)) == len(model.outputs) > 0
    with pytest.raises(KeyError):
        ELBOW.factor("x1")
