"""The elbow's muscles by the name under which they can be chosen: the condition `muscles`.

The paper's are the default. `docs/understand/muscles.md` shows all three side by side.
"""

from collections.abc import Mapping
from types import MappingProxyType

from sim.body.muscles.authors import PAPER_MUSCLES
from sim.body.muscles.holzbaur import HOLZBAUR_MUSCLES
from sim.body.muscles.muscle import ElbowMuscles
from sim.body.muscles.physiological import PHYSIOLOGICAL_MUSCLES
from sim.parameters.conditions import MUSCLES

#: In the order of `sim.parameters.conditions.MUSCLES`.
ELBOW_MUSCLES: Mapping[str, ElbowMuscles] = MappingProxyType(
    dict(zip(MUSCLES, (PAPER_MUSCLES, HOLZBAUR_MUSCLES, PHYSIOLOGICAL_MUSCLES), strict=True))
)
