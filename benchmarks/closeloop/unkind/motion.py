"""Motions that a controller is asked for: position, speed and acceleration on a fine clock."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from benchmarks.closeloop.unkind.chain import Signal

Path = tuple[Signal, Signal, Signal]


def multisine(rng: np.random.Generator, time: Signal, low: float, high: float, pace: float) -> Path:
    """A periodic sum of sines as identification uses it, eased in and out."""
    base = max(0.1, 0.25 * pace)
    orders = np.arange(1, 7)
    sizes = rng.uniform(0.3, 1.0, 6) / orders
    phases = rng.uniform(0, 2 * np.pi, 6)
    turns = 2 * np.pi * base * orders
    angle = turns[:, None] * time + phases[:, None]
    q = sizes @ np.sin(angle)
    middle, half = (low + high) / 2, (high - low) / 2
    scale = half * rng.uniform(0.7, 0.95) / np.max(np.abs(q))
    v, a = (sizes * turns) @ np.cos(angle), -(sizes * turns**2) @ np.sin(angle)
    ease, de, dde = _ease(time)
    shift = q * scale
    return (
        middle + shift * ease,
        scale * v * ease + shift * de,
        scale * a * ease + 2 * scale * v * de + shift * dde,
    )


def _ease(time: Signal) -> Path:
    length = 0.6
    end = time[-1]
    up, down = np.clip(time / length, 0, 1), np.clip((end - time) / length, 0, 1)
    rise = [_quintic(up), _quintic(down)]
    ease = rise[0][0] * rise[1][0]
    de = (rise[0][1] * rise[1][0] - rise[0][0] * rise[1][1]) / length
    dde = (rise[0][2] * rise[1][0] + rise[0][0] * rise[1][2]) / length**2
    return ease, de, dde


def _quintic(x: Signal) -> Path:
    return (
        x**3 * (10 - 15 * x + 6 * x**2),
        30 * x**2 * (1 - x) ** 2,
        60 * x * (1 - 3 * x + 2 * x**2),
    )


def _pieces(
    time: Signal, points: list[float], spans: list[float], rests: list[float], trapezoid: bool
) -> Path:
    """Move from point to point, each in its span (s), with a rest (s) after each."""
    q, v, a = np.full_like(time, points[0]), np.zeros_like(time), np.zeros_like(time)
    start = 0.4
    for first, last, span, rest in zip(points, points[1:], spans, rests, strict=False):
        inside = (time >= start) & (time < start + span)
        x, way = (time[inside] - start) / span, last - first
        if trapezoid:
            edge = 0.2
            top = 1 / (1 - edge)
            q[inside] = first + way * np.where(
                x < edge,
                top * x**2 / (2 * edge),
                np.where(x > 1 - edge, 1 - top * (1 - x) ** 2 / (2 * edge), top * (x - edge / 2)),
            )
            v[inside] = way / span * top * np.minimum(1, np.minimum(x, 1 - x) / edge)
            a[inside] = way / span**2 * top / edge * ((x < edge) * 1.0 - (x > 1 - edge) * 1.0)
        else:
            form = _quintic(x)
            q[inside], v[inside], a[inside] = (
                first + way * form[0],
                way / span * form[1],
                way / span**2 * form[2],
            )
        start += span
        q[time >= start] = last
        start += rest
    return q, v, a


def _points(rng: np.random.Generator, low: float, high: float, count: int) -> list[float]:
    """Points that alternate between both halves of the range."""
    width = high - low
    return [
        low + width * rng.uniform(0.03, 0.35) if n % 2 else high - width * rng.uniform(0.03, 0.35)
        for n in range(count)
    ]


def trapezoid(rng: np.random.Generator, time: Signal, low: float, high: float, pace: float) -> Path:
    """Trapezoidal speed from point to point."""
    return _to_and_fro(rng, time, low, high, pace, trapezoidal=True)


def minimum_jerk(
    rng: np.random.Generator, time: Signal, low: float, high: float, pace: float
) -> Path:
    """Reaching from point to point."""
    return _to_and_fro(rng, time, low, high, pace, trapezoidal=False)


def _to_and_fro(
    rng: np.random.Generator,
    time: Signal,
    low: float,
    high: float,
    pace: float,
    *,
    trapezoidal: bool,
) -> Path:
    count = 40
    points = _points(rng, low, high, count)
    spans = [abs(b - a) / pace / rng.uniform(0.6, 1.0) for a, b in pairwise(points)]
    rests = [float(x) for x in rng.uniform(0.0, 0.4, count)]
    return _pieces(time, points, [max(x, 0.15) for x in spans], rests, trapezoidal)


def ramp(rng: np.random.Generator, time: Signal, low: float, high: float, pace: float) -> Path:
    """A slow ramp to and fro at constant speed."""
    span = (time[-1] - 1.0) / 2
    width = min(high - low, 0.2 * max(pace, 0.4) * span)
    start = rng.uniform(low, high - width)
    points = (
        [start, start + width, start]
        if rng.random() < 0.5
        else [start + width, start, start + width]
    )
    return _pieces(time, points, [span, span], [0.1, 0.1], True)


def stretch(rng: np.random.Generator, time: Signal, low: float, high: float, pace: float) -> Path:
    """What a clinician does: a slow return, a wait, a fast stretch, a wait."""
    points, spans, rests = [low + 0.1 * (high - low)], [], []
    for _ in range(20):
        points += [
            high - rng.uniform(0.02, 0.25) * (high - low),
            low + rng.uniform(0.02, 0.2) * (high - low),
        ]
        far = abs(points[-2] - points[-3])
        spans += [max(0.2, far / (2.2 * pace)), max(0.8, far / (0.6 * pace))]
        rests += [float(rng.uniform(0.3, 0.7)), float(rng.uniform(0.3, 1.0))]
    return _pieces(time, points, spans, rests, False)


def still(rng: np.random.Generator, time: Signal, low: float, high: float, pace: float) -> Path:
    """Hold a position."""
    del pace
    return np.full_like(time, rng.uniform(low, high)), np.zeros_like(time), np.zeros_like(time)


MOTIONS: dict[str, Callable[[np.random.Generator, Signal, float, float, float], Path]] = {
    "multisine": multisine,
    "trapezoid": trapezoid,
    "minimum_jerk": minimum_jerk,
    "ramp": ramp,
    "stretch": stretch,
    "still": still,
}
