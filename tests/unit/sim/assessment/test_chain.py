"""The vectorised inverse dynamics is MuJoCo's."""

import mujoco
import numpy as np
import pytest

from sim.assessment.chain import rigid_chain
from sim.assessment.nominal import NominalModel, nominal_model

CHAIN = """
<mujoco>
  <option gravity="0.3 -0.2 -9.81"><flag constraint="disable"/></option>
  <worldbody>
    <body pos="0.1 0.2 0.3" euler="10 20 30">
      <joint name="a" axis="1 2 3" pos="0.01 0.02 -0.03" ref="15" armature="0.2" {spring}/>
      <geom type="box" size="0.1 0.2 0.05" pos="0.1 0 0.1" euler="5 6 7" mass="2"/>
      <body pos="0 0.1 0" euler="40 0 10">
        <geom type="capsule" size="0.03 0.2" pos="0.05 0.1 0" mass="0.7"/>
        <body pos="0.3 0 0.1" euler="0 70 0">
          <joint name="b" axis="0 1 0.5" damping="1.5"/>
          <geom type="box" size="0.02 0.1 0.2" mass="1.1"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def engine(model: mujoco.MjModel, motion: np.ndarray, joint: int) -> np.ndarray:
    data, torque = mujoco.MjData(model), np.empty(motion.shape[1])
    for i, (data.qpos, data.qvel, data.qacc) in enumerate(np.moveaxis(motion, 0, 1)):
        mujoco.mj_inverse(model, data)
        torque[i] = data.qfrc_inverse[joint]
    return torque


@pytest.mark.parametrize("spring", ["", 'stiffness="7"'])
def test_any_chain_of_hinges_needs_the_torque_that_mujoco_finds(spring: str) -> None:
    model = mujoco.MjModel.from_xml_string(CHAIN.format(spring=spring))
    motion = np.random.default_rng(1).normal(size=(3, 20, 2))
    for joint in (0, 1):
        torque = NominalModel(model=model).inverse_dynamics(*motion, joint)
        assert torque == pytest.approx(engine(model, motion, joint), abs=1e-12)


def test_the_robots_own_chain_is_computed_by_recursion_at_every_joint() -> None:
    model = nominal_model().model
    motion = np.random.default_rng(2).normal(size=(3, 10, 4))
    for joint in range(4):
        torque = rigid_chain(model).torques(*motion)[:, joint]
        torque += model.dof_armature[joint] * motion[2, :, joint]
        torque += model.dof_damping[joint] * motion[1, :, joint]
        assert torque == pytest.approx(engine(model, motion, joint), abs=1e-12)
