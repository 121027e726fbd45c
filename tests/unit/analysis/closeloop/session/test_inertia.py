"""What a joint's acceleration takes where links are not as declared."""

import numpy as np
import pytest

from analysis.closeloop.session.contents import AddedMass
from analysis.closeloop.session.recording import Recording
from sim.effects.rigid import point_mass


@pytest.mark.parametrize("each", [False, True])
def test_a_load_that_was_found_adds_what_mujoco_says(recording: Recording, each: bool) -> None:
    joint, place = recording.joints[-1], (0.1, -0.05, 0.2)
    device, still = recording.device, np.zeros_like(recording.position)
    pushed = still.copy()
    pushed[:, joint] = 1.0
    body = recording.body(joint)
    load = AddedMass(body=device.model.body(body).name, mass=1.5, position=place)
    loaded, bare = (
        device.inverse_dynamics(recording.position, still, pushed, masses=masses)
        - device.inverse_dynamics(recording.position, still, still, masses=masses)
        for masses in ((load,), ())
    )
    change = 1.5 * point_mass(np.array(place))
    count = len(recording.time)
    # Only some trials may carry it.
    carried = np.arange(count)[:, None] >= (count // 2 if each else 0)
    found = recording.inertia(joint, {body: change * carried if each else change})
    added = found - recording.inertia(joint)
    away = slice(None) if not each else np.r_[0 : count // 2 - 40, count // 2 + 40 : count]
    expected = (loaded - bare) * carried
    np.testing.assert_allclose(added[away], expected[away], atol=1e-4 * np.abs(expected).max())
