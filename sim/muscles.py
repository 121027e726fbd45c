"""Muscles of shoulder, elbow and forearm on a wearer's bones (paper, section 2.2.1, equation 17).

`sim.muscle_tables` and `sim.elbow_muscles` say which; `sim.validation.isometric` checks the elbow's
torques.
"""

from collections.abc import Iterator
from functools import cache
from math import radians

import mujoco
import numpy as np

from sim.elbow_muscles import REFITTED_MUSCLES, TROCHLEA, TROCHLEA_RADIUS, ElbowMuscles
from sim.muscle_tables import FOREARM_ROTATORS, SHOULDER_MUSCLES, Muscle, MuscleGroup
from sim.skeleton import (
    HUMAN_JOINTS,
    add_arm,
    add_torso,
    empty_spec,
    forearm_point,
    upper_arm_point,
)
from sim.wearer import NOMINAL_WEARER, Wearer

#: Elbow angles over which an elbow muscle's shortest and longest lengths are searched.
SWEEP = np.radians(np.linspace(0.0, 120.0, 25))

_TENDON_COLOURS = {
    "flexor": (0.8, 0.15, 0.15, 1),
    "extensor": (0.2, 0.5, 0.8, 1),
    "other": (0.7, 0.4, 0.4, 1),
}


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
    for name, group in (
        ("flexor", elbow.flexors),
        ("extensor", elbow.extensors),
        ("other", MuscleGroup(muscles=beside)),
    ):
        for muscle in group.muscles:
            _add_path(spec, muscle, wearer, _TENDON_COLOURS[name])
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


def elbow_length_ranges(
    wearer: Wearer, elbow: ElbowMuscles = REFITTED_MUSCLES
) -> dict[str, tuple[float, float]]:
    """Return each elbow muscle's shortest and longest length (m) over 0 to 120 degrees of flexion.

    The shoulder is flexed to 90 degrees, as in the isometric tests that the operating ranges were
    fitted to. Only the two lengths of the wearer matter.
    """
    return dict(_swept_ranges(wearer.upper_arm_length, wearer.forearm_length, elbow))


@cache
def _swept_ranges(
    upper_arm_length: float, forearm_length: float, elbow: ElbowMuscles
) -> tuple[tuple[str, tuple[float, float]], ...]:
    wearer = Wearer(
        **{
            **vars(NOMINAL_WEARER),
            "upper_arm_length": upper_arm_length,
            "forearm_length": forearm_length,
        }
    )
    muscles = elbow.flexors.muscles + elbow.extensors.muscles
    lengths = np.empty((len(SWEEP), len(muscles)))
    straight = [i for i, muscle in enumerate(muscles) if not muscle.wraps]
    lengths[:, straight] = _straight_lengths(wearer, [muscles[i] for i in straight])
    round_the_elbow = [i for i, muscle in enumerate(muscles) if muscle.wraps]
    if round_the_elbow:
        lengths[:, round_the_elbow] = _wrapped_lengths(
            wearer, [muscles[i] for i in round_the_elbow]
        )
    return tuple(
        (m.name, (float(lengths[:, i].min()), float(lengths[:, i].max())))
        for i, m in enumerate(muscles)
    )


def _straight_lengths(wearer: Wearer, muscles: list[Muscle]) -> np.ndarray:
    """Return the lengths of straight paths over SWEEP, m, shape (angles, muscles).

    A model need not be compiled for them: bones keep their directions when an arm is scaled.
    """
    places = {}
    for bone, (place, frame) in _nominal_poses().items():
        if bone == "ulna":
            place = wearer.upper_arm_scale * place
        elif bone == "radius":
            ulna = _nominal_poses()["ulna"][0]
            place = wearer.upper_arm_scale * ulna + wearer.forearm_scale * (place - ulna)
        places[bone] = place, frame
    lengths = np.empty((len(SWEEP), len(muscles)))
    for i, muscle in enumerate(muscles):
        path = np.stack(
            [places[b][0] + places[b][1] @ _on_wearer(b, p, wearer) for b, p in muscle.path], axis=1
        )
        lengths[:, i] = np.linalg.norm(np.diff(path, axis=1), axis=2).sum(axis=1)
    return lengths


@cache
def _nominal_poses() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return place (angles, 3) and axes (angles, 3, 3) of the nominal bones over SWEEP."""
    model = _bare_arm(NOMINAL_WEARER).compile()
    data = mujoco.MjData(model)
    bones = {bone: model.body(bone).id for bone in ("scapula", "humerus", "ulna", "radius")}
    poses = {bone: (np.empty((len(SWEEP), 3)), np.empty((len(SWEEP), 3, 3))) for bone in bones}
    for i in _sweep(model, data):
        for bone, number in bones.items():
            poses[bone][0][i] = data.xpos[number]
            poses[bone][1][i] = data.xmat[number].reshape(3, 3)
    return poses


def _wrapped_lengths(wearer: Wearer, muscles: list[Muscle]) -> np.ndarray:
    """Return the lengths of paths round the trochlea over SWEEP, m, shape (angles, muscles)."""
    spec = _bare_arm(wearer)
    _add_trochlea(spec, wearer)
    for muscle in muscles:
        _add_path(spec, muscle, wearer, _TENDON_COLOURS["other"])
    model = spec.compile()
    data = mujoco.MjData(model)
    lengths = np.empty((len(SWEEP), model.ntendon))
    for i in _sweep(model, data):
        mujoco.mj_comPos(model, data)
        mujoco.mj_tendon(model, data)
        lengths[i] = data.ten_length
    return lengths


def _bare_arm(wearer: Wearer) -> mujoco.MjSpec:
    spec = empty_spec()
    add_torso(spec)
    add_arm(spec, wearer)
    return spec


def _sweep(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[int]:
    """Bend the elbow through SWEEP with the shoulder flexed; yield the number of each angle."""
    elbow = model.joint(HUMAN_JOINTS[3]).qposadr[0]
    data.qpos[model.joint(HUMAN_JOINTS[1]).qposadr[0]] = radians(-90.0)
    for i, angle in enumerate(SWEEP):
        data.qpos[elbow] = angle
        mujoco.mj_kinematics(model, data)
        yield i


def _add_path(
    spec: mujoco.MjSpec,
    muscle: Muscle,
    wearer: Wearer,
    rgba: tuple[float, float, float, float],
) -> None:
    tendon = spec.add_tendon(name=muscle.name, width=0.002, rgba=list(rgba))
    for i, (bone, point) in enumerate(muscle.path, start=1):
        site = f"{muscle.name}_{i}"
        spec.body(bone).add_site(name=site, pos=_on_wearer(bone, point, wearer), size=[0.003] * 3)
        if muscle.wraps and i == len(muscle.path):
            tendon.wrap_geom("trochlea", "behind_trochlea")
        tendon.wrap_site(site)


def _add_trochlea(spec: mujoco.MjSpec, wearer: Wearer) -> None:
    """Add the cylinder that the triceps wraps round, and a site on the side it passes."""
    bone, place = TROCHLEA
    humerus, centre = spec.body(bone), _on_wearer(bone, place, wearer)
    radius = TROCHLEA_RADIUS * wearer.upper_arm_scale
    geom = humerus.add_geom(
        name="trochlea",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[radius, radius, 0],
        pos=centre,
        # Along the elbow's axis, across the arm.
        quat=[0.7071067811865476, 0.7071067811865476, 0.0, 0.0],
        rgba=[0.93, 0.9, 0.84, 1.0],
    )
    geom.contype = geom.conaffinity = 0
    geom.mass = 0.0
    behind = radius * np.array([-1.0, 0.0, -2.0])
    humerus.add_site(name="behind_trochlea", pos=centre + behind, size=[0.002] * 3)


def _on_wearer(bone: str, point: tuple[float, float, float], wearer: Wearer) -> np.ndarray:
    """Return a point (m, in the frame of its bone) of the wearer's arm."""
    if bone == "humerus":
        return upper_arm_point(wearer, point)
    if bone in ("ulna", "radius"):
        return forearm_point(wearer, point)
    return np.asarray(point)
