"""What is declared may imitate most of an effect; what is left of it may be seen all the same."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import Model, evaluate
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.identification.nameable import lowest, refusal
from sim.effects.catalogue import BY_NAME
from sim.effects.elements import add_damping
from tests.testbed.sessions.rich import ELBOW, rich_elbow, rich_recording


@pytest.mark.parametrize(("noise", "refused"), [(0.002, False), (3.0, True)])
def test_an_effect_that_is_mostly_imitated_is_named_if_it_takes_nearly_all(
    noise: float, refused: bool
) -> None:
    """Inertia in motion of nearly one frequency: a spring does almost the same."""
    elbow = rich_elbow(14)
    inertia = elbow.acceleration[:, [ELBOW]]
    spring = inertia + 0.3 * elbow.velocity[:, [ELBOW]] * np.sin(0.9 * elbow.time)[:, None]
    effort = np.array(elbow.inverse)
    effort[:, [ELBOW]] += inertia
    effort += noise * np.random.default_rng(2).standard_normal(effort.shape)
    loud = replace(elbow, effort=elbow.filtered(effort), cache={})
    rows = select_rows(loud, (0,)).reweighted({ELBOW: noise})
    declared = Model(loud, terms=(Term(joint=ELBOW, columns={ELBOW: spring}, kept=(0,)),))
    candidate = Candidate(effect=BY_NAME["added_inertia"], joint=ELBOW)
    own = Term(
        joint=ELBOW,
        columns={ELBOW: inertia},
        kept=(0,),
        effect=candidate.effect,
        candidate=candidate,
    )
    current, scored = evaluate(declared, rows), evaluate(declared.with_term(own), rows)
    scored = replace(
        scored, variant=replace(scored.variant, columns=rows.stack({ELBOW: inertia}, 1))
    )
    assert bool(refusal(declared, rows, candidate, scored, current)) is refused


def test_friction_may_take_away_what_the_device_declares_and_no_more() -> None:
    recording = rich_recording()
    spec = recording.device.spec.copy()
    name = recording.device.joints[ELBOW]
    spec.joint(name).frictionloss = 0.5
    add_damping(spec.joint(name), 0.2)
    rubbing = replace(recording, device=replace(recording.device, spec=spec))

    def bounds(effect: str, joint: int = ELBOW) -> tuple[float, ...]:
        return lowest(Model(rubbing), Candidate(effect=BY_NAME[effect], joint=joint))

    assert bounds("coulomb_friction")[0] == -0.5
    assert bounds("viscous_friction")[0] == -0.2
    assert bounds("asymmetric_friction") == (-0.5, -np.inf, -np.inf, -0.2)
    # Only its level when fast is declared.
    assert bounds("stribeck_friction") == (-0.5, 0.0)
    assert bounds("hysteresis")[0] == bounds("coulomb_friction", 1 - ELBOW)[0] == 0.0
