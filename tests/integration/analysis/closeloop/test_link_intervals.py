"""Mass and centre of links are as sure as their intervals say, however wrong links are declared."""

from pathlib import Path

import mujoco

from analysis.closeloop.identification.arms import robot
from analysis.closeloop.identification.arms.links import links_of
from analysis.closeloop.identification.arms.ordinary import with_ordinary
from analysis.closeloop.identification.arms.whole_fit import WholeFit
from analysis.closeloop.identification.balance.model import Model
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.report.shared import link_parameters
from tests.testbed.sessions.upright import ROBOT, all_at_once

SEEDS = range(200, 212)
PLACE = ("position_x", "position_y", "position_z")


def test_nine_of_ten_intervals_of_links_hold(tmp_path: Path) -> None:
    """By what the fits without parts of a trial say alone, 130 of 152 did (seeds 100 to 119)."""
    body = mujoco.MjModel.from_xml_string(ROBOT).body
    holds = []
    for seed in SEEDS:
        folder = tmp_path / str(seed)
        folder.mkdir()
        for name, entry in _parameters(folder, seed).items():
            link, word = name.split(".")
            true = body(link).mass if word == "mass" else body(link).ipos[PLACE.index(word)]
            if entry["ci90"] is not None:
                holds.append(entry["ci90"][0] <= true <= entry["ci90"][1])
    assert len(holds) > 6 * len(SEEDS)
    assert sum(holds) >= 0.9 * len(holds)


def _parameters(folder: Path, seed: int) -> dict[str, dict[str, list[float] | None]]:
    arm = all_at_once(folder, seed)
    rows, links = robot.weighed(Model(arm), select_rows(arm, arm.fit_trials)), links_of(arm)
    model = with_ordinary(Model(arm), rows)
    found = WholeFit(model, rows, links).with_links(range(len(model.terms)))
    return link_parameters(robot.with_links(model, links, found.links), rows)
