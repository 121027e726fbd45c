"""A trial whose angle or effort has the others' sign turned is one error; a poor one is none."""

from pathlib import Path

import numpy as np
import pytest

from analysis.closeloop.errors import SessionError
from analysis.closeloop.load import load_session
from tests.testbed.sessions.small import Folder

POSITION, VELOCITY, EFFORT = 2, 3, 4


def parts(folder: Folder, turned: tuple[int, ...], trials: int) -> Folder:
    """Make a session of some trials of one recording, the second of them with columns turned."""
    folder.table = folder.table.copy()
    seconds = 10.0 / trials
    second = (folder.table[:, 0] >= seconds) & (folder.table[:, 0] < 2 * seconds)
    for column in turned:
        folder.table[second, column] *= -1.0
    folder.session["trials"] = [
        {"file": "a.csv", "from": n * seconds, "to": (n + 0.999) * seconds} for n in range(trials)
    ]
    return folder


@pytest.mark.parametrize("trials", [2, 4])
@pytest.mark.parametrize(
    ("turned", "column"),
    [((POSITION, VELOCITY), "elbow.position"), ((EFFORT,), "elbow.effort")],
)
def test_a_trial_with_the_other_sign_is_an_error_that_names_its_column(
    tmp_path: Path, turned: tuple[int, ...], column: str, trials: int
) -> None:
    folder = parts(Folder(tmp_path), turned, trials)
    with pytest.raises(SessionError, match="the other sign than in the other trials") as caught:
        load_session(folder.write())
    assert caught.value.column == column


def test_a_trial_that_the_others_do_not_predict_is_no_turned_one(tmp_path: Path) -> None:
    folder = parts(Folder(tmp_path), (), 4)
    time = folder.table[:, 0]
    pushed = (time > 2.5) & (time < 5.0)
    folder.table[pushed, EFFORT] += 20.0 * np.sin(9.0 * time[pushed])
    load_session(folder.write())
