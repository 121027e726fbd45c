"""The trial that tells an effect from what looks alike, at the joint that it is about."""

import mujoco
import numpy as np

from analysis.closeloop.session.recording import Recording
from sim.effects.effect import Effect

#: About an axis this near to upright a mass gives less than this share of its weight.
LITTLE_WEIGHT = 0.1
#: What effects are told apart by where a mass hangs in vain: a known pull instead of a weight.
HELD = "hold it still against two known weights that pull horizontally over a pulley"
MOVED = "repeat one movement against two known weights that pull horizontally over a pulley"
#: A mass tells inertia from a gain; only weight tells a load from a motor's inertia.
TILTED = "repeat one movement with a known mass attached, and once with the axis tilted"
#: Effects whose own trial needs gravity at their joint.
WEIGHED = {
    "torque_gain": HELD,
    "payload": TILTED,
    "added_inertia": TILTED,
    "load_dependent_friction": MOVED,
    "stribeck_load_friction": MOVED,
    "directional_load_friction": MOVED,
    "quadratic_load_friction": MOVED,
}


def separating_trial(recording: Recording, joint: int, effect: Effect) -> str:
    """Return the trial that tells an effect of a joint from what looks alike."""
    instead = WEIGHED.get(effect.name)
    return instead if instead and weightless(recording, joint) else effect.separating_trial


def weightless(recording: Recording, joint: int) -> bool:
    """Whether gravity has nearly no torque or force at a joint where the recording was made."""
    model = recording.device.model
    data = mujoco.MjData(model)
    data.qpos[:] = np.median(recording.position, axis=0)
    mujoco.mj_kinematics(model, data)
    gravity, axis = np.array(model.opt.gravity), data.xaxis[joint]
    along = float(gravity @ axis)
    pulls = gravity - along * axis if recording.is_hinge(joint) else along
    whole = float(np.linalg.norm(gravity))
    return float(np.linalg.norm(pulls)) <= LITTLE_WEIGHT * whole
