"""Compile a model of somebody's own."""

import warnings

import mujoco


def compiled(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile a model, without MuJoCo's remark on its inertia matrix in the first position.

    Three hinges of a shoulder lock there as a gimbal does: nothing is wrong with the model.

    Raises:
        ValueError: MuJoCo refuses it.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Inertia matrix is too close to singular", UserWarning)
        return spec.compile()
