"""Table 1 and the wearer it describes."""

import pytest

from sim.parameters.wearer import NOMINAL, NOMINAL_WEARER, TABLE_1, wearer_of


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
