"""An interval of a stiffness is as long as what the form of a found effect leaves out makes it."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import Model, evaluate, unfitted
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.report.impedance import Refits, with_unsaid
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from sim.effects.laws.elastic import Viscoelastic
from tests.testbed.sessions.rich import ELBOW, TRUTH, added, rich_elbow

MASS, STIFFNESS = 0.7, 8.0


@pytest.fixture(scope="module")
def refits() -> Refits:
    """Stiffness beside a payload found on its link's line; it hangs 8 cm beside that."""
    elbow = rich_elbow()
    centre = elbow.centre_of_mass(ELBOW)
    assert centre is not None
    axis = elbow.device.model.jnt_axis[ELBOW]
    across = np.cross(axis, centre) / np.linalg.norm(np.cross(axis, centre))
    effort = elbow.inverse + MASS * elbow.mass_torque(ELBOW, 1.6 * centre + 0.08 * across)
    effort[:, ELBOW] += STIFFNESS * (elbow.position[:, ELBOW] - 0.8)
    effort[:, ELBOW] += 0.01 * np.random.default_rng(2).standard_normal(len(effort))
    loud = replace(elbow, effort=elbow.filtered(effort), cache={})
    joint, payload, limb = unfitted(loud, ELBOW), BY_NAME["payload"], Viscoelastic()
    theta = {"distance": 1.6}
    terms = (
        Term(
            joint=ELBOW,
            columns=limb.columns(joint, {}),
            kept=(0, 1, 2),
            effect=limb,
            lower=(-np.inf,),
        ),
        Term(
            joint=ELBOW,
            columns=payload.columns(joint, theta),
            kept=(0,),
            effect=payload,
            theta=theta,
            candidate=Candidate(effect=payload, joint=ELBOW),
        ),
    )
    model, rows = Model(loud, terms=terms), select_rows(loud, (0,))
    return Refits(model, rows, evaluate(model, rows).coefficients)


def test_a_payload_beside_its_line_bends_the_stiffness_no_further_than_said(refits: Refits) -> None:
    found = refits.values[ELBOW]["stiffness"]
    low, high = refits.interval(ELBOW, "stiffness")
    assert low < STIFFNESS < high
    bias = refits.bias(ELBOW, "stiffness")
    assert abs(found - STIFFNESS) > 0.5 * bias > 0.0
    assert high - low > 2.0 * bias


def test_what_a_joint_s_effect_leaves_out_is_nothing_at_the_other_joints(
    recording: Recording,
) -> None:
    """Two of an opponent's twelve sessions of two joints had no report."""
    effect, (theta, own) = BY_NAME["load_dependent_friction"], TRUTH["load_dependent_friction"]
    columns = effect.columns(unfitted(recording, ELBOW), theta)
    term = added(effect.name, columns, theta, kept=(0, 1))
    model = Model(replace(recording, effort=recording.inverse, cache={}), terms=(term,))
    (bent,) = with_unsaid(model, np.array(own))
    change = {joint: bent.known()[joint] - model.known()[joint] for joint in recording.joints}
    assert len(change) == 2 and np.any(change.pop(ELBOW))
    assert not any(np.any(other) for other in change.values())
