"""A robot of two joints that rub, in motion of three frequencies each, without a limb."""

from dataclasses import replace

import numpy as np

from analysis.closeloop.session.recording import Recording
from tests.testbed.sessions.moved import moved
from tests.testbed.sessions.rich import rich_recording

#: Nm and Nm s/rad, of both joints; the model declares neither.
COULOMB, VISCOUS = 0.8, 0.3


def with_efforts(robot: Recording, efforts: np.ndarray) -> Recording:
    """Return the recording with other efforts, (n, joints), and no limb."""
    session = replace(robot.session, limb_joints=())
    robot = replace(robot, session=session, joints=(0, 1), cache={})
    return replace(robot, effort=robot.filtered(efforts), cache={})


def rubbing_robot() -> Recording:
    """Return 10 s of it, with noise on the efforts."""
    t = np.arange(2000) / 200.0
    waves = np.sin(2 * np.pi * t[:, None, None] * np.array([[0.2, 0.5, 1.1], [0.3, 0.7, 1.3]]))
    rich = moved(rich_recording(10), waves @ [0.9, 0.4, 0.1] + [-0.5, 1.0], 200.0)
    rubbing = COULOMB * np.tanh(rich.velocity / 0.01) + VISCOUS * rich.velocity
    noise = 0.05 * np.random.default_rng(6).standard_normal(rich.position.shape)
    return with_efforts(rich, rich.inverse + rubbing + noise)
