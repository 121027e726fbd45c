"""From a report to a study: intervals become ranges, and what cannot be carried is said."""

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from analysis.closeloop.report.effect_study import EffectStudyError, study_with_effects
from models.built_in import built_in_models
from rehyb.cli import app
from server.logic.study.plans import FactorChoice, draw_up
from sim.effects.catalogue import ASSESSED
from sim.parameters.wearer import TABLE_1


def effect(name: str, **parameters: tuple[float, float, float]) -> dict[str, Any]:
    return {
        "name": name,
        "joint": "J4",
        "parameters": {
            key: {"value": value, "ci90": [low, high], "unit": "1"}
            for key, (value, low, high) in parameters.items()
        },
    }


def report(*effects: dict[str, Any]) -> dict[str, Any]:
    return {
        "schema": 1,
        "verdict": "effect_found",
        "effects": list(effects),
        "session": {"model": "nominal"},
    }


FRICTION = report(effect("coulomb_friction", torque=(2.8, 2.7, 2.9)))
REFLEX = report(
    effect(
        "stretch_reflex",
        gain=(8.0, 7.0, 9.5),
        threshold_velocity=(0.5, 0.45, 0.55),
        delay=(0.04, 0.03, 0.05),
        side=(-1.0, -1.0, -1.0),
    )
)


def study(found: dict[str, Any], **options: Any) -> dict[str, Any]:
    chosen = {"model": "elbow_bushing_effects", "method": "morris", "rows": 4, **options}
    return study_with_effects(found, **chosen)


def test_an_interval_becomes_the_range_of_a_factor_beside_table_1() -> None:
    drawn = study(FRICTION)
    assert [factor["name"] for factor in drawn["factors"][:6]] == [f.name for f in TABLE_1]
    assert drawn["factors"][6:] == [{"name": "effect.coulomb_friction.torque", "range": [2.7, 2.9]}]
    assert drawn["fixed"] == {}


def test_a_choice_and_a_parameter_without_interval_keep_their_value() -> None:
    exact = report(effect("payload", mass=(0.5, 0.4, 0.6), distance=(0.2, 0.2, 0.2)))
    assert study(exact)["fixed"] == {"effect.payload.distance": 0.2}
    drawn = study(REFLEX)
    assert drawn["fixed"] == {"effect.stretch_reflex.side": -1.0}
    assert len(drawn["factors"]) == 9


def test_from_none_the_size_begins_where_there_is_no_effect() -> None:
    assert study(FRICTION, from_none=True)["factors"][6]["range"] == [0.0, 2.9]
    gain = report(effect("torque_gain", gain=(0.9, 0.88, 0.92)))
    assert study(gain, from_none=True)["factors"][6]["range"] == [0.88, 1.0]


def test_an_interval_never_leaves_what_the_simulation_can_mean() -> None:
    wide = report(effect("coulomb_friction", torque=(0.1, -0.05, 0.2)))
    assert study(wide)["factors"][6]["range"] == [0.0, 0.2]


@pytest.mark.parametrize("found", [FRICTION, REFLEX])
@pytest.mark.parametrize("method", ["morris", "saltelli"])
def test_the_coordinator_takes_the_study(found: dict[str, Any], method: str) -> None:
    drawn = study(found, method=method)
    assert drawn.pop("outside_range")
    choices = [
        FactorChoice(name=f["name"], range=tuple(f["range"]) if "range" in f else None)
        for f in drawn["factors"]
    ]
    plan = draw_up(
        **{**drawn, "sampling": "sobol", "factors": choices, "fixed": drawn["fixed"]}
        | {"model": built_in_models()[drawn["model"]], "called": drawn["model"]},
    )
    assert len(plan.distributions) == len(drawn["factors"])


@pytest.mark.parametrize(
    ("found", "words"),
    [
        ({**FRICTION, "verdict": "adequate"}, "its verdict is adequate"),
        ({"schema": 1}, "no report.json"),
        ([], "no report.json"),
        (report(effect("backlash", gap=(0.1, 0.1, 0.2))), "cannot carry backlash"),
        (report(effect("coulomb_friction", magic=(1.0, 1.0, 2.0))), "no parameter 'magic'"),
        (
            report(
                effect("coulomb_friction", torque=(1.0, 0.9, 1.1)),
                {**effect("torque_offset", torque=(1.0, 0.9, 1.1)), "joint": "J2"},
            ),
            "at J2, J4",
        ),
        (
            {
                **report(effect("nonlinear_stiffness", centre=(1.0, 0.9, 1.1))),
                "session": {"model": "device.xml"},
            },
            "session's own",
        ),
    ],
)
def test_what_cannot_be_studied_is_said_in_a_sentence(found: Any, words: str) -> None:
    with pytest.raises(EffectStudyError, match=words):
        study(found)


def test_every_effect_that_can_be_carried_is_in_the_documentation() -> None:
    page = (Path(__file__).parents[5] / "docs" / "use" / "close_loop.md").read_text()
    section = page.split("## From a found effect")[1].split("\n## ")[0]
    for name in ASSESSED:
        assert f"`{name}`" in section


def test_a_model_without_effects_is_refused() -> None:
    with pytest.raises(EffectStudyError, match="elbow_effects"):
        study(FRICTION, model="elbow")


def test_the_command_writes_the_study_it_would_submit(tmp_path: Path) -> None:
    (tmp_path / "report.json").write_text(json.dumps(FRICTION))
    out = tmp_path / "study.json"
    ran = CliRunner().invoke(
        app,
        ["study", "with-effect", str(tmp_path / "report.json"), "--rows", "7", "--out", str(out)],
    )
    assert ran.exit_code == 0, ran.output
    written = json.loads(out.read_text())
    assert written["model"] == "elbow_effects" and written["rows"] == 7
