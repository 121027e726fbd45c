"""Torque that a link's mass, first moments and inertia take: the regressor of a rigid chain.

The torque of a chain is linear in the inertial parameters of its links (Atkeson, An and Hollerbach
1986). Newton and Euler, of all samples at once: MuJoCo does one at a time, which takes ten times as
long.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

#: Where the mass stands among a link's ten parameters; first moments and inertia about the origin
#: of its frame follow.
MASS = 0
#: Where xx, yy, zz, xy, xz and yz stand in an inertia matrix.
ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))

#: How far a joint is moved, rad or m, by how much it is quicker, rad/s or m/s, or more accelerated.
#: Torques hold squares of speeds, of which both sides of one tell the slope exactly.
WAYS = {"place": 1e-4, "speed": 1.0, "acceleration": 1.0}
Of = Literal["place", "speed", "acceleration"]


@dataclass(frozen=True, kw_only=True)
class ChainMotion:
    """How the links and joints of a chain move, world frame, SI units.

    Samples come last, so that every operation runs along memory: `origin`, `spin`, `spin_rate` and
    `acceleration` (less gravity) of every body have shape (bodies, 3, n), `frame` (bodies, 3, 3,
    n), `axis` and `anchor` of every joint (joints, 3, n).
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
        model, axis = self.model, self.axis[joint]
        carried = [b for b in range(1, model.nbody) if joint in carriers(model, b)]
        masses = model.body_mass[carried]
        if model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_HINGE:
            return np.asarray(-axis.T * float(masses.sum()))
        # First moments of all that the joint carries, about a point on its axis.
        places = self.origin + np.einsum("bijn,bj->bin", self.frame, model.body_ipos)
        levers = places[carried] - self.anchor[joint]
        return -_cross(axis, np.einsum("b,bin->in", masses, levers)).T

    def link_torque(self, body: int) -> np.ndarray:
        """Return the joint torques for one unit of each of a body's parameters, (n, joints, 10).

        Args:
            body: number in the model; parameters are in its frame, kg, kg m and kg m2.
        """
        return np.stack([self.torque(body, unit) for unit in np.eye(10)], axis=-1)

    def torque(self, body: int, parameters: np.ndarray) -> np.ndarray:
        """Return the joint torques that inertial parameters take, (n, joints).

        Args:
            body: number in the model.
            parameters: in its frame, kg, kg m and kg m2, (10,), or of every sample, (n, 10).
        """
        model, frame = self.model, self.frame[body]
        spin, rate, acceleration = self.spin[body], self.spin_rate[body], self.acceleration[body]
        each = np.atleast_2d(parameters).T
        first = np.einsum("ijn,jn->in", frame, np.broadcast_to(each[1:4], spin.shape))
        force = each[MASS] * acceleration + _carried(spin, rate, first)
        # In the link's own frame its inertia stays what it is.
        own_spin, own_rate = (np.einsum("jin,jn->in", frame, x) for x in (spin, rate))
        own = _turned(each[4:], own_rate) + _cross(own_spin, _turned(each[4:], own_spin))
        moment = _cross(first, acceleration) + np.einsum("ijn,jn->in", frame, own)
        torque = np.zeros((frame.shape[-1], model.njnt))
        for joint in carriers(model, body):
            needed = force
            if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE:
                needed = moment + _cross(self.origin[body] - self.anchor[joint], force)
            torque[:, joint] = np.einsum("in,in->n", self.axis[joint], needed)
        return torque


def chain_motion(
    model: mujoco.MjModel, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
) -> ChainMotion:
    """Return how every link moves where the joints move as given, each (n, joints).

    From one body to the next (Luh, Walker and Paul 1980).
    """
    count, bodies, joints = len(position), model.nbody, model.njnt
    origin, spin, spin_rate, linear = np.zeros((4, bodies, 3, count))
    frame = np.zeros((bodies, 3, 3, count))
    axis, anchor = np.empty((2, joints, 3, count))
    frame[0], linear[0] = np.eye(3)[:, :, None], -model.opt.gravity[:, None]
    placed = Rotation.from_quat(model.body_quat, scalar_first=True).as_matrix()
    for body in range(1, bodies):
        parent = int(model.body_parentid[body])
        turn, own, rate = frame[parent], spin[parent], spin_rate[parent]
        arm = _at(turn, model.body_pos[body])
        place = origin[parent] + arm
        speeding = linear[parent] + _carried(own, rate, arm)
        turn = np.einsum("ijn,jk->ikn", turn, placed[body])
        first = int(model.body_jntadr[body])
        for joint in range(first, first + int(model.body_jntnum[body])):
            along = axis[joint] = _at(turn, model.jnt_axis[joint])
            anchor[joint] = place + _at(turn, model.jnt_pos[joint])
            way = position[:, joint] - model.qpos0[joint]
            moving, gained = along * velocity[:, joint], along * acceleration[:, joint]
            if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE:
                speeding = speeding + _carried(own, rate, anchor[joint] - place)
                rate = rate + gained + _cross(own, moving)
                own = own + moving
                own_turn = Rotation.from_rotvec(way[:, None] * model.jnt_axis[joint]).as_matrix()
                turn = np.einsum("ijn,njk->ikn", turn, own_turn)
                arm = -_at(turn, model.jnt_pos[joint])
                place = anchor[joint] + arm
                speeding = speeding + _carried(own, rate, arm)
            else:
                arm = along * way
                place = place + arm
                speeding = speeding + _carried(own, rate, arm) + gained
                speeding = speeding + 2.0 * _cross(own, moving)
        origin[body], frame[body], linear[body] = place, turn, speeding
        spin[body], spin_rate[body] = own, rate
    return ChainMotion(
        model=model,
        origin=origin,
        frame=frame,
        spin=spin,
        spin_rate=spin_rate,
        acceleration=linear,
        axis=axis,
        anchor=anchor,
    )


class Tangents:
    """A chain that moves, and what it would need if a joint moved otherwise.

    Args:
        model: the chain.
        motion: position, velocity and acceleration of its joints, (n, joints) each.
        samples: which of these are computed, (m,).
        between: makes of what is known at those what is at all, (m, joints) to (n, joints).
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        motion: tuple[np.ndarray, np.ndarray, np.ndarray],
        samples: np.ndarray,
        between: Callable[[np.ndarray], np.ndarray],
    ) -> None:
        self._model, self._samples, self._between = model, samples, between
        self._motion = [every[samples] for every in motion]
        self._moved: dict[tuple[Of, int], tuple[ChainMotion, ChainMotion]] = {}
        self._last: dict[tuple[Of, int], tuple[Mapping[int, np.ndarray], np.ndarray]] = {}

    def whole(
        self,
        of: Of,
        joint: int,
        changes: Mapping[int, np.ndarray],
        declared: Callable[[], np.ndarray],
    ) -> np.ndarray:
        """Return what one unit more adds to every torque with bodies that differ, (n, joints).

        Args: as of `gained`, and what it adds with the bodies as they are declared, (n, joints).
        """
        if not changes:
            return declared()
        # Many forms of an effect are tried beside the same bodies.
        asked, answer = self._last.get((of, joint), (None, np.empty(0)))
        if asked is not changes:
            answer = declared() + self.gained(of, joint, changes)
            self._last[of, joint] = changes, answer
        return answer

    def gained(self, of: Of, joint: int, changes: Mapping[int, np.ndarray]) -> np.ndarray | float:
        """Return what bodies that differ add to every torque, for one unit more, (n, joints).

        Args:
            of: what of the joint is more.
            joint: which.
            changes: inertial parameters by the number of the body, (10,) or (n, 10).
        """
        if not changes:
            return 0.0
        ahead, behind = self._both(of, joint)
        gained = np.zeros_like(self._motion[0])
        for body, change in changes.items():
            own = change if change.ndim == 1 else change[self._samples]
            gained += (ahead.torque(body, own) - behind.torque(body, own)) / WAYS[of]
        return self._between(gained)

    def _both(self, of: Of, joint: int) -> tuple[ChainMotion, ChainMotion]:
        """Return how the chain moves half a unit further, and half a unit less."""
        if (of, joint) not in self._moved:
            number = list(WAYS).index(of)
            way = np.zeros_like(self._motion[number])
            way[:, joint] = 0.5 * WAYS[of]
            ahead, behind = (
                chain_motion(
                    self._model,
                    *(x + sign * way if x is self._motion[number] else x for x in self._motion),
                )
                for sign in (1.0, -1.0)
            )
            self._moved[of, joint] = ahead, behind
        return self._moved[of, joint]


def _at(frame: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Return where a place of a frame, (3, 3, n), lies along the world's axes, (3, n)."""
    return np.asarray(np.einsum("ijn,j->in", frame, place))


def _turned(entries: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Return an inertia matrix, its six `ENTRIES`, times a vector, (3, n)."""
    xx, yy, zz, xy, xz, yz = entries
    x, y, z = vector
    return np.stack([xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z])


def _carried(spin: np.ndarray, rate: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """Return how much more what stands `arm` off is accelerated by turning with it, (3, n)."""
    return np.asarray(_cross(rate, arm) + _cross(spin, _cross(spin, arm)))


def _cross(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return cross products, (3, n): NumPy's own take three times as long."""
    (x, y, z), (u, v, w) = one, other
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u])


def carriers(model: mujoco.MjModel, body: int) -> list[int]:
    """Return the joints between the world and a body, the nearest to it first."""
    found: list[int] = []
    while body > 0:
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        found += reversed(range(first, first + count))
        body = int(model.body_parentid[body])
    return found
