"""Films of an assessment, from donning to its end or to where it failed."""

import sys
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image, ImageSequence

from sim.assessment.assess import Assessment, assess
from sim.pictures.film import LAST, Film, check_format
from sim.pictures.rendering import GraphicsError

RATE = 2


def filmed(values: dict[str, float], fidelity: str = "bushing") -> tuple[Film, Assessment]:
    film = Film(rate=RATE)
    return film, assess(values, fidelity=fidelity, watch=film.watch)


@pytest.mark.parametrize(
    ("values", "fidelity", "seconds"),
    [({}, "bushing", 6.0), ({"reflex_gain": 0.2}, "bushing", 6.0), ({}, "screening", 7.5)],
)
def test_watching_changes_nothing_and_sees_the_whole_assessment(
    values: dict[str, float], fidelity: str, seconds: float
) -> None:
    film, assessment = filmed(values, fidelity)
    assert assessment.outputs == assess(values, fidelity=fidelity).outputs
    assert len(film) == seconds * RATE


def test_a_film_shows_the_arm_moving(tmp_path: Path) -> None:
    film, assessment = filmed({})
    try:
        film.write(tmp_path / "trial.mp4", assessment.outcome)
    except GraphicsError as error:  # no EGL here: then it is said so
        assert "rehyb[rendering]" in str(error)
        return
    with av.open(str(tmp_path / "trial.mp4")) as container:
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert len(frames) == len(film) + round(LAST * RATE)
    first, end, last = (frames[i].astype(float) for i in (0, len(film) - 1, -1))
    assert np.abs(first - end).mean() > 2.0
    assert np.abs(end - last).mean() < 1.0
    film.write(tmp_path / "trial.gif", assessment.outcome)
    with Image.open(tmp_path / "trial.gif") as image:
        assert sum(1 for _ in ImageSequence.Iterator(image)) > 5


def test_a_failed_assessment_is_filmed_up_to_its_failure() -> None:
    beyond = {"forearm_length": 0.48, "extension_stop": 0.0}
    film, assessment = filmed(beyond, "screening")
    assert assessment.outcome == "human_joint_limit"
    assert assessment.state is not None
    assert len(film) == int(assessment.state["time"] * RATE) + 1
    assert 0 < len(film) < 7.5 * RATE


def test_what_cannot_be_filmed_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ValueError, match=r"its name must end in \.mp4 or \.gif"):
        check_format(tmp_path / "trial.avi")
    with pytest.raises(ValueError, match="nothing to film"):
        Film().write(tmp_path / "trial.gif", "ok")
    film, _ = filmed({})
    for name in ("mujoco.egl", "mujoco.osmesa"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(GraphicsError, match="install the extra rehyb"):
        film.write(tmp_path / "trial.gif", "ok")
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(
        ValueError, match=r"needs the extra rehyb\[video\]: install it or write a \.gif"
    ):
        check_format(tmp_path / "trial.mp4")
