"""A link whose moments alone are known has no mass."""

from pathlib import Path

import numpy as np
import pytest

from analysis.closeloop.identification.arms import robot
from analysis.closeloop.identification.arms.links import PARAMETERS, links_of
from analysis.closeloop.identification.arms.ordinary import with_ordinary
from analysis.closeloop.identification.arms.robot import with_links
from analysis.closeloop.identification.arms.whole_fit import WholeFit
from analysis.closeloop.identification.balance.model import Model
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.findings import Carried
from analysis.closeloop.report.named import refused_values
from analysis.closeloop.report.shared import (
    _link,
    link_parameters,
    mass_entry,
    moments_entry,
    of_unnamed_loads,
    other_than,
    payload_mass,
    place_entry,
    undetermined_loads,
)
from tests.testbed.sessions.upright import all_at_once


def test_a_mass_that_could_be_none_has_no_value_nor_has_its_centre() -> None:
    """As of a robot's upper arm, near whose axis a large mass makes no torque: 81 kg, 0 to 224."""
    found = _link(np.array([81.0, 0.0, 0.1, 0.01]), np.array([143.0, 0.02, 0.1, 0.02]))
    assert all(entry["value"] is None and entry["ci90"] is None for entry in found.values())
    (said,) = refused_values([{"name": "links", "joint": "lift", "parameters": found}])
    assert said.startswith(
        "links of lift: mass is not determined, because its 90 % interval, -62 to 224 kg"
    )


def test_a_mass_that_is_known_has_an_interval() -> None:
    found = _link(np.array([4.0, 0.2, 0.0, -0.1]), np.array([3.5, 0.01, 0.02, 0.03]))
    assert found["mass"] == {"value": 4.0, "ci90": [0.5, 7.5], "unit": "kg"}
    assert found["position_z"]["ci90"] == pytest.approx([-0.13, -0.07])


def test_a_link_that_no_joint_feels_is_as_declared_for_all_that_rounding_moves_it() -> None:
    """The first link of an arm was reported as measured: 6.11 kg, 6.11 to 6.11."""
    declared = np.array([[6.1, 0.0, 0.0, 0.06], [3.0, 0.15, 0.0, 0.0], [1.4, 0.13, 0.0, 0.0]])
    found = declared + np.array([[1e-13, 1e-15, 0, -1e-15], [0, 0.002, 0, 0], [0.01, 0, 0, 0]])
    assert np.argwhere(other_than(found, declared)).tolist() == [[1, 1], [2, 0]]


def test_links_of_an_arm_are_listed_but_for_one_that_no_joint_feels(tmp_path: Path) -> None:
    """Of a turret that turns about an upright axis neither mass nor centre makes a torque."""
    arm = all_at_once(tmp_path, 29)
    rows, links = robot.weighed(Model(arm), select_rows(arm, arm.fit_trials)), links_of(arm)
    model = with_ordinary(Model(arm), rows)
    found = WholeFit(model, rows, links).with_links(range(len(model.terms)))
    entries = link_parameters(with_links(model, links, found.links), rows)
    assert links.names == ("turret", "arm", "fore")
    assert {name.split(".")[0] for name in entries} == {"arm", "fore"}
    for name, entry in entries.items():
        assert entry["ci90"] is None or entry["ci90"][0] < entry["ci90"][1], name


def test_what_no_joint_feels_of_a_link_is_as_unsure_as_other_links_are_wrong(
    tmp_path: Path,
) -> None:
    """It stays as it is declared, which says nothing of how near that is."""
    arm = all_at_once(tmp_path, 29)
    rows, links = robot.weighed(Model(arm), select_rows(arm, arm.fit_trials)), links_of(arm)
    fit = WholeFit(with_ordinary(Model(arm), rows), rows, links)
    fitted = fit.with_links(range(len(fit.model.terms)))
    covariance, told = fit.drawn(fitted.links)
    drawn = np.sqrt(covariance.diagonal()).reshape(-1, PARAMETERS) / links.declared[:, :1]
    # The turret's mass; the way to the fore's centre, which two joints feel.
    assert drawn[0, 0] > 0.5 and drawn[2, 1] < 1e-3
    assert 5.0 < told < 15.0
    twice, _ = fit.drawn(2.0 * fitted.links)
    assert twice == pytest.approx(4.0 * covariance)


@pytest.mark.parametrize(
    ("mass", "half", "felt", "known", "why"),
    [
        (0.50, (0.01, 0.02, 0.02, 0.02), (0, 1, 2, 3), (True, True, True), ""),
        # As of an arm that moves in a plane.
        (0.50, (0.01, 0.02, 0.00, 0.02), (0, 1, 3), (True, False, True), "no joint feels it"),
        (0.50, (0.01, 0.02, 0.02, 0.90), (0, 1, 2, 3), (True, True, False), "than the device"),
        (0.50, (0.01, 0.02, 0.02, 2e7), (0, 1, 2, 3), (True, True, False), "do not determine it"),
        # A few grams, beside the noise: 0 to 17 g.
        (0.005, (0.012, 0.9, 0.0, 1.0), (0, 1, 3), (False,) * 3, "may have no mass"),
        # None at all: its place is a quotient by nothing.
        (0.0, (0.001, 6e5, 0.0, 1e6), (0, 1, 3), (False,) * 3, "may have no mass"),
    ],
)
def test_a_payload_has_a_place_only_where_the_trials_say_one(
    mass: float, half: tuple[float, ...], felt: tuple[int, ...], known: tuple[bool, ...], why: str
) -> None:
    value = np.array([mass, 0.25, 0.0, 0.01])
    found = place_entry(value, np.array(half), felt, reach=0.8)
    assert tuple(way is not None for way in found["value"]) == known
    assert tuple(interval is not None for interval in found["ci90"]) == known
    entry = {"name": "tool", "parameters": {"position": found}}
    said = undetermined_loads([entry, {"name": "friction", "parameters": {}}])
    assert len(said) == bool(why) and why in " ".join(said)


def test_a_payload_that_is_felt_and_weighs_nothing_has_no_mass() -> None:
    """As of a surgical robot whose links were made up: 0.205 kg would have been 0 to 0.012 kg."""
    refused = payload_mass(0.0, 0.012, felt=True)
    assert refused["value"] is None and refused["ci90"] is None
    (said,) = undetermined_loads([{"name": "weight", "parameters": {"mass": refused}}])
    assert "payload weight: its mass is not determined" in said and "model_after.xml" in said
    # A load that is not there weighs nothing, and that is known.
    assert payload_mass(0.0, 0.012, felt=False)["ci90"] == [0.0, 0.012]
    assert payload_mass(0.16, 0.03, felt=True)["ci90"] == pytest.approx([0.13, 0.19])


@pytest.mark.parametrize(("half", "said"), [(0.02, "0.6 kg (0.58 to 0.62)"), (0.7, "0.12 kg m")])
def test_an_unnamed_load_has_an_interval_or_else_its_moments_alone(half: float, said: str) -> None:
    load = Carried(
        trial=0,
        body="fore",
        joint=1,
        value=np.array([0.6, 0.2, 0.0, 0.0]),
        half=np.array([half, 0.01, 0.0, 0.01]),
        moments=np.array([0.12, 0.0, 0.0]),
        half_moments=np.array([0.002, 0.0, 0.003]),
        felt=(0, 1, 3),
        share=0.9,
    )
    entry = {
        "file": "t.csv",
        "body": "fore",
        "name": "load 1",
        "fitted": False,
        "mass": mass_entry(load.value[0], load.half[0]),
        "moments": moments_entry(load),
    }
    assert (entry["mass"]["value"] is None) is (half > 0.6)
    assert entry["moments"]["value"] == [0.12, None, 0.0]
    assert entry["moments"]["ci90"][0] == pytest.approx([0.118, 0.122])
    (line,) = of_unnamed_loads([entry])
    assert said in line and '"payload"' in line and "factor" not in line
    # Of one joint it may be a gain.
    (line,) = of_unnamed_loads([entry], lone=True)
    assert said in line and "unless its efforts have another factor" in line
