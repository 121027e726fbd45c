"""Mass that nobody declared: a payload on a link, or inertia that feels no gravity.

The torque of a rigid chain is linear in the inertial parameters of its links (Atkeson, An and
Hollerbach 1986), so one more kilogram is one more column by MuJoCo's own inverse dynamics.
"""

import numpy as np

from analysis.closeloop.catalogue.effect import Columns, Effect, Estimate, Parameter, Theta, scaled
from analysis.closeloop.session.recording import Recording


class Payload(Effect):
    """A point mass on the link that a joint moves, on the line to its centre of mass.

    At the link's centre of percussion it scales gravity and inertia alike, as a torque gain does.
    """

    name = "payload"
    complexity = 2
    signature = (
        "the residual follows gravity over posture and acceleration over speed, in one ratio"
    )
    element = "body/@mass"
    separating_trial = "hold still in five postures, and repeat one movement with a known mass"
    twins = ("torque_gain",)

    def applies(self, recording: Recording, joint: int) -> bool:
        return lever(recording, joint) is not None

    def thetas(self, recording: Recording, joint: int, estimate: Estimate) -> list[Theta]:
        return [{"distance": share} for share in (0.4, 0.7, 1.0, 1.4, 2.0, 3.0)]

    def columns(
        self, recording: Recording, joint: int, theta: Theta, estimate: Estimate
    ) -> Columns:
        torque = _carried(recording, joint, theta["distance"])
        return {number: torque[:, [number]] for number in recording.joints}

    def neighbours(self, theta: Theta, scale: float) -> list[Theta]:
        return scaled(theta, "distance", scale, step=0.25)

    def parameters(self, recording: Recording, joint: int, theta: Theta) -> dict[str, Parameter]:
        centre = lever(recording, joint)
        assert centre is not None
        return {
            "mass": Parameter(unit="kg", column=0),
            "distance": Parameter(
                unit="m", value=float(np.linalg.norm(centre)) * theta["distance"]
            ),
        }


def lever(recording: Recording, joint: int) -> np.ndarray | None:
    """Return the centre of mass of the joint's body in its frame; None if it lies on the axis."""
    model = recording.device.model
    body = int(model.jnt_bodyid[joint])
    centre = np.array(model.body_ipos[body])
    if model.body_mass[body] <= 0.0 or np.linalg.norm(centre) < 1e-3:
        geoms = np.flatnonzero(model.geom_bodyid == body)
        if len(geoms) == 0:
            return None
        centre = np.array(model.geom_pos[geoms[0]])
    return centre if np.linalg.norm(centre) >= 1e-3 else None


def _carried(recording: Recording, joint: int, share: float) -> np.ndarray:
    """Return the torque of one kilogram at `share` of the lever: a quadratic in the share."""
    centre = lever(recording, joint)
    assert centre is not None
    body = recording.device.model.body(recording.device.model.jnt_bodyid[joint]).name
    axis, once, twice = (recording.carried(body, centre * factor) for factor in (0.0, 1.0, 2.0))
    curve = (twice - 2 * once + axis) / 2
    return np.asarray(axis + (once - axis - curve) * share + curve * share**2)


class AddedInertia(Effect):
    """Inertia about the joint's own axis that feels no gravity: motor, gear, balanced limb."""

    name = "added_inertia"
    complexity = 1
    signature = "the residual is a straight line against acceleration and does not know posture"
    element = "joint/@armature"
    separating_trial = "shake the joint in two postures that differ in gravity"

    def columns(
        self, recording: Recording, joint: int, theta: Theta, estimate: Estimate
    ) -> Columns:
        return {joint: recording.acceleration[:, [joint]]}

    def parameters(self, recording: Recording, joint: int, theta: Theta) -> dict[str, Parameter]:
        hinge = recording.device.is_hinge(recording.device.joints[joint])
        return {"inertia": Parameter(unit="kg m2" if hinge else "kg", column=0)}
