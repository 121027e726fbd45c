"""Springs of a robot's joints, and what only seems to swing."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.arms.loose import with_loose
from analysis.closeloop.identification.arms.ordinary import with_ordinary
from analysis.closeloop.identification.balance.model import Model
from analysis.closeloop.identification.balance.regression import select_rows
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.moved import moved
from tests.testbed.sessions.rich import swung

NOISE, RATE = 0.02, 200.0
#: A motor's rotor on a bench.
BENCH = """<mujoco><option gravity="0 0 -9.81"/><worldbody><body name="rotor">
<inertial pos="0 0 0" mass="0.3" diaginertia="0.001 0.001 0.001"/>
<joint name="shaft" axis="0 0 1"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize("late_s", [-0.012, 0.01])
def test_a_joint_whose_effort_is_late_hangs_on_no_spring(late_s: float) -> None:
    """Two of a stranger's bare motors did: what is late left three quarters of that."""
    time = np.arange(int(40.0 * RATE)) / RATE
    rng = np.random.default_rng(3)
    waves = zip(rng.uniform(1.0, 7.0, 12), rng.uniform(0.0, 6.0, 12), strict=True)
    turned = sum(np.sin(2 * np.pi * hertz * time + phase) / hertz for hertz, phase in waves)
    bench = swung(BENCH, (0.0,), (0.5,))
    bench = replace(bench, session=replace(bench.session, limb_joints=()))
    bench = replace(moved(bench, np.asarray(turned)[:, None], RATE), joints=(0,), cache={})
    rubbing = 0.15 * np.tanh(bench.velocity / 0.05)
    effort = bench.inverse + 0.004 * bench.acceleration + rubbing
    effort = BY_NAME["time_delay"].through(bench, effort, {"delay": late_s})
    effort = effort + NOISE * rng.standard_normal(effort.shape)
    bench = replace(bench, effort=bench.filtered(effort), cache={})
    rows = select_rows(bench, (0,)).reweighted({0: NOISE})
    model = with_ordinary(Model(bench), rows)
    assert with_loose(model, rows) == (model, {})
