"""The interface with explicit contact: tissue, cuffs and straps (paper, section 2.2.3).

Tissue touches only its own cuff and strap, through explicit contact pairs. Sensors measure inside
the engine what cuffs and straps do to the arm, at the instant in which a step begins.
"""

from dataclasses import dataclass
from math import cos, radians, sin

import mujoco
import numpy as np

from sim.body.soft_tissue import (
    BONE_CLEARANCE,
    SoftTissue,
    add_soft_tissue,
    element_name,
    set_contacts,
)
from sim.interface.cuffs import BOX_ANGLES, add_cuff, cuff_box_name
from sim.interface.interface import Interface, Loads
from sim.interface.straps import add_strap, particle_name, strap_angles
from sim.parameters.fidelity import Fidelity
from sim.robot.cuff import Cuff

#: Tissue and box meet only if their normals differ by less than this, rad.
CONTACT_SECTOR = radians(80.0)
#: Where a cuff's place on its limb is looked at: its centre and both ends, in half lengths.
PLACES = (0.0, -1.0, 1.0)
ALL_NORMALS = "normal_forces"
_FORCE = 1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE)
#: How a contact sensor reports: every contact, or the resultant of all in the world's frame.
_EACH, _RESULTANT = 0, 3


@dataclass(frozen=True, kw_only=True)
class Contact(Interface):
    """Elements of soft tissue that meet the boxes of cuffs and the particles of straps."""

    fidelity: Fidelity
    #: Coulomb friction of cuff and strap on the arm.
    friction: float

    def add(self, spec: mujoco.MjSpec) -> None:
        """Add tissue, cuffs and open straps, the pairs that may touch, and sensors."""
        set_contacts(spec, self.friction, self.fidelity)
        for cuff, tissue in zip(self.cuffs, self.tissues, strict=True):
            add_soft_tissue(spec, tissue)
            add_cuff(spec, cuff)
            add_strap(spec, cuff, self.fidelity)
            _add_contacts(spec, cuff, tissue, self.fidelity)
        self._add_sensors(spec)

    def _add_sensors(self, spec: mujoco.MjSpec) -> None:
        """Measure the contact forces on each limb, and where each cuff is on its bone."""
        elements = sum(len(tissue.places) for tissue in self.tissues)
        # An element under load touches one or two faces.
        _add_contact_sensor(spec, ALL_NORMALS, self.tissues[0].bone, _EACH, 2 * elements)
        for tissue in self.tissues:
            _add_contact_sensor(spec, f"{tissue.name}_force", tissue.bone, _RESULTANT, 1)
        for cuff, tissue in zip(self.cuffs, self.tissues, strict=True):
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
                    refname=tissue.bone,
                )

    def loads(self, model: mujoco.MjModel, sensed: np.ndarray) -> Loads:
        """Return the loads in n steps.

        Penetration is how much farther the limb's axis lies from the cuff's, at its centre or
        ends, than the tissue over the bone allows.
        """
        # The forearm hangs on the humerus, so what is below that is both.
        both, forearm = (_columns(model, sensed, f"{tissue.name}_force") for tissue in self.tissues)
        penetration, overhang = np.empty((len(sensed), 2)), np.empty((len(sensed), 2))
        for i, (cuff, tissue) in enumerate(zip(self.cuffs, self.tissues, strict=True)):
            places = (_columns(model, sensed, f"{cuff.name}_place_{n}") for n in range(len(PLACES)))
            x, y, z = np.stack(list(places), axis=2).transpose(1, 0, 2)
            distance = np.hypot(y - tissue.axis_y, z - tissue.axis_z)
            penetration[:, i] = distance.max(axis=1) - (cuff.radius - BONE_CLEARANCE)
            overhang[:, i] = np.maximum(tissue.start - x[:, 0], x[:, 0] - tissue.end)
        return Loads(
            contact_force=np.linalg.norm(np.stack([both - forearm, forearm], axis=1), axis=2),
            normal_force=_columns(model, sensed, ALL_NORMALS)[:, ::3].sum(axis=1),
            penetration=penetration,
            overhang=overhang,
        )


def _add_contacts(spec: mujoco.MjSpec, cuff: Cuff, tissue: SoftTissue, fidelity: Fidelity) -> None:
    """Let the tissue's elements meet the boxes and particles that face them."""
    faces = [(cuff_box_name(cuff, i), angle) for i, angle in enumerate(BOX_ANGLES)]
    faces += [
        (particle_name(cuff, row, i), angle)
        for row in range(fidelity.strap_rows)
        for i, angle in enumerate(strap_angles(fidelity))
    ]
    for ring, index in tissue.places:
        _, normal = tissue.element(ring, index)
        for box, angle in faces:
            # In the zero pose the bone's y axis points out of the opening, its z axis to the wall.
            if normal[1] * cos(angle) + normal[2] * sin(angle) <= cos(CONTACT_SECTOR):
                continue
            spec.add_pair(geomname1=element_name(tissue, ring, index), geomname2=box)


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
