"""All trials as arrays at the working rate: what residual, effects and ceiling come from."""

import itertools
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from analysis.closeloop.errors import SessionError
from analysis.closeloop.session.device import Device
from analysis.closeloop.session.reading import SESSION_FILE, AddedMass, Session
from analysis.closeloop.session.signals import (
    REST_SHARE,
    Sampling,
    Stretch,
    choose_sampling,
    derivatives,
    extra_columns,
    lowpass,
    stretches,
)

#: Of how many samples one is computed of what depends on position only.
REST_STEP = 4


@dataclass(frozen=True, kw_only=True)
class Recording:
    """Signals of all trials, one after the other: arrays (n, joints) unless said otherwise."""

    device: Device
    session: Session
    sampling: Sampling
    pieces: list[Stretch]
    #: Where each piece lies in the arrays.
    slices: list[slice]
    #: Trial number of each sample, (n,).
    trial: np.ndarray
    #: Session clock, s, (n,).
    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    #: Low-passed for the fit; NaN where a joint has none.
    effort: np.ndarray
    #: (n, extra columns), NaN where a trial lacks it.
    extra: np.ndarray
    extra_names: tuple[str, ...]
    #: Joints (column numbers) whose balance is analysed.
    joints: tuple[int, ...]
    #: Trials that may be fitted.
    fit_trials: tuple[int, ...]
    #: Inverse dynamics are asked for again and again with the same arguments.
    cache: dict[tuple[object, ...], np.ndarray] = field(default_factory=dict, repr=False)

    @property
    def rate(self) -> float:
        return self.sampling.working

    @cached_property
    def inverse(self) -> np.ndarray:
        """Torque that the declared chain needs, declared Coulomb friction included."""
        sign = np.tanh(self.velocity / (0.5 * self.rest_speed))
        return np.asarray(self.rigid + self.device.friction * sign)

    @cached_property
    def rigid(self) -> np.ndarray:
        """Torque that the declared chain needs without Coulomb friction."""
        return self._inverse(self.position, self.velocity, self.acceleration)

    @cached_property
    def static(self) -> np.ndarray:
        """Torque that holding still in the same place would take: gravity and declared springs."""
        return self._at_rest(self.position)

    def secant(self, joint: int, step: float) -> np.ndarray:
        """Change of every static torque over `step` of one joint's position, (n, joints)."""
        key = ("secant", joint, step)
        if key not in self.cache:
            moved = self.position.copy()
            moved[:, joint] += step
            self.cache[key] = (self._at_rest(moved) - self.static) / step
        return self.cache[key]

    @cached_property
    def own_inertia(self) -> np.ndarray:
        """Diagonal of the mass matrix, kg m2 or kg; NaN at joints that are not analysed."""
        found = np.full_like(self.position, np.nan)
        for joint in self.joints:
            found[:, joint] = (self._at_rest(self.position, joint) - self.static)[:, joint]
        return found

    def carried(self, body: str, position: np.ndarray) -> np.ndarray:
        """Return the torque that one more kilogram at `position` of `body` needs."""
        key = ("carried", body, *position)
        if key not in self.cache:
            mass = AddedMass(body=body, mass=1.0, position=(position[0], position[1], position[2]))
            motion = self.position, self.velocity, self.acceleration
            self.cache[key] = self._inverse(*motion, extra=(mass,)) - self.rigid
        return self.cache[key]

    @cached_property
    def top_speed(self) -> np.ndarray:
        """Speed that 1 % of the samples exceed, (joints,); tiny but positive for a held joint."""
        fastest = np.quantile(np.abs(self.velocity), 0.99, axis=0)
        return np.asarray(np.maximum(fastest, 1e-9))

    @cached_property
    def rest_speed(self) -> np.ndarray:
        return np.asarray(REST_SHARE * self.top_speed)

    def filtered(self, columns: np.ndarray) -> np.ndarray:
        """Pass columns (n, ...) through the fit's low-pass, piece by piece."""
        out = np.empty_like(columns)
        for piece in self.slices:
            out[piece] = lowpass(columns[piece], self.sampling.fit_cutoff, self.rate)
        return out

    def _at_rest(self, position: np.ndarray, accelerated: int | None = None) -> np.ndarray:
        """Return the torque at rest, or with one joint accelerated by 1: of `position` only.

        Position changes slowly, so every fourth sample and a cubic spline give all of them.
        """
        where = []
        for piece in self.slices:
            rows = np.arange(piece.start, piece.stop, REST_STEP)
            if rows[-1] != piece.stop - 1:
                rows = np.append(rows, piece.stop - 1)
            where.append(rows)
        every = np.concatenate(where)
        still = np.zeros((len(every), position.shape[1]))
        pushed = still.copy()
        if accelerated is not None:
            pushed[:, accelerated] = 1.0
        thin_torque = self._inverse(position[every], still, pushed, rows=every)
        torque, start = np.empty_like(position), 0
        for piece, rows in zip(self.slices, where, strict=True):
            thin = thin_torque[start : start + len(rows)]
            start += len(rows)
            torque[piece] = CubicSpline(rows, thin)(np.arange(piece.start, piece.stop))
        return torque

    def _inverse(
        self,
        position: np.ndarray,
        velocity: np.ndarray,
        acceleration: np.ndarray,
        extra: tuple[AddedMass, ...] = (),
        rows: np.ndarray | slice = slice(None),
    ) -> np.ndarray:
        """Inverse dynamics of the samples `rows`, each trial with the masses it carried."""
        torque = np.empty_like(position)
        trials = self.trial[rows]
        for number, trial in enumerate(self.session.trials):
            own = trials == number
            if own.any():
                masses = (*((trial.added_mass,) if trial.added_mass else ()), *extra)
                torque[own] = self.device.inverse_dynamics(
                    position[own], velocity[own], acceleration[own], masses=masses
                )
        return torque


def record(session: Session, device: Device) -> Recording:
    """Bring a session's trials to one clock and differentiate them.

    Raises:
        SessionError: no joint both moves and has an effort in the trials that may be fitted.
    """
    pieces, rate = stretches(session.trials, device)
    fit_trials = tuple(i for i, trial in enumerate(session.trials) if trial.role == "fit")
    if not any(piece.trial in fit_trials for piece in pieces):
        raise SessionError(
            "no trial has half a second of samples without a gap", file=session.trials[0].file
        )
    moving = np.zeros(len(device.joints), dtype=bool)
    measured = np.zeros(len(device.joints), dtype=bool)
    for piece in pieces:
        if piece.trial in fit_trials:
            moving |= np.ptp(piece.position, axis=0) > MOVING
            measured |= ~np.isnan(piece.effort).any(axis=0)
    joints = tuple(int(joint) for joint in np.flatnonzero(moving & measured))
    if not joints:
        raise SessionError(
            "no joint with a recorded effort moves; excite at least one joint", file=SESSION_FILE
        )
    sampling = choose_sampling(pieces, rate, moving)
    parts = [derivatives(piece.position, sampling) for piece in pieces]
    lengths = [len(part[0]) for part in parts]
    starts = np.concatenate([[0], np.cumsum(lengths)])
    every = slice(None, None, sampling.decimation)
    return Recording(
        device=device,
        session=session,
        sampling=sampling,
        pieces=pieces,
        slices=[slice(int(a), int(b)) for a, b in itertools.pairwise(starts)],
        trial=np.repeat([piece.trial for piece in pieces], lengths),
        time=np.concatenate([piece.time[every] for piece in pieces]),
        position=np.concatenate([part[0] for part in parts]),
        velocity=np.concatenate([part[1] for part in parts]),
        acceleration=np.concatenate([part[2] for part in parts]),
        effort=np.concatenate(
            [lowpass(piece.effort, sampling.fit_cutoff, rate)[every] for piece in pieces]
        ),
        extra=np.concatenate([piece.extra[every] for piece in pieces]),
        extra_names=extra_columns(session.trials, device),
        joints=joints,
        fit_trials=fit_trials,
    )


#: Least travel of a moving joint, rad or m: above what an encoder's last digits do.
MOVING = 5e-3
