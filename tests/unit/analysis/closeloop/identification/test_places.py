"""A load hangs beside its link's line where trials tell how far, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import Model, evaluate, unfitted
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.findings import Grown
from analysis.closeloop.identification.places import with_told_places
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from sim.effects.laws.inertia import ASIDE
from tests.testbed.sessions.rich import ELBOW, added, rich_elbow

MASS, ON_LINE = 0.7, {"distance": 1.6}


def found_on_line(noise: float, aside: float, rubs: float = 0.0) -> dict[str, float]:
    """Return where a load is said to be that was fitted on its link's line.

    Args:
        noise: of the effort, Nm.
        aside: how far beside its line the load is, over its link's centre of mass.
        rubs: friction that turns 30 ms later than the joint, Nm; a model turns it at once.
    """
    elbow, payload = rich_elbow(), BY_NAME["payload"]
    true = payload.columns(unfitted(elbow, ELBOW), {**ON_LINE, ASIDE: aside})
    effort = np.array(elbow.inverse)
    effort[:, ELBOW] += MASS * true[ELBOW][:, 0]
    turned = np.sign(elbow.velocity[:, ELBOW])
    effort[:, ELBOW] += rubs * np.roll(turned, round(0.03 * elbow.rate))
    effort += noise * np.random.default_rng(2).standard_normal(effort.shape)
    loud = replace(elbow, effort=elbow.filtered(effort), cache={})
    rows = select_rows(loud, (0,))
    columns = payload.columns(unfitted(loud, ELBOW), ON_LINE)
    friction = BY_NAME["coulomb_friction"].columns(unfitted(loud, ELBOW), {"smooth": 0.02})
    terms = [added("payload", columns, ON_LINE, kept=(0,))]
    terms += [added("coulomb_friction", friction, {"smooth": 0.02})] if rubs else []
    model = Model(loud, terms=tuple(terms))
    found = with_told_places(Grown(model, evaluate(model, rows)), rows).model.terms
    return dict(next(term.theta for term in found if "distance" in term.theta))


@pytest.mark.parametrize("aside", [0.0, 0.4, -0.4])
def test_a_load_is_freed_from_its_line_where_trials_tell_where_it_hangs(aside: float) -> None:
    """Ten kilograms made an interval of K as long as K, though told to within a centimetre."""
    found = found_on_line(0.01, aside)
    assert found[ASIDE] == pytest.approx(aside, abs=0.05)
    assert found["distance"] == pytest.approx(1.6, abs=0.1)


def test_where_friction_turns_it_tells_no_place_of_a_load() -> None:
    """It moved loads aside by 4 cm, and K of three limbs out of its interval (a stranger's)."""
    assert found_on_line(0.01, 0.0, rubs=0.5)[ASIDE] == pytest.approx(0.0, abs=0.05)


def test_a_load_stays_on_its_line_about_an_upright_axis(monkeypatch: pytest.MonkeyPatch) -> None:
    """There a step aside does nothing, and no fit says where the load is."""

    def weightless(own: Recording, joint: int, position: np.ndarray) -> np.ndarray:
        return np.asarray((position @ position) * own.acceleration)

    monkeypatch.setattr(Recording, "mass_torque", weightless)
    assert found_on_line(0.01, 0.0) == ON_LINE


def test_a_load_stays_on_its_line_where_no_trial_tells_where_it_hangs() -> None:
    assert found_on_line(20.0, 0.4) == ON_LINE
