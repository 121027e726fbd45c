"""Inverse dynamics of a chain of hinges for a whole movement at once (recursive Newton-Euler).

`mujoco.mj_inverse` in a loop over the steps took a third of an assessment without contact. The
recursion is Luh, Walker and Paul's of 1980, in axes that turn with each body, with every quantity
of n steps in one array; a test compares it with MuJoCo.
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

    def torques(
        self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
    ) -> np.ndarray:
        """Return what each joint's bodies, and those beyond, need for a motion, Nm, shape (n, k).

        Args:
            position: rad, shape (n, k).
            velocity: rad/s, of that shape.
            acceleration: rad/s2, of that shape.
        """
        steps = len(position)
        omega = alpha = np.zeros((3, steps))
        # Falling upwards is gravity.
        linear = np.repeat(-self.gravity[:, None], steps, axis=1)
        angle = (position - self.zero).T
        sine, cosine = np.sin(angle), np.cos(angle)
        reach = np.diff(self.anchor, axis=0, prepend=0.0)
        motions = []
        for k, axis in enumerate(self.axis):
            linear = linear + _swing(omega, alpha, reach[k])
            speed = axis[:, None] * velocity[:, k]
            alpha = alpha + axis[:, None] * acceleration[:, k] + _cross(omega, speed)
            back = (axis, -sine[k], cosine[k])
            omega, alpha, linear = _turned(*back, omega + speed, alpha, linear)
            motions.append((omega, alpha, linear))
        force = moment = np.zeros((3, steps))
        torques = np.empty_like(position)
        for k in range(len(self.mass) - 1, -1, -1):
            omega, alpha, linear = motions[k]
            centre, inertia = self.centre[k] - self.anchor[k], self.inertia[k]
            own = self.mass[k] * (linear + _swing(omega, alpha, centre))
            moment = moment + _skew(centre) @ own + inertia @ alpha
            moment, force = moment + _cross(omega, inertia @ omega), force + own
            torques[:, k] = self.axis[k] @ moment
            force, moment = _turned(self.axis[k], sine[k], cosine[k], force, moment)
            moment = moment + _skew(reach[k]) @ force
        return torques


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


def _turned(
    axis: np.ndarray, sine: np.ndarray, cosine: np.ndarray, *vectors: np.ndarray
) -> np.ndarray:
    """Return vectors of n steps turned about an axis, shape (vectors, 3, n) (Rodrigues)."""
    skew, straight = _skew(axis), np.stack(vectors)
    across = skew @ straight
    turned: np.ndarray = straight + sine * across + (1.0 - cosine) * (skew @ across)
    return turned


def _swing(omega: np.ndarray, alpha: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """Return the acceleration of a point at the end of `arm`, (3,), relative to its beginning."""
    swing: np.ndarray = (
        (arm @ omega) * omega - (omega * omega).sum(axis=0) * arm[:, None] - _skew(arm) @ alpha
    )
    return swing


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the cross product of arrays of shape (3, n), several times as fast as NumPy's."""
    product: np.ndarray = np.empty_like(b)
    product[0] = a[1] * b[2] - a[2] * b[1]
    product[1] = a[2] * b[0] - a[0] * b[2]
    product[2] = a[0] * b[1] - a[1] * b[0]
    return product


def _skew(vector: np.ndarray) -> np.ndarray:
    """Return the matrix that multiplies another vector as the cross product with it does."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
