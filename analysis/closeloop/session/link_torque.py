"""Torque that a link's mass, first moments and inertia take: the regressor of a rigid chain.

The torque of a chain is linear in the inertial parameters of its links (Atkeson, An and Hollerbach
1986). MuJoCo gives position, velocity and acceleration of every link; the rest is Newton and Euler.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

#: Where the mass stands among a link's ten parameters; first moments and inertia about the origin
#: of its frame follow.
MASS = 0
#: Where xx, yy, zz, xy, xz and yz stand in an inertia matrix.
ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


@dataclass(frozen=True, kw_only=True)
class ChainMotion:
    """How the links and joints of a chain move, world frame, SI units.

    `origin`, `spin`, `spin_rate` and `acceleration` (less gravity) of every body have shape
    (n, bodies, 3), `frame` (n, bodies, 3, 3), `axis` and `anchor` of every joint (n, joints, 3).
    """

    model: mujoco.MjModel
    origin: np.ndarray
    frame: np.ndarray
    spin: np.ndarray
    spin_rate: np.ndarray
    acceleration: np.ndarray
    axis: np.ndarray
    anchor: np.ndarray

    def weight(self, joint: int) -> np.ndarray:
        """Return what holds a joint in one m/s2 of gravity along x, y and z, Nm or N, (n, 3)."""
        model, axis = self.model, self.axis[:, joint]
        carried = [b for b in range(1, model.nbody) if joint in carriers(model, b)]
        masses = model.body_mass[carried]
        if model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_HINGE:
            return -axis * float(masses.sum())
        # First moments of all that the joint carries, about a point on its axis.
        places = self.origin + np.einsum("nbij,bj->nbi", self.frame, model.body_ipos)
        levers = places[:, carried] - self.anchor[:, None, joint]
        return -np.cross(axis, np.einsum("b,nbi->ni", masses, levers))

    def link_torque(self, body: int) -> np.ndarray:
        """Return the joint torques for one unit of each of a body's parameters, (n, joints, 10).

        Args:
            body: number in the model; parameters are in its frame, kg, kg m and kg m2.
        """
        model = self.model
        frame, spin, rate = self.frame[:, body], self.spin[:, body], self.spin_rate[:, body]
        count = len(frame)
        force, moment = np.zeros((count, 10, 3)), np.zeros((count, 10, 3))
        force[:, MASS] = self.acceleration[:, body]
        # The columns of `frame` are the link's own directions.
        for number in range(3):
            arm = frame[:, :, number]
            force[:, 1 + number] = np.cross(rate, arm) + np.cross(spin, np.cross(spin, arm))
            moment[:, 1 + number] = np.cross(arm, self.acceleration[:, body])
        for number, (row, column) in enumerate(ENTRIES, start=4):
            unit = np.zeros((3, 3))
            unit[row, column] = unit[column, row] = 1.0
            inertia = frame @ unit @ frame.transpose(0, 2, 1)
            turned = np.einsum("nij,nj->ni", inertia, spin)
            moment[:, number] = np.einsum("nij,nj->ni", inertia, rate) + np.cross(spin, turned)
        torque = np.zeros((count, model.njnt, 10))
        for joint in carriers(model, body):
            axis = self.axis[:, joint]
            needed = force
            if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE:
                lever = self.origin[:, body] - self.anchor[:, joint]
                needed = moment + np.cross(lever[:, None, :], force)
            torque[:, joint] = np.einsum("ni,nki->nk", axis, needed)
        return torque


def chain_motion(
    model: mujoco.MjModel, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
) -> ChainMotion:
    """Return how every link moves where the joints move as given, each (n, joints)."""
    data = mujoco.MjData(model)
    count, bodies, joints = len(position), model.nbody, model.njnt
    origin, frame = np.empty((count, bodies, 3)), np.empty((count, bodies, 9))
    spatial, change = np.empty((count, bodies, 6)), np.empty((count, bodies, 6))
    centre = np.empty((count, bodies, 3))
    axis, anchor = np.empty((count, joints, 3)), np.empty((count, joints, 3))
    for i in range(count):
        data.qpos[:], data.qvel[:], data.qacc[:] = position[i], velocity[i], acceleration[i]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rnePostConstraint(model, data)
        origin[i], frame[i] = data.xpos, data.xmat
        spatial[i], change[i], centre[i] = data.cvel, data.cacc, data.subtree_com
        axis[i], anchor[i] = data.xaxis, data.xanchor
    # MuJoCo's spatial vectors stand at the centre of mass of the whole tree.
    lever = origin - centre[:, model.body_rootid]
    spin, rate = spatial[..., :3], change[..., :3]
    speed = spatial[..., 3:] + np.cross(spin, lever)
    linear = change[..., 3:] + np.cross(rate, lever) + np.cross(spin, speed)
    return ChainMotion(
        model=model,
        origin=origin,
        frame=frame.reshape(count, bodies, 3, 3),
        spin=spin,
        spin_rate=rate,
        acceleration=linear,
        axis=axis,
        anchor=anchor,
    )


def carriers(model: mujoco.MjModel, body: int) -> list[int]:
    """Return the joints between the world and a body, the nearest to it first."""
    found: list[int] = []
    while body > 0:
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        found += reversed(range(first, first + count))
        body = int(model.body_parentid[body])
    return found
