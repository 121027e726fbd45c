"""What has the right form in a request for a study, and no sense."""

import pytest
from fastapi.testclient import TestClient

from tests.testbed.coordinators.rest_bodies import STUDY, Json, faults_of

UNSEEN = "must have no control characters in it, nor invisible ones, as U+200B and U+202E"


@pytest.mark.parametrize("kind", ["sqlite"])
@pytest.mark.parametrize(
    ("part", "pointer", "said"),
    [
        ({"tags": ["a", "b", "a"]}, "/tags", "'a' comes twice: leave out one"),
        ({"name": "\u200b\u2060"}, "/name", "a name needs a character that can be seen"),
        ({"name": " \u3000"}, "/name", "a name needs a character that can be seen"),
        # It would be shown as "stop.exe".
        ({"name": "st\u202eexe.po"}, "/name", UNSEEN),
        ({"model": "ishi\u00adgami"}, "/model", UNSEEN),
        ({"tags": ["fa\u200bst"]}, "/tags/0", UNSEEN),
        ({"factors": [{"name": "x1\ufeff"}]}, "/factors/0/name", UNSEEN),
        (
            {"factors": [{"name": "x1", "range": [0.0, 5e-324]}]},
            "/factors/0/range",
            "x1 would vary by 4.94066e-324 only: by 1e-150 or more, or fix it",
        ),
    ],
)
def test_what_nobody_can_see_tell_apart_or_vary_is_refused(
    client: TestClient, part: Json, pointer: str, said: str
) -> None:
    assert faults_of(client.post("/v1/studies", json=STUDY | part)) == [(pointer, said)]
