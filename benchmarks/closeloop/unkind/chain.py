"""Measuring chains: what encoders, current sensors, filters, buses and loggers make of a motion."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Signal = NDArray[np.float64]

SENSORS = ("laboratory", "industrial", "hobby", "filtered", "coloured", "command")
TIMINGS = ("regular", "jitter", "stamps", "dropped", "bursts", "duplicated", "held")
#: Timings that lose samples.
LOSING = ("dropped", "bursts")


@dataclass(frozen=True, kw_only=True)
class Chain:
    """How a joint is measured; shares are of the effort's RMS."""

    sensor: str
    timing: str
    rate: float
    #: Encoder, rad.
    encoder: float
    noise: float
    #: Least count of the effort.
    least_count: float
    #: Autoregression of the noise on the sample before, and the share of 1/f noise in it.
    memory: float
    pink: float
    #: Low-pass in the effort channel, declared; 0 for none.
    filter_hz: float
    #: Nm per A where the log holds currents; 0 for torque.
    per_ampere: float
    #: Low-pass of the robot's own speed estimate, if the log has one; 0 if not.
    speed_hz: float
    #: Share of samples that the timing concerns, or of the period that a stamp may be wrong by.
    share: float


def draw_chain(rng: np.random.Generator) -> Chain:
    """Draw a chain."""
    u = rng.uniform
    sensor = str(rng.choice(SENSORS))
    timing = str(rng.choice(TIMINGS, p=(0.25, 0.12, 0.1, 0.2, 0.15, 0.08, 0.1)))
    bits = {"laboratory": 20, "industrial": u(16, 19), "hobby": 12, "command": u(16, 18)}
    noise = {"laboratory": u(0.003, 0.01), "hobby": u(0.02, 0.05), "command": 0.0}
    count = {"laboratory": 0.0, "industrial": u(0.01, 0.02), "hobby": u(0.02, 0.06)}
    share = {
        "regular": 0.0,
        "jitter": u(0.02, 0.2),
        "stamps": u(0.01, 0.05),
        "dropped": float(np.exp(u(np.log(0.01), np.log(0.2)))),
        "bursts": float(np.exp(u(np.log(0.01), np.log(0.2)))),
        "duplicated": u(0.001, 0.008),
        "held": u(0.003, 0.02),
    }
    return Chain(
        sensor=sensor,
        timing=timing,
        rate=100.0 if sensor == "hobby" else float(rng.choice([100.0, 125.0, 200.0, 250.0])),
        encoder=float(2 * np.pi / 2 ** bits.get(sensor, 17)),
        noise=float(noise.get(sensor, u(0.01, 0.03))),
        least_count=float(count.get(sensor, u(0.003, 0.01))),
        memory=float({"industrial": u(0.5, 0.9), "coloured": u(0.3, 0.8)}.get(sensor, 0.0)),
        pink=float(u(0.4, 0.9)) if sensor == "coloured" else 0.0,
        filter_hz=float(u(10.0, 40.0)) if sensor == "filtered" else 0.0,
        per_ampere=float(u(0.05, 12.0)) if sensor in ("industrial", "hobby") else 0.0,
        speed_hz=float(u(15.0, 50.0)) if rng.random() < 0.3 else 0.0,
        share=float(share[timing]),
    )


def low_pass(signal: Signal, hertz: float, step: float) -> Signal:
    """Return a signal behind a first-order low-pass that had settled before it began."""
    keep = float(np.exp(-2 * np.pi * hertz * step))
    start = np.atleast_1d(signal[0] * keep)
    return np.asarray(lfilter([1 - keep], [1, -keep], signal, zi=start)[0])


def effort_noise(chain: Chain, rms: float, count: int, rng: np.random.Generator) -> Signal:
    """Return noise of a channel, samples in a row at the chain's rate."""
    white = rng.normal(0, 1, count)
    if chain.memory:
        gain = np.sqrt(1 - chain.memory**2)
        white = np.asarray(lfilter([gain], [1, -chain.memory], white))
    if chain.pink:
        spectrum = np.fft.rfft(rng.normal(0, 1, 2 * count))
        hertz = np.fft.rfftfreq(2 * count, 1 / chain.rate)
        spectrum *= 1 / np.sqrt(np.maximum(hertz, 0.05))
        slow = np.fft.irfft(spectrum)[:count]
        white = np.sqrt(1 - chain.pink**2) * white + chain.pink * slow / np.std(slow)
    return np.asarray(chain.noise * rms * white)


def stamps(chain: Chain, seconds: float, rng: np.random.Generator) -> tuple[Signal, Signal]:
    """Return when samples are taken, and what their stamps say, s from a trial's beginning."""
    taken = np.arange(0.0, seconds - 1.5 / chain.rate, 1 / chain.rate)
    if chain.timing == "jitter":
        taken = taken + np.clip(rng.normal(0, chain.share, len(taken)), -0.4, 0.4) / chain.rate
        taken = np.sort(np.clip(taken, 0, None))
        return taken, taken
    if chain.timing == "stamps":
        wrong = np.clip(rng.normal(0, chain.share, len(taken)), -0.3, 0.3) / chain.rate
        return taken, taken + wrong
    return taken, taken


def logged(chain: Chain, table: Signal, rng: np.random.Generator) -> Signal:
    """Return the lines that a logger keeps of a table with stamps in its first column."""
    count = len(table)
    keep = np.ones(count, dtype=bool)
    match chain.timing:
        case "dropped":
            keep = rng.random(count) >= chain.share
        case "bursts":
            while np.mean(keep) > 1 - chain.share:
                start, length = rng.integers(5, count - 5), rng.integers(3, 30)
                keep[start : start + length] = False
        case "duplicated":
            again = np.sort(
                np.append(np.arange(count), rng.choice(count, int(chain.share * count)))
            )
            return table[again]
        case "held":
            frozen = np.flatnonzero(rng.random(count - 1) < chain.share) + 1
            table = table.copy()
            for row in frozen:
                table[row, 1:] = table[row - 1, 1:]
    keep[[0, -1]] = True
    return table[keep]


def quantised(signal: Signal, least: float) -> Signal:
    """Return a signal in whole steps of `least`; as it is for 0."""
    return np.round(signal / least) * least if least > 0 else signal
