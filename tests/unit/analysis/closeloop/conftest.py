"""A rich recording without noise: both joints of the arm move at rhythms of their own."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from analysis.closeloop.session.contents import Session, Trial
from analysis.closeloop.session.device import Device
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.signals import Sampling
from tests.testbed.effects import Arm
from tests.testbed.sessions import mjcf


@pytest.fixture(scope="package")
def recording() -> Recording:
    """Both joints of the arm in rich motion, 5 s at 200 Hz."""
    t = np.arange(1000) / 200.0
    w = 2 * np.pi * np.array([0.7, 0.4])
    q = np.array([-0.5, 1.0]) + 0.4 * np.sin(t[:, None] * w)
    v = 0.4 * w * np.cos(t[:, None] * w)
    a = -0.4 * w**2 * np.sin(t[:, None] * w)
    trial = Trial(file="a.csv", label="a", group="a", role="fit")
    return Recording(
        device=Device(mujoco.MjSpec.from_string(mjcf(Arm())), ()),
        session=Session(folder=Path(), model="device.xml", trials=(trial,)),
        sampling=Sampling(recorded=200.0, working=200.0, cutoff=20.0),
        slices=[slice(0, len(t))],
        trial=np.zeros(len(t), dtype=int),
        time=t,
        position=q,
        velocity=v,
        acceleration=a,
        effort=np.zeros_like(q),
        extra=np.empty((len(t), 0)),
        extra_names=(),
        joints=(0, 1),
        fit_trials=(0,),
    )
