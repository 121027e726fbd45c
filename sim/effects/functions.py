"""Functions of one number or an array: a law is written once, for a simulated step and a recording.

A step takes plain floats through `math`, which is much faster than NumPy there.
"""

import math

import numpy as np

#: One instant's value, or one for every sample, (n,).
Signal = float | np.ndarray


def exp(x: Signal) -> Signal:
    return math.exp(x) if isinstance(x, float) else np.asarray(np.exp(x))


def expm1(x: Signal) -> Signal:
    return math.expm1(x) if isinstance(x, float) else np.asarray(np.expm1(x))


def cos(x: Signal) -> Signal:
    return math.cos(x) if isinstance(x, float) else np.asarray(np.cos(x))


def sin(x: Signal) -> Signal:
    return math.sin(x) if isinstance(x, float) else np.asarray(np.sin(x))


def magnitude(x: Signal) -> Signal:
    return abs(x) if isinstance(x, float) else np.abs(x)


def at_least(low: float, x: Signal) -> Signal:
    return max(low, x) if isinstance(x, float) else np.maximum(low, x)


def at_most(high: float, x: Signal) -> Signal:
    return min(x, high) if isinstance(x, float) else np.minimum(x, high)


def choose(condition: bool | np.ndarray, yes: Signal, no: Signal) -> Signal:
    """Return `yes` where the condition holds, else `no`."""
    if isinstance(condition, np.ndarray):
        return np.where(condition, yes, no)
    return yes if condition else no
