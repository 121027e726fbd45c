"""Who may come: one file that a clinic can replace."""

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.interpretation.bank.population import (
    default_population,
    population_of,
    read_population,
    with_effects,
)
from analysis.interpretation.bank.sampling import parameters_of
from analysis.interpretation.errors import InterpretationError

OURS = default_population()


def changed(**entries: Any) -> dict[str, Any]:
    return copy.deepcopy(dict(OURS.content)) | entries


def test_a_wearer_is_a_function_of_seed_and_number() -> None:
    drawn = OURS.draw(5, np.arange(8))
    assert np.array_equal(drawn[3:5], OURS.draw(5, np.array([3, 4])))
    assert not np.array_equal(drawn, OURS.draw(6, np.arange(8)))


def test_bodies_are_correlated_as_in_the_tables() -> None:
    drawn = OURS.draw(1, np.arange(1024))
    names = OURS.names
    long, heavy = names.index("upper_arm_length"), names.index("forearm_mass")
    assert np.corrcoef(drawn[:, long], drawn[:, heavy])[0, 1] == pytest.approx(0.71, abs=0.05)
    assert abs(np.corrcoef(drawn[:, long], drawn[:, names.index("activation")])[0, 1]) < 0.1


def test_every_entry_has_a_source() -> None:
    assert all(entry["source"] for entry in OURS.content["factors"].values())


def test_zero_errors_belong_to_a_wearer() -> None:
    errors = OURS.zero_errors(1, np.arange(500), 4)
    assert errors.std() == pytest.approx(0.1, abs=0.01)
    assert np.array_equal(errors[7], OURS.zero_errors(1, np.array([7]), 4)[0])


UNIFORM = {"kind": "uniform", "low": 0.3, "high": 0.32}
SAID = {"distribution": UNIFORM, "source": "us"}


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ([], '"schema": 1'),
        ({"schema": 1}, 'has no "factors"'),
        (changed(factors={"weather": SAID}), "'weather' is no factor"),
        (changed(factors={"forearm_length": {"distribution": UNIFORM}}), "needs a distribution"),
        (
            changed(factors={"forearm_length": SAID | {"distribution": {"kind": "uniform"}}}),
            "takes low, high",
        ),
        (
            changed(
                factors={
                    "forearm_length": SAID
                    | {"distribution": {"kind": "normal", "mean": 0.3, "sd": 1.0}}
                }
            ),
            "cut the distribution there",
        ),
        (
            changed(
                factors={"forearm_length": SAID | {"measure": {"to": 0, "minutes": 1, "how": ""}}}
            ),
            "to of measure of forearm_length must be positive",
        ),
        (
            changed(correlations=[["forearm_length", "forearm_length", 0.5]]),
            "must join two factors",
        ),
        (changed(correlations=[["forearm_length", 0.5]]), "a correlation is"),
        (
            changed(
                correlations=[
                    ["forearm_length", "forearm_mass", 0.5],
                    ["forearm_mass", "forearm_length", 0.5],
                ]
            ),
            "forearm_mass and forearm_length are a pair twice",
        ),
        (
            changed(
                correlations=[
                    ["forearm_length", "upper_arm_length", 0.9],
                    ["forearm_length", "forearm_mass", 0.9],
                    ["upper_arm_length", "forearm_mass", -0.9],
                ]
            ),
            "contradict each other",
        ),
        (
            changed(
                factors={
                    "muscles": SAID | {"distribution": {"kind": "uniform", "low": 0, "high": 2}}
                }
            ),
            "0 to 2, which are paper",
        ),
        (
            changed(
                factors={
                    "reflex_gain": {
                        "distribution": {
                            "kind": "discrete",
                            "values": [0.0, 0.2],
                            "probabilities": [0.5, 0.5],
                        },
                        "source": "us",
                        "measure": {"to": 0.1, "minutes": 1, "how": "EMG"},
                    }
                }
            ),
            "no measure of it has a standard deviation",
        ),
        (changed(fixed={"weather": 1.0}), "'weather' is no factor"),
        (changed(fixed={"activation": 0.1}), "both among the factors and fixed"),
        (changed(fixed={"extension_stop": 1e6}), "must be fixed at a number from"),
        (changed(fixed=[1]), '"fixed" is an object'),
        (changed(sensors={"torque_zero": {"sd": -1.0}}), "must be a number, 0 or more"),
        (changed(sensors={"torque_zero": 3}), "must be a number, 0 or more"),
    ],
)
def test_a_population_that_means_nothing_is_one_sentence(content: Any, sentence: str) -> None:
    with pytest.raises(InterpretationError, match=sentence) as raised:
        population_of(content, "mine.json")
    assert "\n" not in str(raised.value)


def test_a_found_effect_is_in_the_next_bank() -> None:
    friction = "effect.coulomb_friction.torque"
    study = {
        "factors": [{"name": "forearm_mass"}, {"name": friction, "range": [2.6, 3.0]}],
        "fixed": {"robot_friction": 0.0},
    }
    grown = with_effects(OURS, study, "report.json")
    drawn = grown.draw(1, np.arange(64))[:, grown.names.index(friction)]
    assert 2.6 <= drawn.min() < 2.7 < 2.9 < drawn.max() <= 3.0
    assert "robot_friction" not in grown.names
    assert parameters_of(grown, grown.draw(1, np.arange(1))[0], "contact")["robot_friction"] == 0.0


def test_a_unit_follows_a_number_and_a_share_has_none() -> None:
    assert f"{0.96:g}{OURS.unit_after('forearm_mass')}" == "0.96 kg"
    assert f"{0.1:g}{OURS.unit_after('activation')}" == "0.1"


def test_a_file_that_is_no_population_is_named(tmp_path: Path) -> None:
    path = tmp_path / "mine.json"
    with pytest.raises(InterpretationError, match=r"mine\.json cannot be read"):
        read_population(path)
    path.write_text("{")
    with pytest.raises(InterpretationError, match=r"mine\.json is no JSON"):
        read_population(path)
    path.write_text(json.dumps(dict(OURS.content)))
    assert read_population(path).names == OURS.names
