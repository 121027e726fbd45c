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
    over_elements,
    set_contacts,
)
from sim.interface.cuffs import BOX_ANGLES, add_cuff, cuff_box_name, quaternion
from sim.interface.interface import Interface, Loads
from sim.interface.straps import add_strap, particle_name, segment_names, strap_angles
from sim.parameters.fidelity import Fidelity
from sim.robot.cuff import Cuff

#: Tissue and box meet only if their normals differ by less than this, rad.
CONTACT_SECTOR = radians(80.0)
#: Where a cuff's place on its limb is looked at: its centre and both ends, in half lengths.
PLACES = (0.0, -1.0, 1.0)
#: A strap that carries less is slack, N: it is closed with 30.
SLACK = 1.0
#: What an element's springs carry if something touches it, N.
TOUCHED = 0.1
#: Sensors of every contact of both limbs, and of the forearm alone.
EACH_CONTACT = ("contacts", "forearm_contacts")
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
        elements = [len(tissue.places) for tissue in self.tissues]
        # An element under load touches one or two faces.
        for name, tissue, count in zip(
            EACH_CONTACT, self.tissues, (sum(elements), elements[1]), strict=True
        ):
            _add_contact_sensor(spec, name, tissue.bone, _EACH, 2 * count)
        for tissue in self.tissues:
            _add_contact_sensor(spec, f"{tissue.name}_force", tissue.bone, _RESULTANT, 1)
            for place in tissue.places:
                sensor = spec.add_sensor(
                    type=mujoco.mjtSensor.mjSENS_CONTACT,
                    objtype=mujoco.mjtObj.mjOBJ_GEOM,
                    objname=element_name(tissue, *place),
                )
                sensor.intprm[:3] = [_FORCE, _RESULTANT, 1]
                if place == tissue.places[0]:
                    # The others follow it; to keep a name costs more than to measure.
                    sensor.name = _first_element(tissue)
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

            # Which way the opening looks: how the cuff has turned round the limb.
            link.add_site(name=f"{cuff.name}_turn", quat=quaternion(cuff.axes), rgba=[0.0] * 4)
            spec.add_sensor(
                name=f"{cuff.name}_turn",
                type=mujoco.mjtSensor.mjSENS_FRAMEYAXIS,
                objtype=mujoco.mjtObj.mjOBJ_SITE,
                objname=f"{cuff.name}_turn",
                reftype=mujoco.mjtObj.mjOBJ_XBODY,
                refname=tissue.bone,
            )
            for segment in segment_names(cuff, self.fidelity):
                spec.add_sensor(
                    name=segment,
                    type=mujoco.mjtSensor.mjSENS_TENDONPOS,
                    objtype=mujoco.mjtObj.mjOBJ_TENDON,
                    objname=segment,
                )

    def loads(self, model: mujoco.MjModel, states: np.ndarray, sensed: np.ndarray) -> Loads:
        """Return the loads in n steps.

        Penetration is how much farther the limb's axis lies from the cuff's, at its centre or
        ends, than the tissue over the bone allows.
        """
        # The forearm hangs on the humerus, so what is below that is both.
        both, forearm = (_columns(model, sensed, f"{tissue.name}_force") for tissue in self.tissues)
        normals = [_columns(model, sensed, name)[:, ::3].sum(axis=1) for name in EACH_CONTACT]
        of_limbs = (normals[0] - normals[1], normals[1])
        limbs = [self._of_limb(model, states, sensed, i, force) for i, force in enumerate(of_limbs)]
        return Loads(
            contact_force=np.linalg.norm(np.stack([both - forearm, forearm], axis=1), axis=2),
            normal_force=normals[0],
            **{name: np.stack([limb[name] for limb in limbs], axis=1) for name in limbs[0]},
        )

    def _of_limb(
        self,
        model: mujoco.MjModel,
        states: np.ndarray,
        sensed: np.ndarray,
        number: int,
        normal_force: np.ndarray,
    ) -> dict[str, np.ndarray]:
        """Return how one limb lies in its cuff: fields of `Loads`, shape (n,) each.

        `normal_force` is the sum of all on it, N, shape (n,).
        """
        cuff, tissue, (_, axes) = self.cuffs[number], self.tissues[number], self.seats[number]
        places = (_columns(model, sensed, f"{cuff.name}_place_{n}") for n in range(len(PLACES)))
        x, y, z = np.stack(list(places), axis=2).transpose(1, 0, 2)
        distance = np.hypot(y - tissue.axis_y, z - tissue.axis_z)
        # The opening about the limb's axis, now and in the seat.
        opening = _columns(model, sensed, f"{cuff.name}_turn")
        turn = np.arctan2(opening[:, 2], opening[:, 1]) - np.arctan2(axes[2, 1], axes[1, 1])
        tension = self._tension(model, sensed, cuff)
        out = -(
            (y[:, 0] - tissue.axis_y) * opening[:, 1] + (z[:, 0] - tissue.axis_z) * opening[:, 2]
        )
        outwards, speed = slides(model, states, tissue)
        pressing = np.maximum(0.0, tissue.spring_forces(outwards, speed))
        carried = over_elements(pressing)
        # What cuff and strap do to an element altogether, less what its springs bear of it.
        first = model.sensor(_first_element(tissue)).adr[0]
        on_each = sensed[:, first : first + 3 * len(tissue.places)].reshape(*pressing.shape, 3)
        along = np.sqrt(np.maximum(0.0, np.square(on_each).sum(axis=2) - np.square(pressing)))
        area = tissue.element_area * np.maximum(1, (pressing > TOUCHED).sum(axis=1))
        # Nothing to carry is carried.
        share = np.full_like(carried, np.inf)
        np.divide(carried, normal_force, out=share, where=normal_force > 0.0)
        return {
            "penetration": distance.max(axis=1) - (cuff.radius - BONE_CLEARANCE),
            "overhang": np.maximum(tissue.start - x[:, 0], x[:, 0] - tissue.end),
            "roll": np.abs(np.angle(np.exp(1j * turn))),
            # Friction goes on holding a limb that slides, as long as there is tissue to hold.
            "slide": np.zeros_like(normal_force),
            "tissue_left": tissue.radius - BONE_CLEARANCE + outwards.min(axis=1),
            "tissue_share": share,
            "strap_tension": tension,
            "unheld": np.where(tension < SLACK, np.maximum(0.0, out), 0.0),
            "peak_pressure": pressing.max(axis=1) / tissue.element_area,
            "mean_pressure": carried / area,
            "peak_shear": along.max(axis=1) / tissue.element_area,
            "mean_shear": along.sum(axis=1) / area,
            "strain": -outwards.min(axis=1) / (tissue.radius - BONE_CLEARANCE),
        }

    def _tension(self, model: mujoco.MjModel, sensed: np.ndarray, cuff: Cuff) -> np.ndarray:
        """Return the tension of a cuff's strap: the sum of its rows, N, shape (n,)."""
        names = segment_names(cuff, self.fidelity)
        segments = [model.tendon(name).id for name in names]
        length = np.concatenate([_columns(model, sensed, name) for name in names], axis=1)
        stretch = np.maximum(0.0, length - model.tendon_lengthspring[segments, 1])
        tension: np.ndarray = (model.tendon_stiffness[segments] * stretch).sum(axis=1)
        # A row's segments carry the same but for friction.
        return tension * self.fidelity.strap_rows / len(names)


def slides(
    model: mujoco.MjModel, states: np.ndarray, tissue: SoftTissue
) -> tuple[np.ndarray, np.ndarray]:
    """Return where each element is, outwards from rest (m), and its speed, shape (n, elements)."""
    joints = [model.joint(element_name(tissue, *place)) for place in tissue.places]
    return (
        states[:, [1 + joint.qposadr[0] for joint in joints]],
        states[:, [1 + model.nq + joint.dofadr[0] for joint in joints]],
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


def _first_element(tissue: SoftTissue) -> str:
    """Return the name of the sensor of all forces on the first element."""
    return f"{tissue.name}_elements"


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
