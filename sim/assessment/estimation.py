"""Joint stiffness and damping by regression (paper, equations 8, 9 and 21), in three named forms.

Which regression defines K_h moves it more than most factors of Table 1 do, so all are always
computed:

========== ============================= ============ ==========================
form       estimate: regressors          torque       truth: muscles' torque on
========== ============================= ============ ==========================
affine     theta, theta', 1              equation 20  q, q', 1
paper      theta, theta' (equation 21)   equation 20  q, q'
authors    q, 1 (their published code)   published    q, 1
========== ============================= ============ ==========================

A limb has a neutral angle, and a clinic knows theta alone: hence `affine` is the default. What
muscles do is the truth of every form.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

#: Regressors of each form: angle of the estimate, whether velocity and a constant enter.
FORMS: Mapping[str, tuple[str, bool, bool]] = MappingProxyType(
    {
        "affine": ("theta", True, True),
        "paper": ("theta", True, False),
        "authors": ("q", False, True),
    }
)

#: Condition number of the scaled regressors beyond which a regression is refused.
MAX_CONDITION = 1e3


class IllConditionedError(ValueError):
    """The movement does not determine stiffness and damping."""


@dataclass(frozen=True, kw_only=True)
class Fit:
    """Result of one regression."""

    #: Nm/rad, sign of equation 3: positive if the human torque grows with flexion.
    stiffness: float
    #: Nm s/rad, sign of equation 3; None if velocity is not a regressor.
    damping: float | None
    #: Share of the torque's variation explained (about zero if there is no constant).
    r_squared: float
    #: Root mean square of what the regression leaves, Nm.
    residual_rms: float


def fit(
    torque: np.ndarray, angle: np.ndarray, velocity: np.ndarray, *, damping: bool, constant: bool
) -> Fit:
    """Fit `torque = K angle (+ D velocity) (+ c)` by least squares (equation 9).

    Args:
        torque: human torque, Nm, shape (n,).
        angle: rad, shape (n,).
        velocity: rad/s, shape (n,).
        damping: whether velocity is a regressor.
        constant: whether a neutral torque is one.

    Raises:
        IllConditionedError: the regressors do not vary independently.
    """
    columns = [angle]
    if damping:
        columns.append(velocity)
    if constant:
        columns.append(np.ones_like(angle))
    matrix = np.column_stack(columns)
    scale = np.linalg.norm(matrix, axis=0)
    known = np.all(scale > 0.0)
    if known:
        # Of the normal equations: their condition is the square of the regressors'.
        scaled = matrix / scale
        values, vectors = np.linalg.eigh(scaled.T @ scaled)
        known = values[-1] <= MAX_CONDITION**2 * values[0]
    if not known:
        raise IllConditionedError(
            "the movement does not tell stiffness from the other regressors: "
            "it must change angle and velocity"
        )
    solution = vectors @ (vectors.T @ (torque @ scaled) / values) / scale
    residual = torque - matrix @ solution
    total = torque - torque.mean() if constant else torque
    return Fit(
        stiffness=float(solution[0]),
        damping=float(solution[1]) if damping else None,
        r_squared=float(1.0 - residual @ residual / max(total @ total, np.finfo(float).tiny)),
        residual_rms=float(np.sqrt(np.mean(residual**2))),
    )


def estimate_forms(
    *,
    theta: np.ndarray,
    theta_velocity: np.ndarray,
    q: np.ndarray,
    q_velocity: np.ndarray,
    inferred_torque: np.ndarray,
    published_torque: np.ndarray,
    muscle_torque: np.ndarray,
) -> dict[str, tuple[Fit, Fit]]:
    """Return for each form its estimate and its truth; all arrays have shape (n,).

    Args:
        theta: exoskeleton's elbow angle, rad.
        theta_velocity: its velocity, rad/s.
        q: human elbow angle, rad.
        q_velocity: its velocity, rad/s.
        inferred_torque: human torque after equation 20, Nm.
        published_torque: human torque after the authors' code, which subtracts the bias torque of a
            bare arm alone, Nm.
        muscle_torque: torque of the muscles about the human elbow, Nm.

    Raises:
        IllConditionedError: the regressors do not vary independently.
    """
    forms = {}
    for name, (angle, damping, constant) in FORMS.items():
        estimate = fit(
            published_torque if angle == "q" else inferred_torque,
            q if angle == "q" else theta,
            q_velocity if angle == "q" else theta_velocity,
            damping=damping,
            constant=constant,
        )
        truth = fit(muscle_torque, q, q_velocity, damping=damping, constant=constant)
        forms[name] = (estimate, truth)
    return forms
