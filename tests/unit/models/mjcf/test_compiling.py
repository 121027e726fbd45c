"""Models as MuJoCo compiles and writes them."""

import mujoco
import numpy as np
import pytest

from models.mjcf.compiling import compiled, written

FLAT = """<mujoco><worldbody><body name="sheet"><joint/>
<inertial pos="0 0 0" mass="1" diaginertia="{0!r} {1!r} {2!r}"/></body></worldbody></mujoco>"""


def sheet(one: float, other: float, both: float) -> mujoco.MjSpec:
    spec = mujoco.MjSpec.from_string(FLAT.format(one, other, both))
    compiled(spec)
    return spec


def test_a_body_as_flat_as_a_sheet_is_written_so_that_it_can_be_read_again() -> None:
    """Six digits left a third of them none: a stranger's arm ended in a traceback."""
    for one, other in np.random.default_rng(3).uniform(1e-6, 1.0, (40, 2)).tolist():
        again = compiled(mujoco.MjSpec.from_string(written(sheet(one, other, one + other))))
        wanted = sorted([one, other, one + other])
        assert sorted(again.body("sheet").inertia) == pytest.approx(wanted, rel=2e-5)


def test_what_is_not_flat_is_written_as_mujoco_does() -> None:
    spec = sheet(0.123456789, 0.2, 0.25)
    assert written(spec) == spec.to_xml()
