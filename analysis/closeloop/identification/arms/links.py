"""Inertial parameters of all links at once, such as a body can have them.

The torque of a chain is linear in them, but most directions of that space are hardly excited, and
least squares then gives links of negative mass. The pseudo-inertia of every real body is positive
definite (Wensing, Kim and Slotine 2018), and its distance from the declared one as a Bregman
divergence of the log determinant is convex and depends on no frame (Lee, Wensing and Park 2020,
Geometric robot dynamic identification: a convex programming approach). So the fit is

    1/2 |A z - b|^2 + strength * sum over links of tr(P0^-1 P) - log det P,

one convex problem that Newton's method solves from the declared links.
"""

from collections.abc import Collection
from dataclasses import dataclass

import mujoco
import numpy as np

from analysis.closeloop.identification.balance.model import Model
from analysis.closeloop.session.chain.link_torque import ENTRIES, carriers
from analysis.closeloop.session.recording import Recording
from sim.effects.rigid import point_mass

PARAMETERS = 10
#: A link lighter than this share of the chain is a frame without mass.
LEAST_MASS = 1e-4
#: Radius of the ball whose inertia a thin link gets besides its own, m: a rod is no body else.
THIN = 0.01
STEPS = 60


def _pseudo_basis() -> np.ndarray:
    """Return the pseudo-inertia of one unit of each parameter, (10, 4, 4)."""
    basis = np.zeros((PARAMETERS, 4, 4))
    basis[0, 3, 3] = 1.0
    for number in range(3):
        basis[1 + number, number, 3] = basis[1 + number, 3, number] = 1.0
    for number, (row, column) in enumerate(ENTRIES, start=4):
        unit = np.zeros((3, 3))
        unit[row, column] = unit[column, row] = 1.0
        basis[number, :3, :3] = 0.5 * np.trace(unit) * np.eye(3) - unit
    return basis


BASIS = _pseudo_basis()


@dataclass(frozen=True, kw_only=True)
class Links:
    """Links that carry mass and that an analysed joint moves."""

    #: Numbers of the bodies, and their names.
    bodies: tuple[int, ...]
    names: tuple[str, ...]
    #: Declared parameters in each body's frame, (links, 10).
    declared: np.ndarray

    @property
    def pseudo(self) -> np.ndarray:
        """Declared pseudo-inertias, (links, 4, 4)."""
        return np.asarray(np.einsum("bk,kij->bij", self.declared, BASIS))

    def only(self, bodies: Collection[int]) -> "Links":
        """Return some of the links."""
        kept = [number for number, body in enumerate(self.bodies) if body in bodies]
        return Links(
            bodies=tuple(self.bodies[number] for number in kept),
            names=tuple(self.names[number] for number in kept),
            declared=self.declared[kept],
        )


def links_of(recording: Recording) -> Links:
    """Return the links whose parameters the analysed joints may show."""
    model = recording.device.model
    total = float(model.body_mass.sum())
    bodies, declared = [], []
    for body in range(1, model.nbody):
        held_by = set(carriers(model, body))
        if model.body_mass[body] <= LEAST_MASS * total or not held_by.intersection(
            recording.joints
        ):
            continue
        bodies.append(body)
        declared.append(inertial_parameters(model, body))
    return Links(
        bodies=tuple(bodies),
        names=tuple(model.body(body).name for body in bodies),
        declared=np.array(declared).reshape(-1, PARAMETERS),
    )


def freed_links(model: Model, links: Links) -> Links:
    """Return the links that a model has other than declared; all if it has none."""
    return links if model.given is None else links.only(model.given.changes)


def last_links(recording: Recording) -> dict[int, str]:
    """Return number and name of the links that carry no other: what a hand holds hangs there."""
    model, links = recording.device.model, links_of(recording)
    carry = set()
    for body in links.bodies:
        parent = int(model.body_parentid[body])
        while parent > 0:
            carry.add(parent)
            parent = int(model.body_parentid[parent])
    own = zip(links.bodies, links.names, strict=True)
    return {body: name for body, name in own if body not in carry}


def inertial_parameters(model: mujoco.MjModel, body: int) -> np.ndarray:
    """Return mass, first moments and inertia about the frame's origin of a body, (10,)."""
    frame = np.empty(9)
    mujoco.mju_quat2Mat(frame, model.body_iquat[body])
    axes = frame.reshape(3, 3)
    ball = 0.4 * model.body_mass[body] * THIN**2
    inertia = axes @ np.diag(model.body_inertia[body] + ball) @ axes.T
    found = model.body_mass[body] * point_mass(model.body_ipos[body])
    found[4:] += [inertia[entry] for entry in ENTRIES]
    return np.asarray(found)


def fit_links(
    hessian: np.ndarray,
    moments: np.ndarray,
    pseudo: np.ndarray,
    strength: float,
    lower: np.ndarray,
) -> np.ndarray:
    """Return the coefficients of free columns and the changes of every link's parameters.

    Args:
        hessian: A'A of the free columns, then of ten columns a link, (p + 10 links, ...).
        moments: A'b.
        pseudo: declared pseudo-inertias, (links, 4, 4).
        strength: of the divergence from them, in the units of the squares.
        lower: bounds of the free columns, (p,); one that would leave its own is held there.
    """
    size = len(lower)
    free = np.arange(size)
    out = np.zeros(len(moments))
    while True:
        index = np.concatenate([free, np.arange(size, len(moments))]).astype(int)
        # What is held stands in `out` already.
        beside = (moments - hessian @ out)[index]
        found = _newton(hessian[np.ix_(index, index)], beside, pseudo, strength, len(free))
        broken = found[: len(free)] < lower[free]
        if not broken.any():
            out[index] = found
            return out
        out[free[broken]] = lower[free[broken]]
        free = free[~broken]


def _newton(
    hessian: np.ndarray, moments: np.ndarray, pseudo: np.ndarray, strength: float, size: int
) -> np.ndarray:
    """Minimise without bounds: `size` free columns, then the links.

    Efforts that ask for less than no inertia draw the links to where rounding leaves no step: what
    is found by then is sound, and stays.
    """
    count = len(pseudo)
    pull = np.einsum("bij,kji->bk", np.linalg.inv(pseudo), BASIS).ravel()
    at = np.zeros(len(moments))
    scale = np.sqrt(np.maximum(hessian.diagonal(), 1e-300))
    ridge = 1e-12 * scale**2
    value = _objective(at, hessian, moments, pseudo, pull, strength, size)
    for _ in range(STEPS):
        slope = hessian @ at - moments
        every = hessian + np.diag(ridge)
        try:
            inverse = np.linalg.inv(_moved(pseudo, at[size:]))
            slope[size:] += strength * (pull - np.einsum("bij,kji->bk", inverse, BASIS).ravel())
            curve = curvature(inverse)
            for number in range(count):
                own = slice(size + PARAMETERS * number, size + PARAMETERS * (number + 1))
                every[own, own] += strength * curve[number]
            step = -np.linalg.solve(every, slope)
        except np.linalg.LinAlgError:
            break
        decrement = -float(slope @ step)
        if decrement < 1e-9 * (1.0 + abs(value)):
            break
        length = 1.0
        while length > 1e-10:
            tried = at + length * step
            new = _objective(tried, hessian, moments, pseudo, pull, strength, size)
            if new <= value - 1e-4 * length * decrement:
                break
            length *= 0.5
        if not np.isfinite(new):
            break
        at, value = at + length * step, new
    return at


def curvature(inverse: np.ndarray) -> np.ndarray:
    """Return how the divergence curves, (links, 10, 10), at the inverses of pseudo-inertias."""
    turned = np.einsum("bij,kjl->bkil", inverse, BASIS)
    return np.asarray(np.einsum("bkil,bmli->bkm", turned, turned))


def _moved(pseudo: np.ndarray, change: np.ndarray) -> np.ndarray:
    return np.asarray(pseudo + np.einsum("bk,kij->bij", change.reshape(-1, PARAMETERS), BASIS))


def _objective(
    at: np.ndarray,
    hessian: np.ndarray,
    moments: np.ndarray,
    pseudo: np.ndarray,
    pull: np.ndarray,
    strength: float,
    size: int,
) -> float:
    values = np.linalg.eigvalsh(_moved(pseudo, at[size:]))
    if values.min() <= 0.0:
        return np.inf
    fit = 0.5 * float(at @ hessian @ at) - float(moments @ at)
    return fit + strength * (float(pull @ at[size:]) - float(np.log(values).sum()))
