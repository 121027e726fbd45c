"""K_h of an arm that holds still while flexors and extensors pull together, from their curves."""

from collections.abc import Sequence

import numpy as np

#: Where both experiments and the movement of an assessment have elbow angles, degrees.
COMMON_DEG = np.arange(20.0, 111.0)


def co_contraction_stiffness(
    angles_deg: Sequence[float] | np.ndarray,
    flexion_nm: Sequence[float] | np.ndarray,
    extension_nm: Sequence[float] | np.ndarray,
    activation: float,
) -> float:
    """Return the slope of what is left when flexors and extensors pull together, Nm/rad.

    That is K_h of equation 3 without movement: positive if the net torque grows with flexion. Over
    COMMON_DEG; torque is taken to grow with activation.

    Args:
        angles_deg: elbow angles of both curves, degrees, rising, shape (n,).
        flexion_nm: torque of the fully active flexors, Nm, shape (n,).
        extension_nm: that of the extensors, negative, shape (n,).
        activation: of both, 0 to 1.
    """
    net = np.asarray(flexion_nm, dtype=float) + np.asarray(extension_nm, dtype=float)
    torque = activation * np.interp(COMMON_DEG, angles_deg, net)
    return float(np.polyfit(np.radians(COMMON_DEG), torque, 1)[0])
