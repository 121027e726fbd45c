"""A load of a limb and a gain beside a wrong zero are told apart only where one fits worse."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import Model, evaluate
from analysis.closeloop.identification.balance.regression import Rows, compare, select_rows
from analysis.closeloop.identification.balance.terms import Candidate
from analysis.closeloop.identification.candidates import tried_alone
from analysis.closeloop.identification.findings import Grown, Option, Step, exchanged
from analysis.closeloop.identification.loads.askew import with_gains_askew
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.rich import ELBOW, rich_elbow

LOAD = Candidate(effect=BY_NAME["payload"], joint=ELBOW)


def loaded(torque: np.ndarray) -> tuple[Grown, Rows]:
    """Return a payload found in an effort, Nm, (n,), and the rows."""
    elbow = rich_elbow(20)
    effort = np.full_like(elbow.position, np.nan)
    noise = 0.01 * np.random.default_rng(0).standard_normal(len(torque))
    effort[:, ELBOW] = torque + noise
    recording = replace(elbow, effort=elbow.filtered(effort), cache={})
    declared, rows = Model(recording), select_rows(recording, (0,))
    found = tried_alone(declared, rows, LOAD)
    assert found is not None
    gain, error = compare(evaluate(declared, rows).losses, found[1].losses)
    taken = Option(candidate=LOAD, model=found[0], score=found[1], gain=gain, z=gain / error)
    return Grown(*found, (Step(taken=taken, equals=(), options=(), before=gain),)), rows


def test_a_gain_beside_a_wrong_zero_is_an_equal_of_the_load_that_it_looks_like() -> None:
    elbow = rich_elbow(20)
    elsewhere = elbow.inverse - 0.1 * elbow.secant(ELBOW, -0.1)
    grown, rows = loaded(elsewhere[:, ELBOW] / 0.9)
    (step,) = with_gains_askew(grown, rows).steps
    (option,) = step.equals
    assert option.candidate.key == ("torque_gain", ELBOW)
    assert [other.key for other in option.beside] == [("position_offset", ELBOW)]
    model = exchanged(grown.model, step.taken, option)
    assert {one.key[0] for one in model.effects} == {"torque_gain", "position_offset"}
    values = dict(zip(("offset", "gain"), evaluate(model, rows).coefficients, strict=False))
    assert BY_NAME["torque_gain"].gain(np.array([values["gain"]])) == pytest.approx(0.9, abs=0.02)


def test_a_load_that_they_do_not_imitate_has_no_equal() -> None:
    elbow = rich_elbow(20)
    weight = 0.4 * 9.81 * 0.25 * np.cos(elbow.position.sum(axis=1))
    weighs = weight + 0.4 * 0.25**2 * elbow.acceleration[:, ELBOW]
    grown, rows = loaded(elbow.inverse[:, ELBOW] + weighs)
    (step,) = with_gains_askew(grown, rows).steps
    assert not step.equals
