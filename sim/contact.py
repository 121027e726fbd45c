"""What cuffs and straps do to the arm: forces, and where the bones lie in the cuffs."""

import mujoco
import numpy as np

from sim.model import System
from sim.soft_tissue import BONE_CLEARANCE


class InterfaceGauge:
    """Reads the interface of one system; forces and poses are those of the last step's start."""

    def __init__(self, system: System) -> None:
        model = system.model
        self._limb_of_geom = system.limb_of_geom
        self._sleeves, self._cuffs = system.sleeves, system.cuffs
        self._links = [model.body(cuff.link).id for cuff in self._cuffs]
        self._bones = [model.body(sleeve.bone).id for sleeve in self._sleeves]
        # Centre and both ends of each cuff's axis in its link, shape (3, 3).
        self._axes = [
            np.array(cuff.centre)
            + np.outer([0.0, -cuff.length / 2, cuff.length / 2], np.array(cuff.along, dtype=float))
            for cuff in self._cuffs
        ]

    def forces(self, data: mujoco.MjData) -> tuple[np.ndarray, float]:
        """Return the resultant force on each limb (N, shape (2,)) and the sum of normal forces (N).

        Contacts have an elliptic cone with two tangents, so that a contact's three constraint
        forces are its force in the contact's frame.
        """
        contact = data.contact
        active = contact.efc_address >= 0
        address = contact.efc_address[active]
        frames = contact.frame.reshape(-1, 3, 3)[active]
        geoms = contact.geom[active]
        components = data.efc_force[address[:, None] + np.arange(3)]
        forces = np.einsum("nij,ni->nj", frames, components)
        # The frame's normal points from the first geom to the second, on which the force acts.
        limbs = self._limb_of_geom[geoms]
        sign = np.where(limbs[:, 1] >= 0, 1.0, -1.0)
        limb = limbs.max(axis=1, initial=-1)
        resultant = np.array(
            [
                np.linalg.norm((sign[:, None] * forces)[limb == number].sum(axis=0))
                for number in (0, 1)
            ]
        )
        return resultant, float(components[:, 0].sum())

    def seats(self, data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
        """Return penetration and overhang of each limb, m, shapes (2,) and (2,).

        Penetration is how much farther the limb's axis lies from the cuff's, at its centre or ends,
        than the tissue over the bone allows; overhang is how far the cuff's centre lies beyond the
        tissue.
        """
        penetration, overhang = np.empty(2), np.empty(2)
        for i, (sleeve, cuff) in enumerate(zip(self._sleeves, self._cuffs, strict=True)):
            link, bone = self._links[i], self._bones[i]
            world = data.xpos[link] + self._axes[i] @ data.xmat[link].reshape(3, 3).T
            local = (world - data.xpos[bone]) @ data.xmat[bone].reshape(3, 3)
            distance = np.hypot(local[:, 1] - sleeve.axis_y, local[:, 2] - sleeve.axis_z)
            penetration[i] = distance.max() - (cuff.radius - BONE_CLEARANCE)
            overhang[i] = max(sleeve.start - local[0, 0], local[0, 0] - sleeve.end)
        return penetration, overhang
