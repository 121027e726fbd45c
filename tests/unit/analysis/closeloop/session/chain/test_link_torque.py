import mujoco
import numpy as np
import pytest

from analysis.closeloop.session.chain.link_torque import (
    WAYS,
    Of,
    Tangents,
    carriers,
    chain_motion,
)
from sim.effects.rigid import point_mass, point_mass_slopes

ARM = """<mujoco><worldbody><body pos="0 0 1"><joint name="a" axis="0 0 1"/>
<geom size=".1" mass="3" pos=".1 0 .1"/><body name="b" pos=".3 0 0" euler="30 0 20">
<joint name="b" axis="0 1 0" pos="0 0 .1"/><geom type="box" size=".1 .2 .3" mass="2" pos=".2 .1 0"/>
<body name="c" pos="0 .2 .4"><joint name="c" type="slide" axis="1 0 1"/>
<geom type="box" size=".05 .02 .1" mass="1" pos="0 .1 .2" euler="10 40 0"/>
<body name="tool" pos=".1 0 0" euler="0 90 0"/></body></body></body></worldbody></mujoco>"""


@pytest.fixture(scope="module")
def motion() -> np.ndarray:
    return np.random.default_rng(0).normal(size=(3, 5, 3))


def inverse(spec: mujoco.MjSpec, motion: np.ndarray) -> np.ndarray:
    model = spec.compile()
    data, out = mujoco.MjData(model), np.empty(motion.shape[1:])
    for i in range(motion.shape[1]):
        data.qpos[:], data.qvel[:], data.qacc[:] = motion[:, i]
        mujoco.mj_inverse(model, data)
        out[i] = data.qfrc_inverse
    return out


PLACE = np.array([0.3, -0.2, 0.1])


def taken(name: str, motion: np.ndarray) -> np.ndarray:
    """Return what MuJoCo says that a kilogram at `PLACE` takes of every joint, (n, joints)."""
    spec = mujoco.MjSpec.from_string(ARM)
    bare = inverse(spec, motion)
    load = spec.body(name).add_body(pos=PLACE)
    load.explicitinertial, load.mass, load.inertia = True, 1.0, [1e-9] * 3
    load.ipos = [0.0, 0.0, 0.0]
    return inverse(spec, motion) - bare


@pytest.mark.parametrize("name", ["b", "c", "tool"])
def test_a_load_takes_what_mujoco_says(name: str, motion: np.ndarray) -> None:
    model = mujoco.MjSpec.from_string(ARM).compile()
    torque = chain_motion(model, *motion).link_torque(model.body(name).id)
    assert torque @ point_mass(PLACE) == pytest.approx(taken(name, motion), abs=1e-6)


@pytest.mark.parametrize(("number", "of"), list(enumerate(WAYS)))
@pytest.mark.parametrize("joint", range(3))
def test_a_load_takes_more_where_a_joint_moves_otherwise(
    number: int, of: Of, joint: int, motion: np.ndarray
) -> None:
    """Gravity, and all that hangs from one joint, changes with where another is."""
    ahead, behind = motion.copy(), motion.copy()
    ahead[number, :, joint] += 0.5e-3
    behind[number, :, joint] -= 0.5e-3
    expected = (taken("c", ahead) - taken("c", behind)) / 1e-3
    model = mujoco.MjModel.from_xml_string(ARM)
    tangents = Tangents(model, (*motion,), np.arange(motion.shape[1]), np.asarray)
    found = tangents.gained(of, joint, {model.body("c").id: point_mass(PLACE)})
    assert found == pytest.approx(expected, abs=1e-4)


def test_a_chain_as_declared_gains_nothing(motion: np.ndarray) -> None:
    model = mujoco.MjModel.from_xml_string(ARM)
    tangents = Tangents(model, (*motion,), np.arange(motion.shape[1]), np.asarray)
    assert not np.any(tangents.gained("place", 0, {}))


def test_what_holds_a_joint_in_a_gravity_is_what_mujoco_says(motion: np.ndarray) -> None:
    gravity = np.array([1.0, -2.0, 3.0])
    still = np.stack([motion[0], *np.zeros_like(motion[1:])])
    without, within = (mujoco.MjSpec.from_string(ARM) for _ in range(2))
    without.option.gravity, within.option.gravity = np.zeros(3), gravity
    needed = inverse(within, still) - inverse(without, still)
    moving = chain_motion(mujoco.MjModel.from_xml_string(ARM), *motion)
    held = np.stack([moving.weight(joint) @ gravity for joint in range(3)], axis=1)
    assert held == pytest.approx(needed, abs=1e-9)


def test_links_take_together_what_the_chain_takes(motion: np.ndarray) -> None:
    model = mujoco.MjModel.from_xml_string(ARM)
    moving = chain_motion(model, *motion)
    total = np.zeros((5, 3))
    for body in range(1, model.nbody):
        frame = np.empty(9)
        mujoco.mju_quat2Mat(frame, model.body_iquat[body])
        axes = frame.reshape(3, 3)
        inertia = axes @ np.diag(model.body_inertia[body]) @ axes.T
        parameters = model.body_mass[body] * point_mass(model.body_ipos[body])
        parameters[4:] += inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        total += moving.link_torque(body) @ parameters
    spec = mujoco.MjSpec.from_string(ARM)
    assert total == pytest.approx(inverse(spec, motion), abs=1e-9)


def test_the_slopes_of_a_place_are_those_of_its_parameters() -> None:
    place, step = np.array([0.3, -0.2, 0.1]), 1e-6
    numeric = [
        (point_mass(place + step * e) - point_mass(place - step * e)) / (2 * step)
        for e in np.eye(3)
    ]
    assert point_mass_slopes(place) == pytest.approx(np.array(numeric).T, abs=1e-8)


def test_a_tool_hangs_on_every_joint_before_it() -> None:
    model = mujoco.MjModel.from_xml_string(ARM)
    assert carriers(model, model.body("tool").id) == [2, 1, 0]


def test_what_bodies_add_is_asked_anew_of_other_bodies_and_not_of_the_same(
    motion: np.ndarray,
) -> None:
    """An answer is kept for the mapping that was asked with, and no other that looks like it."""
    model = mujoco.MjModel.from_xml_string(ARM)
    tangents = Tangents(model, (*motion,), np.arange(motion.shape[1]), np.asarray)
    asked = []

    def declared() -> np.ndarray:
        asked.append(1)
        return np.ones(motion.shape[1:])

    one, other = ({model.body("c").id: size * point_mass(PLACE)} for size in (1.0, 2.0))
    first = tangents.whole("place", 0, one, declared)
    assert tangents.whole("place", 0, one, declared) is first and len(asked) == 1
    assert np.allclose(first, 1.0 + tangents.gained("place", 0, one))
    assert np.allclose(
        tangents.whole("place", 0, other, declared), 1.0 + tangents.gained("place", 0, other)
    )
    assert np.all(tangents.whole("place", 0, {}, declared) == 1.0)
