"""Compile a model of somebody's own."""

import re
import warnings

import mujoco

#: Moments of inertia in XML, and by what share two have to be larger than the third.
_MOMENTS, _LARGER = re.compile(r'diaginertia="([^"]*)"'), 1e-9


def compiled(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile a model, without MuJoCo's remark on its inertia matrix in the first position.

    Three hinges of a shoulder lock there as a gimbal does: nothing is wrong with the model.

    Raises:
        ValueError: MuJoCo refuses it.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Inertia matrix is too close to singular", UserWarning)
        return spec.compile()


def written(spec: mujoco.MjSpec) -> str:
    """Return a model that was compiled as XML that can be compiled again.

    MuJoCo writes six digits: of a body as flat as a sheet, two moments of inertia then may add up
    to less than the third, which it refuses to read.
    """
    return _MOMENTS.sub(lambda found: f'diaginertia="{_kept(found[1])}"', spec.to_xml())


def _kept(moments: str) -> str:
    """Return three moments of inertia, the largest of which is at most the sum of the others."""
    values = [float(word) for word in moments.split()]
    rest = (sum(values) - max(values)) * (1.0 - _LARGER)
    if max(values) <= rest:
        return moments
    return " ".join(repr(min(value, rest)) for value in values)
