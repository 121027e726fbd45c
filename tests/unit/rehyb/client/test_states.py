"""A client knows the states that a coordinator answers with."""

from enum import StrEnum

import pytest

from rehyb.client import states as known
from server import states


@pytest.mark.parametrize(
    ("mine", "theirs"),
    [
        (known.StudyState, states.StudyState),
        (known.JobKind, states.JobKind),
        (known.JobState, states.CloseLoopState),
    ],
)
def test_a_client_calls_each_state_as_the_coordinator_does(
    mine: type[StrEnum], theirs: type[StrEnum]
) -> None:
    assert {one.name: one.value for one in mine} == {one.name: one.value for one in theirs}
