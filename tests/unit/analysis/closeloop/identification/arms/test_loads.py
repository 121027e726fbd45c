"""A load on an arm that moves one joint a trial hangs where the trials say, and no further."""

from pathlib import Path

import pytest

from analysis.closeloop.identification.arms.links import links_of
from analysis.closeloop.identification.arms.ordinary import with_ordinary
from analysis.closeloop.identification.arms.robot import weighed
from analysis.closeloop.identification.arms.shared import with_share
from analysis.closeloop.identification.arms.whole_fit import WholeFit
from analysis.closeloop.identification.balance.model import Model
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from sim.effects.laws.inertia import PLACE
from tests.testbed.sessions.upright import ASIDE, joint_by_joint

MASS, AT = 1.2, (0.2, 0.0, 0.03)


@pytest.fixture
def asked(tmp_path: Path) -> tuple[Model, Rows]:
    """Return a model with what each joint may have, and the rows; the load is not declared."""
    recording = joint_by_joint(tmp_path, MASS, AT)
    rows = weighed(Model(recording), select_rows(recording, recording.fit_trials))
    return with_ordinary(Model(recording), rows), rows


def test_along_an_axis_that_no_trial_tells_it_stays_where_the_link_s_own_mass_is(
    asked: tuple[Model, Rows],
) -> None:
    model, rows = asked
    fit = WholeFit(model, rows, links_of(model.recording))
    load = min(fit.loads(), key=lambda one: one.loss)
    assert load.place is not None
    assert (load.link, load.told) == (2, (0, 1, 3))
    assert load.mass == pytest.approx(MASS, rel=0.02)
    assert load.place == pytest.approx([AT[0], ASIDE, AT[2]], abs=0.01)


def test_it_is_named_and_later_steps_leave_it_there(asked: tuple[Model, Rows]) -> None:
    model, rows = asked
    shared = with_share(model, rows, links_of(model.recording), links_free=True)
    (load,) = [c for c in shared.effects if c not in model.effects]
    assert load.key == ("payload", 2)
    term = next(term for term in shared.terms if term.candidate == load)
    assert term.kept == (0, 1, 3) and term.theta[PLACE[1]] == pytest.approx(ASIDE)


def test_a_load_that_no_arm_could_carry_is_none(
    asked: tuple[Model, Rows], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where a link's axes meet in its frame 2 250 kg at the frame took what its moments do."""
    model, rows = asked
    fit = WholeFit(model, rows, links_of(model.recording))
    heaviest = max(load.mass for load in fit.loads())
    assert heaviest < 10.0 * model.recording.mass
    monkeypatch.setattr(type(model.recording), "mass", heaviest / 10.1)
    assert all(load.mass < heaviest for load in fit.loads())
