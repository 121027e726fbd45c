"""A wrong zero moves all that hangs from its joint: what was found there, too."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.arms.links import last_links, links_of
from analysis.closeloop.identification.arms.shared import with_links
from analysis.closeloop.identification.arms.whole_fit import WholeFit, loaded
from analysis.closeloop.identification.arms.zeros import beside_load
from analysis.closeloop.identification.balance.declared import placed
from analysis.closeloop.identification.balance.model import (
    Model,
    evaluate,
    unfitted,
    with_independent,
)
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.session.chain.link_torque import chain_motion
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from sim.effects.rigid import point_mass
from tests.testbed.sessions.rich import rich_recording

ZERO = BY_NAME["position_offset"]
SHOULDER, OFFSET = 0, 0.08
MASS, PLACE = 1.0, np.array([0.15, 0.0, 0.05])


def carrying(offset: float) -> Recording:
    """Return an arm that carries a load at its last link, whose shoulder's zero is wrong."""
    still = rich_recording(20)
    (body,) = last_links(still)
    there = still.position.copy()
    there[:, SHOULDER] -= offset
    moved = chain_motion(still.device.model, there, still.velocity, still.acceleration)
    effort = still.inverse + MASS * (moved.link_torque(body) @ point_mass(PLACE))
    if offset:
        effort -= offset * still.secant(SHOULDER, -offset)
    noise = 0.02 * np.random.default_rng(5).standard_normal(effort.shape)
    return replace(still, effort=still.filtered(effort + noise), cache={})


def zero_beside(model: Model, rows: Rows) -> Model:
    """Return the model with a small zero of the shoulder, of the declared chain alone."""
    theta = {"offset": 1e-3}
    columns = ZERO.columns(unfitted(model.recording, SHOULDER), theta)
    here = Candidate(effect=ZERO, joint=SHOULDER)
    term = Term(effect=ZERO, joint=SHOULDER, columns=columns, theta=theta, candidate=here)
    return with_independent(model, term, rows)


def hung(model: Model, rows: Rows) -> Model:
    """Return the model with the load that explains most."""
    links = links_of(model.recording)
    best = min(WholeFit(model, rows, links).loads(), key=lambda load: load.loss)
    return loaded(model, rows, links, best)


def test_a_zero_takes_the_slope_of_the_chain_with_the_load_that_was_found() -> None:
    """Else it stands for the load's own change too, and is as much too large as that is of all."""
    arm = carrying(OFFSET)
    rows = select_rows(arm, (0,))
    model = placed(zero_beside(hung(Model(arm), rows), rows), rows)
    mass, *_, zero = evaluate(model, rows).coefficients.tolist()
    assert zero == pytest.approx(OFFSET, rel=0.01) and mass == pytest.approx(MASS, rel=0.01)
    # However well it lies already: its slope may be that of before the load.
    begun = hung(placed(zero_beside(Model(arm), rows), rows), rows)
    again = placed(begun, rows)
    assert evaluate(again, rows).coefficients[0] == pytest.approx(OFFSET, rel=0.01)


def test_a_zero_takes_the_slope_of_the_links_that_were_found() -> None:
    arm = carrying(OFFSET)
    rows, links = select_rows(arm, (0,)), links_of(arm)
    (body,) = last_links(arm)
    change = np.zeros_like(links.declared)
    change[links.bodies.index(body)] = MASS * point_mass(PLACE)
    model = placed(zero_beside(with_links(Model(arm), links, change), rows), rows)
    assert evaluate(model, rows).coefficients == pytest.approx([OFFSET], rel=0.01)


@pytest.mark.parametrize("offset", [0.03, 0.0])
def test_beside_a_load_a_zero_counts_by_its_torque_and_not_by_what_is_left_without_it(
    offset: float,
) -> None:
    """Where the load hangs stands for most of what gravity shows of a zero."""
    arm = carrying(offset)
    rows = select_rows(arm, (0,))
    model = beside_load(hung(Model(arm), rows), rows)
    zeros = {c.joint for c in model.effects if c.effect is ZERO}
    assert zeros == ({SHOULDER} if offset else set())
    # Without a load nothing is asked.
    assert beside_load(Model(arm), rows).terms == ()
