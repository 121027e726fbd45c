"""Inverse dynamics of a chain of hinges for a whole movement at once (recursive Newton-Euler).

`mujoco.mj_inverse` in a loop over the steps took a third of an assessment without contact. The
recursion is Luh, Walker and Paul's of 1980, in world axes, with every quantity of n steps in one
array; a test compares it with MuJoCo.
"""

from dataclasses import dataclass

import mujoco
import numpy as np


@dataclass(frozen=True, kw_only=True)
class RigidChain:
    """Hinges in a row and the rigid bodies that each moves, as they are in the reference pose.

    World axes, m, kg and kg m2; k joints.
    """

    #: Angle of each joint in that pose, rad, shape (k,).
    zero: np.ndarray
    #: A point on each axis and its direction, shapes (k, 3).
    anchor: np.ndarray
    axis: np.ndarray
    #: What moves with a joint and not with the next: mass (k,), centre (k, 3), and inertia about it
    #: (k, 3, 3).
    mass: np.ndarray
    centre: np.ndarray
    inertia: np.ndarray
    #: Shape (3,), m/s2.
    gravity: np.ndarray

    def torque(
        self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray, joint: int
    ) -> np.ndarray:
        """Return what a joint's bodies, and those beyond, need for a motion, Nm, shape (n,).

        Args:
            position: rad, shape (n, k).
            velocity: rad/s, of that shape.
            acceleration: rad/s2, of that shape.
            joint: number of the joint.
        """
        steps = len(position)
        # Axes: row, step, column, so that what is turned is one product of two matrices.
        frame = np.repeat(np.eye(3)[:, None, :], steps, axis=1)
        omega, alpha = np.zeros((3, steps)), np.zeros((3, steps))
        # Falling upwards is gravity.
        linear = np.repeat(-self.gravity[:, None], steps, axis=1)
        place, before = np.zeros((3, steps)), np.zeros(3)
        torque = np.zeros(steps)
        for k in range(len(self.mass)):
            reach = frame @ (self.anchor[k] - before)
            linear = linear + _swing(omega, alpha, reach)
            place, before = place + reach, self.anchor[k]
            axis = frame @ self.axis[k]
            alpha = alpha + axis * acceleration[:, k] + _cross(omega, axis) * velocity[:, k]
            omega = omega + axis * velocity[:, k]
            angle, skew = (position[:, k] - self.zero[k])[:, None], _skew(self.axis[k])
            across = _times(frame, skew)
            frame = frame + np.sin(angle) * across + (1.0 - np.cos(angle)) * _times(across, skew)
            if k == joint:
                own_axis, own_place = axis, place
            if k >= joint:
                centre = frame @ (self.centre[k] - self.anchor[k])
                force = self.mass[k] * (linear + _swing(omega, alpha, centre))
                turned = _times(frame, self.inertia[k])
                moment = _about(turned, frame, alpha) + _cross(omega, _about(turned, frame, omega))
                moment += _cross(place + centre - own_place, force)
                torque += (own_axis * moment).sum(axis=0)
        return torque


def rigid_chain(model: mujoco.MjModel) -> RigidChain:
    """Return the chain of a model whose joints are hinges, each beyond the one before it."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    count = model.njnt
    mass, centre, inertia = np.zeros(count), np.zeros((count, 3)), np.zeros((count, 3, 3))
    # The joint that a body rides on is that of the last body which is not welded to its parent.
    rides = [int(model.body_jntadr[root]) for root in model.body_weldid]
    for body, joint in enumerate(rides):
        if joint >= 0:
            mass[joint] += model.body_mass[body]
            centre[joint] += model.body_mass[body] * data.xipos[body]
    centre /= np.where(mass > 0.0, mass, 1.0)[:, None]
    for body, joint in enumerate(rides):
        if joint >= 0:
            axes, off = data.ximat[body].reshape(3, 3), data.xipos[body] - centre[joint]
            inertia[joint] += axes @ np.diag(model.body_inertia[body]) @ axes.T
            inertia[joint] += model.body_mass[body] * (off @ off * np.eye(3) - np.outer(off, off))
    return RigidChain(
        zero=model.qpos0.copy(),
        anchor=data.xanchor.copy(),
        axis=data.xaxis.copy(),
        mass=mass,
        centre=centre,
        inertia=inertia,
        gravity=model.opt.gravity.copy(),
    )


def _times(frame: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Return frames, shape (3, n, 3), times one matrix (3, 3)."""
    product: np.ndarray = (frame.reshape(-1, 3) @ matrix).reshape(frame.shape)
    return product


def _about(turned: np.ndarray, frame: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Return inertia times a vector, both in world axes; `turned` is frame x inertia."""
    within = (frame * vector[:, :, None]).sum(axis=0)
    product: np.ndarray = (turned * within).sum(axis=2)
    return product


def _swing(omega: np.ndarray, alpha: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """Return the acceleration of a point at the end of `arm` relative to its beginning."""
    swing: np.ndarray = _cross(alpha, arm) + _cross(omega, _cross(omega, arm))
    return swing


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the cross product of arrays of shape (3, n), several times as fast as NumPy's."""
    product: np.ndarray = np.empty_like(b)
    product[0] = a[1] * b[2] - a[2] * b[1]
    product[1] = a[2] * b[0] - a[0] * b[2]
    product[2] = a[0] * b[1] - a[1] * b[0]
    return product


def _skew(axis: np.ndarray) -> np.ndarray:
    x, y, z = axis
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
