"""What every interface between exoskeleton and arm offers, whatever it is made of."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import mujoco
import numpy as np

from sim.body.soft_tissue import SoftTissue
from sim.interface.seat import seated_elbow_angle, seats_in_bones
from sim.parameters.wearer import Wearer
from sim.robot.cuff import Cuff


@dataclass(frozen=True, kw_only=True)
class Loads:
    """What cuffs and straps do to upper arm and forearm in n steps."""

    #: Resultant force on each limb, N, shape (n, 2).
    contact_force: np.ndarray
    #: Sum of all normal forces between exoskeleton and arm, N, shape (n,).
    normal_force: np.ndarray
    #: Bone beyond what the tissue leaves free, m, shape (n, 2); positive is bone in cuff.
    penetration: np.ndarray
    #: Cuff centre beyond the end of the tissue, m, shape (n, 2); negative is inside.
    overhang: np.ndarray
    #: How far the cuff has turned round the limb since its strap was closed, rad, shape (n, 2).
    roll: np.ndarray
    #: How far it has gone along the limb over where its hold ends; 0 if friction never ends.
    slide: np.ndarray
    #: Tissue left between the cuff and what remains over the bone, m, shape (n, 2).
    tissue_left: np.ndarray
    #: What the tissue's springs carry of the normal forces, as a share, shape (n, 2).
    tissue_share: np.ndarray
    #: Tension of each strap, N, shape (n, 2); infinite where there are no straps to lose it.
    strap_tension: np.ndarray
    #: How far the limb's axis lies from the cuff's towards its opening while the strap carries
    #: nothing, m, shape (n, 2); 0 where it carries.
    unheld: np.ndarray
    #: What presses on the skin and what pulls along it, Pa, shape (n, 2): the most on any element,
    #: and over all that are touched. NaN, like the strain, where there are no elements.
    peak_pressure: np.ndarray
    mean_pressure: np.ndarray
    peak_shear: np.ndarray
    mean_shear: np.ndarray
    #: Largest compression of the tissue over its thickness on the bone, shape (n, 2).
    strain: np.ndarray


#: The fields of `Loads` that only elements of tissue can tell.
OF_ELEMENTS = ("peak_pressure", "mean_pressure", "peak_shear", "mean_shear", "strain")


@dataclass(frozen=True, kw_only=True)
class Interface(ABC):
    """How an exoskeleton holds an arm: each limb's tissue in its cuff."""

    wearer: Wearer
    #: Tissue of upper arm and forearm, and the cuff and strap of each.
    tissues: tuple[SoftTissue, SoftTissue]
    cuffs: tuple[Cuff, Cuff]
    #: The exoskeleton's elbow angle when the straps are closed, rad.
    closed_at: float

    @property
    def seated_elbow(self) -> float:
        """The human elbow's angle at that moment, rad."""
        return seated_elbow_angle(self.wearer, self.tissues[1], self.cuffs[1], self.closed_at)

    @property
    def seats(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Where each cuff's centre (m) and axes lie in its bone then: shapes (3,) and (3, 3)."""
        return seats_in_bones(self.wearer, self.tissues[1], self.cuffs, self.closed_at)

    @abstractmethod
    def add(self, spec: mujoco.MjSpec) -> None:
        """Join arm and exoskeleton in a spec that has both, and add what measures the loads."""

    @abstractmethod
    def loads(self, model: mujoco.MjModel, states: np.ndarray, sensed: np.ndarray) -> Loads:
        """Return the loads in n steps.

        Args:
            model: the compiled one, with the straps as they are closed.
            states: before each step, shape (n, nstate): time, positions, velocities and so on.
            sensed: sensors of each step, shape (n, nsensordata).
        """
