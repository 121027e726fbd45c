"""Torques of a chain with one joint elsewhere."""

from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from analysis.closeloop.session.chain.elsewhere import coefficients, rates
from tests.unit.analysis.closeloop.session.chain.test_link_torque import ARM, inverse

SPRUNG = ARM.replace('name="b" axis', 'name="b" stiffness="7" damping="2" axis')
TENDON = """<tendon><spatial stiffness="300" springlength="0.3"><site site="low"/>
<site site="high"/></spatial></tendon></mujoco>"""
TIED = (
    SPRUNG.replace('<body name="tool"', '<site name="high"/><body name="tool"')
    .replace("<worldbody>", '<worldbody><site name="low" pos="0.5 0 0"/>')
    .replace("</mujoco>", TENDON)
)


def moved(xml: str, joint: int) -> tuple[Callable[[float], np.ndarray], np.ndarray]:
    """Return the torques of a chain that moves somehow by the way of a joint, and for none."""
    spec = mujoco.MjSpec.from_string(xml)
    motion = np.random.default_rng(1).normal(size=(3, 4, 3))

    def torque(way: float) -> np.ndarray:
        there = motion.copy()
        there[0, :, joint] += way
        return inverse(spec, there)

    return torque, torque(0.0)


@pytest.mark.parametrize("joint", [0, 1, 2])
@pytest.mark.parametrize("way", [-1.3, 1e-4, 0.2, 2.6])
def test_a_few_ways_tell_all_others(joint: int, way: float) -> None:
    (torque, here), hinge = moved(SPRUNG, joint), joint < 2
    known = coefficients(torque, here, hinge)
    found = here + way * np.tensordot(rates(way, hinge), known, axes=1)
    assert found == pytest.approx(torque(way), abs=1e-11)


@pytest.mark.parametrize("hinge", [True, False])
def test_the_rates_over_no_way_are_slopes(hinge: bool) -> None:
    assert rates(0.0, hinge) == pytest.approx(rates(1e-9, hinge), abs=1e-8)


def test_what_pulls_along_a_tendon_is_no_polynomial_and_said_to_be_none() -> None:
    assert len(coefficients(*moved(TIED, 1), True)) == 0
