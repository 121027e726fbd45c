"""Positions and efforts that stand in each other's columns are told as that."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.closeloop.errors import SessionError
from analysis.closeloop.exchanged import check_exchanged, roughness
from analysis.closeloop.load import load_session
from analysis.closeloop.session.recording import Recording
from tests.testbed.sessions.upright import NAMES, all_at_once


@pytest.fixture
def arm(tmp_path: Path) -> Recording:
    """Three joints that rub, of links declared as much as twice as heavy as they are."""
    return all_at_once(tmp_path, 29)


def refused(folder: Path, exchanged: tuple[str, ...]) -> SessionError:
    """Return what is said of the session in a folder after columns of joints were exchanged."""
    file = folder / "all.csv"
    header, rest = file.read_text().split("\n", 1)
    other = {f"{name}.position": f"{name}.effort" for name in exchanged}
    other |= {effort: position for position, effort in other.items()}
    names = [other.get(name, name) for name in header.split(",")]
    file.write_text(",".join(names) + "\n" + rest)
    with pytest.raises(SessionError) as caught:
        load_session(folder)
    return caught.value


@pytest.mark.parametrize("exchanged", [NAMES, ("lift",), ("pan", "bend")])
def test_exchanged_positions_and_efforts_are_refused_as_that(
    arm: Recording, tmp_path: Path, exchanged: tuple[str, ...]
) -> None:
    """They read as degrees, as a saturated motor, or were analysed."""
    error = refused(tmp_path, exchanged)
    assert (error.file, error.column) == ("all.csv", f"{exchanged[0]}.position")
    assert f"looks exchanged with {exchanged[0]}.effort" in str(error)
    for name in exchanged[1:]:
        assert name in str(error)


def rough_encoder(arm: Recording, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Positions with noise beside efforts that are low-passed."""
    columns = dict(arm.session.trials[0].columns)
    for name in NAMES:
        noise = 0.01 * rng.standard_normal(len(columns[f"{name}.position"]))
        smooth = np.convolve(columns[f"{name}.effort"], np.full(25, 1 / 25), mode="same")
        columns |= {f"{name}.position": columns[f"{name}.position"] + noise}
        columns |= {f"{name}.effort": smooth}
    return columns


def as_recorded(arm: Recording, _: np.random.Generator) -> dict[str, np.ndarray]:
    return dict(arm.session.trials[0].columns)


def untold(arm: Recording, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Rough encoders beside smooth efforts that have nothing to do with the motion."""
    columns = rough_encoder(arm, rng)
    time = arm.session.trials[0].time
    return columns | {f"{name}.effort": np.sin(1.7 * time + n) for n, name in enumerate(NAMES)}


@pytest.mark.parametrize(
    ("signals", "rougher"), [(as_recorded, False), (rough_encoder, True), (untold, True)]
)
def test_signals_in_their_own_columns_are_left_alone(
    arm: Recording, signals: Callable[..., dict[str, np.ndarray]], rougher: bool
) -> None:
    """Rough positions alone say nothing: the model has to move by the efforts besides."""
    columns = signals(arm, np.random.default_rng(7))
    rough = [roughness(columns[f"lift.{what}"]) for what in ("position", "effort")]
    assert (rough[0] > rough[1]) is rougher
    check_exchanged(replace(arm.session.trials[0], columns=columns), arm.device, ())


def test_of_a_limb_nothing_is_asked(arm: Recording) -> None:
    columns = dict(arm.session.trials[0].columns)
    for name in NAMES:
        pair = f"{name}.position", f"{name}.effort"
        columns |= {pair[0]: columns[pair[1]], pair[1]: columns[pair[0]]}
    trial = replace(arm.session.trials[0], columns=columns)
    with pytest.raises(SessionError, match="looks exchanged"):
        check_exchanged(trial, arm.device, ())
    check_exchanged(trial, arm.device, NAMES)
