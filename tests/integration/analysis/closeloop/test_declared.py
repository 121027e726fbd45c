"""Declared effects: their fitted values stand in the report and in the repaired model."""

import json
from pathlib import Path
from typing import Any

import mujoco
import pytest

from tests.testbed.sessions.closed import closed_without_page
from tests.testbed.sessions.synthetic import write_session

SEED = 3
#: Hz: half of what measurements of the method record; the bounds are the same.
RATE = 250.0


def closed(
    tmp_path: Path, declared: list[str], effects: tuple[str, ...]
) -> tuple[dict[str, Any], mujoco.MjModel]:
    """Close the loop on a session of an arm with `effects`, whose user declares some."""
    folder = tmp_path / "session"
    write_session(folder, SEED, effects, declared=False, speeds=(0.35, 0.8, 1.6), rate=RATE)
    session = json.loads((folder / "session.json").read_text())
    session["declared_effects"] = [{"effect": name, "joint": "elbow"} for name in declared]
    (folder / "session.json").write_text(json.dumps(session))
    report = closed_without_page(folder, tmp_path / "out")
    return report, mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "model_after.xml"))


def test_load_dependent_friction_beside_a_declared_coulomb_friction(tmp_path: Path) -> None:
    report, model = closed(tmp_path, ["coulomb_friction"], ("load_dependent_friction",))
    (found,) = report["effects"]
    # The declared effect has the part that does not depend on load.
    assert found["name"] == "load_dependent_friction" and set(found["parameters"]) == {"load_share"}
    (declared,) = report["declared"]
    torque = declared["parameters"]["torque"]
    assert (declared["effect"], declared["joint"], torque["unit"]) == (
        *("coulomb_friction", "elbow", "Nm"),
    )
    # Before the repair it stood for the load-dependent part as well.
    assert 0 < torque["value"] < torque["before"]
    assert torque["ci90"][0] < torque["value"] < torque["ci90"][1]
    assert model.dof_frictionloss[1] == pytest.approx(torque["value"], rel=1e-4)
    assert report["confirmation"]["ran"]


def test_friction_that_varies_along_the_range_beside_a_declared_coulomb_friction(
    tmp_path: Path,
) -> None:
    report, _ = closed(tmp_path, ["coulomb_friction"], ("position_dependent_friction",))
    (found,) = report["effects"]
    # It has no level of its own, and is simulated without.
    assert found["name"] == "position_dependent_friction"
    assert "torque_middle" not in found["parameters"]
    assert report["confirmation"]["ran"]


def test_every_declared_value_is_in_the_model_that_is_written(tmp_path: Path) -> None:
    names = ["coulomb_friction", "viscous_friction", "torque_offset"]
    report, model = closed(tmp_path, names, ("coulomb_friction",))
    assert report["verdict"] == "adequate"
    values = {
        entry["effect"]: {name: p["value"] for name, p in entry["parameters"].items()}
        for entry in report["declared"]
    }
    assert list(values) == names
    assert model.dof_frictionloss[1] == pytest.approx(
        values["coulomb_friction"]["torque"], rel=1e-4
    )
    assert model.dof_damping[1] == pytest.approx(values["viscous_friction"]["damping"], rel=1e-4)
    assert model.actuator_biasprm[0, 0] == pytest.approx(
        -values["torque_offset"]["torque"], rel=1e-4
    )


def test_a_declared_effect_that_no_fit_gives_a_value_is_said(tmp_path: Path) -> None:
    report, _ = closed(tmp_path, ["time_delay"], ())
    assert report["declared"] == [{"effect": "time_delay", "joint": "elbow", "parameters": {}}]
    assert any("declared time_delay of elbow has no value" in w for w in report["warnings"])
