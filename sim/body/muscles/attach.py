"""Muscles of shoulder, elbow and forearm on a wearer's bones (paper, section 2.2.1, equation 17).

`sim.body.muscles.holzbaur` and `elbow` say which; `sim.validation.isometric` checks the elbow's
torques.
"""

import mujoco

from sim.body.muscles.elbow import REFITTED_MUSCLES, TROCHLEA, TROCHLEA_RADIUS, TROCHLEA_SIDE
from sim.body.muscles.holzbaur import FOREARM_ROTATORS, SHOULDER_MUSCLES
from sim.body.muscles.lengths import elbow_length_ranges
from sim.body.muscles.muscle import ElbowMuscles, Muscle, MuscleGroup
from sim.body.skeleton import BONE_COLOUR, DRAWN, bone_point
from sim.parameters.wearer import Wearer

#: Colours of tendons: flexors, extensors, and muscles beside the elbow's.
_RED, _BLUE, _PINK = (0.8, 0.15, 0.15, 1), (0.2, 0.5, 0.8, 1), (0.7, 0.4, 0.4, 1)


def add_muscles(
    spec: mujoco.MjSpec,
    wearer: Wearer,
    *,
    elbow: ElbowMuscles = REFITTED_MUSCLES,
    others: tuple[Muscle, ...] = SHOULDER_MUSCLES + FOREARM_ROTATORS,
) -> None:
    """Add muscles to a spec that has torso and arm, 26 in all; their input is activation, 0 to 1.

    Args:
        spec: the model under construction.
        wearer: whose arm it is.
        elbow: the elbow's muscles.
        others: muscles beside the elbow's.
    """
    if any(muscle.wraps for muscle in elbow.extensors.muscles):
        _add_trochlea(spec, wearer)
    beside = tuple(muscle for muscle in others if muscle.length_range)
    ranges = elbow_length_ranges(wearer, elbow)
    for group, colour in (
        (elbow.flexors, _RED),
        (elbow.extensors, _BLUE),
        (MuscleGroup(muscles=beside), _PINK),
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
                force=group.force_scale * muscle.force,
                range=list(muscle.operating_range or group.operating_range),
                lmin=group.shortest_active,
                fpmax=group.passive_force,
            )


def _add_path(
    spec: mujoco.MjSpec, muscle: Muscle, wearer: Wearer, rgba: tuple[float, float, float, float]
) -> None:
    tendon = spec.add_tendon(name=muscle.name, width=0.002, rgba=list(rgba))
    for i, (bone, point) in enumerate(muscle.path, start=1):
        site = f"{muscle.name}_{i}"
        spec.body(bone).add_site(name=site, pos=bone_point(wearer, bone, point), size=[0.003] * 3)
        if muscle.wraps and i == len(muscle.path):
            tendon.wrap_geom("trochlea", "behind_trochlea")
        tendon.wrap_site(site)


def _add_trochlea(spec: mujoco.MjSpec, wearer: Wearer) -> None:
    """Add the cylinder that the triceps wraps round, and a site on the side it passes."""
    bone, place = TROCHLEA
    humerus, centre = spec.body(bone), bone_point(wearer, bone, place)
    radius = TROCHLEA_RADIUS * wearer.upper_arm_scale
    humerus.add_geom(
        name="trochlea",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[radius, radius, 0],
        pos=centre,
        # Along the elbow's axis, across the arm.
        quat=[0.7071067811865476, 0.7071067811865476, 0.0, 0.0],
        rgba=BONE_COLOUR,
        **DRAWN,
    )
    behind = radius * TROCHLEA_SIDE
    humerus.add_site(name="behind_trochlea", pos=centre + behind, size=[0.002] * 3)
