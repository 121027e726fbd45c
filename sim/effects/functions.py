"""Functions of one number or an array: a law is written once, for a simulated step and a recording.

A step takes plain floats through `math`, which is much faster than NumPy there.
"""

import math
from collections.abc import Callable

import numpy as np

#: One instant's value, or one for every sample, (n,).
Signal = float | np.ndarray


def _either(scalar: Callable[[float], float], array: np.ufunc) -> Callable[[Signal], Signal]:
    """Return one function of a float by `scalar` and of an array by `array`."""

    def function(x: Signal) -> Signal:
        return scalar(x) if isinstance(x, float) else np.asarray(array(x))

    return function


exp = _either(math.exp, np.exp)
expm1 = _either(math.expm1, np.expm1)
log1p = _either(math.log1p, np.log1p)
cos = _either(math.cos, np.cos)
sin = _either(math.sin, np.sin)
tanh = _either(math.tanh, np.tanh)
magnitude = _either(abs, np.abs)


def at_least(low: float, x: Signal) -> Signal:
    return max(low, x) if isinstance(x, float) else np.maximum(low, x)


def at_most(high: float, x: Signal) -> Signal:
    return min(x, high) if isinstance(x, float) else np.minimum(x, high)


def choose(condition: bool | np.ndarray, yes: Signal, no: Signal) -> Signal:
    """Return `yes` where the condition holds, else `no`."""
    if isinstance(condition, np.ndarray):
        return np.where(condition, yes, no)
    return yes if condition else no
