"""What no coordinator would take is refused before a campaign begins."""

from dataclasses import replace

import pytest

from rehyb.campaign.checks import check_plan
from rehyb.campaign.plans import PRESETS, Plan
from rehyb.errors import Invalid

PLAN = Plan(model="elbow", output="stiffness_error", screening_rows=4, variance_rows=32)


@pytest.mark.parametrize("preset", PRESETS)
def test_every_preset_can_be(preset: str) -> None:
    check_plan(Plan(model="elbow", output="stiffness_error", **PRESETS[preset]))


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"sampling": "trajectories"}, "there is no sampling 'trajectories': take one of owen_"),
        ({"most_rows": 31}, "phase 2 begins with 32 rows, and --up-to 31 allows fewer"),
        ({"screening_rows": 10**12}, "phase 1 cannot be: rows must lie between 1 and"),
        ({"variance_rows": 10**12}, "phase 2 cannot be: rows must lie between 1 and"),
        ({"fixed": {"forearm_mass": 50.0}}, "phase 1 cannot be: forearm_mass is 50 kg, far outs"),
    ],
)
def test_a_phase_that_cannot_be_is_named(changed: dict[str, object], said: str) -> None:
    with pytest.raises(Invalid, match=said):
        check_plan(replace(PLAN, **changed))


def test_a_value_far_outside_may_be_asked_for_and_a_cap_may_be_what_it_begins_with() -> None:
    check_plan(replace(PLAN, fixed={"forearm_mass": 50.0}, outside_range=True, most_rows=32))
