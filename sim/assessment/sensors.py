"""What is measured inside the engine: torques, and what cuffs and straps do to the arm.

Sensors hold the quantities of the instant in which a step begins.
"""

import mujoco
import numpy as np

from sim.body.soft_tissue import BONE_CLEARANCE, Sleeve
from sim.interface.cuffs import Cuff

#: Where a cuff's place on its limb is looked at: its centre and both ends, in half lengths.
PLACES = (0.0, -1.0, 1.0)
ALL_NORMALS = "normal_forces"
_FORCE = 1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE)
#: How a contact sensor reports: every contact, or the resultant of all in the world's frame.
_EACH, _RESULTANT = 0, 3


def add_torque_sensors(spec: mujoco.MjSpec, joints: tuple[str, ...], human_joint: str) -> None:
    """Measure the motor of each of the device's `joints` and the muscles about `human_joint`.

    To be called before any other sensor is added.
    """
    for joint in joints:
        spec.add_sensor(
            name=f"{joint}_motor_torque",
            type=mujoco.mjtSensor.mjSENS_ACTUATORFRC,
            objtype=mujoco.mjtObj.mjOBJ_ACTUATOR,
            objname=f"{joint}_motor",
        )
    spec.add_sensor(
        name="muscle_torque",
        type=mujoco.mjtSensor.mjSENS_JOINTACTFRC,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        objname=human_joint,
    )


def add_interface_sensors(
    spec: mujoco.MjSpec, holders: tuple[Cuff, Cuff], parts: tuple[Sleeve, Sleeve]
) -> None:
    """Measure the contact forces on each limb, and where each cuff is on its bone."""
    elements = sum(len(sleeve.places) for sleeve in parts)
    # An element under load touches one or two faces.
    _add_contact_sensor(spec, ALL_NORMALS, parts[0].bone, _EACH, 2 * elements)
    for sleeve in parts:
        _add_contact_sensor(spec, f"{sleeve.name}_force", sleeve.bone, _RESULTANT, 1)
    for cuff, sleeve in zip(holders, parts, strict=True):
        link = spec.body(cuff.link)
        for number, share in enumerate(PLACES):
            name = f"{cuff.name}_place_{number}"
            along = share * cuff.length / 2 * np.array(cuff.along)
            link.add_site(name=name, pos=np.array(cuff.centre) + along, rgba=[0.0] * 4)
            spec.add_sensor(
                name=name,
                type=mujoco.mjtSensor.mjSENS_FRAMEPOS,
                objtype=mujoco.mjtObj.mjOBJ_SITE,
                objname=name,
                reftype=mujoco.mjtObj.mjOBJ_XBODY,
                refname=sleeve.bone,
            )


def contact_forces(
    model: mujoco.MjModel, sensed: np.ndarray, parts: tuple[Sleeve, Sleeve]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the resultant force on each limb and the sum of normal forces, N.

    Args:
        model: with `add_interface_sensors`.
        sensed: sensors of n steps, shape (n, nsensordata).
        parts: tissue of upper arm and forearm.

    Returns:
        Arrays of shape (n, 2) and (n,).
    """
    # The forearm hangs on the humerus, so what is below that is both.
    both, forearm = (_columns(model, sensed, f"{sleeve.name}_force") for sleeve in parts)
    resultant = np.linalg.norm(np.stack([both - forearm, forearm], axis=1), axis=2)
    normal: np.ndarray = _columns(model, sensed, ALL_NORMALS)[:, ::3].sum(axis=1)
    return resultant, normal


def seats(
    model: mujoco.MjModel,
    sensed: np.ndarray,
    holders: tuple[Cuff, Cuff],
    parts: tuple[Sleeve, Sleeve],
) -> tuple[np.ndarray, np.ndarray]:
    """Return penetration and overhang of each limb in n steps, m, shapes (n, 2) and (n, 2).

    Penetration is how much farther the limb's axis lies from the cuff's, at its centre or ends,
    than the tissue over the bone allows; overhang is how far the cuff's centre lies beyond the
    tissue.
    """
    penetration, overhang = np.empty((len(sensed), 2)), np.empty((len(sensed), 2))
    for i, (cuff, sleeve) in enumerate(zip(holders, parts, strict=True)):
        x, y, z = np.stack(
            [_columns(model, sensed, f"{cuff.name}_place_{n}") for n in range(len(PLACES))], axis=2
        ).transpose(1, 0, 2)
        distance = np.hypot(y - sleeve.axis_y, z - sleeve.axis_z)
        penetration[:, i] = distance.max(axis=1) - (cuff.radius - BONE_CLEARANCE)
        overhang[:, i] = np.maximum(sleeve.start - x[:, 0], x[:, 0] - sleeve.end)
    return penetration, overhang


def _add_contact_sensor(
    spec: mujoco.MjSpec, name: str, bone: str, reduction: int, slots: int
) -> None:
    """Report the forces of all contacts of what hangs on a bone."""
    sensor = spec.add_sensor(
        name=name,
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=mujoco.mjtObj.mjOBJ_XBODY,
        objname=bone,
    )
    sensor.intprm[:3] = [_FORCE, reduction, slots]


def _columns(model: mujoco.MjModel, sensed: np.ndarray, name: str) -> np.ndarray:
    sensor = model.sensor(name)
    return sensed[:, sensor.adr[0] : sensor.adr[0] + sensor.dim[0]]
