"""Muscles of shoulder, elbow and forearm on a wearer's bones (paper, section 2.2.1, equation 17).

`sim.body.muscles.elbow` says which; `sim.validation.isometric` checks the elbow's torques.
"""

import mujoco
import numpy as np

from sim.body.muscles.authors import FOREARM_ROTATORS, PAPER_MUSCLES, SHOULDER_MUSCLES
from sim.body.muscles.lengths import elbow_length_ranges, operating_range
from sim.body.muscles.muscle import ElbowMuscles, Muscle, MuscleGroup, Wrap
from sim.body.skeleton import BONE_COLOUR, DRAWN, bone_point
from sim.parameters.wearer import Wearer

#: Colours of tendons: flexors, extensors, and muscles beside the elbow's.
_RED, _BLUE, _PINK = (0.8, 0.15, 0.15, 1), (0.2, 0.5, 0.8, 1), (0.7, 0.4, 0.4, 1)


def add_muscles(
    spec: mujoco.MjSpec,
    wearer: Wearer,
    *,
    elbow: ElbowMuscles = PAPER_MUSCLES,
    others: tuple[Muscle, ...] = SHOULDER_MUSCLES + FOREARM_ROTATORS,
    strength: float = 1.0,
) -> None:
    """Add muscles to a spec that has torso and arm, 26 in all; their input is activation, 0 to 1.

    Args:
        spec: the model under construction.
        wearer: whose arm it is.
        elbow: the elbow's muscles.
        others: muscles beside the elbow's.
        strength: what the peak forces of the elbow's muscles are multiplied by.
    """
    wraps = {m.wrap.name: m.wrap for m in elbow.flexors.muscles + elbow.extensors.muscles if m.wrap}
    for wrap in wraps.values():
        _add_wrap(spec, wearer, wrap)
    beside = tuple(muscle for muscle in others if muscle.length_range)
    ranges = elbow_length_ranges(wearer, elbow)
    for group, colour, scale in (
        (elbow.flexors, _RED, strength),
        (elbow.extensors, _BLUE, strength),
        (MuscleGroup(muscles=beside), _PINK, 1.0),
    ):
        for muscle in group.muscles:
            _add_path(spec, muscle, wearer, colour)
            actuator = spec.add_actuator(
                name=muscle.name,
                trntype=mujoco.mjtTrn.mjTRN_TENDON,
                target=muscle.name,
                ctrllimited=True,
                ctrlrange=[0.0, 1.0],
                lengthrange=list(muscle.length_range or ranges[muscle.name]),
            )
            actuator.set_to_muscle(
                tausmooth=0.0,
                force=scale * group.force_scale * muscle.force,
                range=list(operating_range(muscle, group, elbow)),
                lmin=group.shortest_active,
                lmax=group.longest_active,
                fpmax=group.passive_force,
            )


def _add_path(
    spec: mujoco.MjSpec, muscle: Muscle, wearer: Wearer, rgba: tuple[float, float, float, float]
) -> None:
    tendon = spec.add_tendon(name=muscle.name, width=0.002, rgba=list(rgba))
    for i, (bone, point) in enumerate(muscle.path, start=1):
        site = f"{muscle.name}_{i}"
        spec.body(bone).add_site(name=site, pos=bone_point(wearer, bone, point), size=[0.003] * 3)
        if muscle.wrap and i == muscle.wrap.part + 2:
            tendon.wrap_geom(muscle.wrap.name, f"{muscle.wrap.name}_side")
        tendon.wrap_site(site)


def _add_wrap(spec: mujoco.MjSpec, wearer: Wearer, wrap: Wrap) -> None:
    """Add the cylinder that muscles wrap round, and a site on the side they pass."""
    bone, place = wrap.centre
    humerus, centre = spec.body(bone), bone_point(wearer, bone, place)
    radius = wrap.radius * wearer.upper_arm_scale
    humerus.add_geom(
        name=wrap.name,
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[radius, radius, 0],
        pos=centre,
        # Along the elbow's axis, across the arm.
        quat=[0.7071067811865476, 0.7071067811865476, 0.0, 0.0],
        rgba=BONE_COLOUR,
        **DRAWN,
    )
    along, across = wrap.side
    side = radius * np.array([along, 0.0, across])
    humerus.add_site(name=f"{wrap.name}_side", pos=centre + side, size=[0.002] * 3)
