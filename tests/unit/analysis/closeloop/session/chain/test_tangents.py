import mujoco
import numpy as np
import pytest

from analysis.closeloop.session.chain.link_torque import WAYS, Of, Tangents
from sim.effects.rigid import point_mass

ARM = """<mujoco><worldbody><body pos="0 0 1"><joint name="a" axis="0 0 1"/>
<geom size=".1" mass="3" pos=".1 0 .1"/><body name="b" pos=".3 0 0" euler="30 0 20">
<joint name="b" axis="0 1 0" pos="0 0 .1"/><geom type="box" size=".1 .2 .3" mass="2" pos=".2 .1 0"/>
<body name="c" pos="0 .2 .4"><joint name="c" type="slide" axis="1 0 1"/>
<geom type="box" size=".05 .02 .1" mass="1" pos="0 .1 .2"/></body></body></body></worldbody>
</mujoco>"""
PLACE, MASS = np.array([0.3, -0.2, 0.1]), 0.7


def taken(motion: np.ndarray) -> np.ndarray:
    """Return what MuJoCo says that a load takes of every joint of the moving arm, (n, joints)."""
    bare = mujoco.MjSpec.from_string(ARM)
    loaded = mujoco.MjSpec.from_string(ARM)
    load = loaded.body("c").add_body(pos=PLACE)
    load.explicitinertial, load.mass, load.inertia = True, MASS, [1e-9] * 3
    load.ipos = [0.0, 0.0, 0.0]
    torque = []
    for spec in (loaded, bare):
        model = spec.compile()
        data, own = mujoco.MjData(model), np.empty(motion.shape[1:])
        for i in range(motion.shape[1]):
            data.qpos[:], data.qvel[:], data.qacc[:] = motion[:, i]
            mujoco.mj_inverse(model, data)
            own[i] = data.qfrc_inverse
        torque.append(own)
    return torque[0] - torque[1]


@pytest.mark.parametrize(("number", "of"), list(enumerate(WAYS)))
@pytest.mark.parametrize("joint", range(3))
def test_a_load_takes_more_where_a_joint_moves_otherwise(number: int, of: Of, joint: int) -> None:
    """Gravity, and all that hangs from one joint, changes with where another is."""
    motion = np.random.default_rng(0).normal(size=(3, 4, 3))
    ahead, behind = motion.copy(), motion.copy()
    ahead[number, :, joint] += 0.5e-3
    behind[number, :, joint] -= 0.5e-3
    expected = (taken(ahead) - taken(behind)) / 1e-3
    model = mujoco.MjModel.from_xml_string(ARM)
    tangents = Tangents(model, (*motion,), np.arange(4), np.asarray)
    load = MASS * point_mass(PLACE)
    found = tangents.gained(of, joint, {model.body("c").id: load})
    assert found == pytest.approx(expected, abs=1e-4)


def test_a_chain_as_declared_gains_nothing() -> None:
    motion = np.zeros((3, 4, 3))
    model = mujoco.MjModel.from_xml_string(ARM)
    assert not np.any(Tangents(model, (*motion,), np.arange(4), np.asarray).gained("place", 0, {}))
