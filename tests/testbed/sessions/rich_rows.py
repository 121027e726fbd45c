"""Rows of an elbow that needs a further torque, and terms that explain it."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from analysis.closeloop.identification.balance.model import unfitted
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.rich import ELBOW

#: Of the effort, Nm.
NOISE = 0.005


def candidate(name: str) -> Candidate:
    return Candidate(effect=BY_NAME[name], joint=ELBOW)


def torque(elbow: Recording, name: str, theta: Mapping[str, float], *size: float) -> np.ndarray:
    return BY_NAME[name].columns(unfitted(elbow, ELBOW), theta)[ELBOW] @ np.array(size)


def rows_with(elbow: Recording, extra: np.ndarray) -> Rows:
    """Return the rows of a recording whose elbow needs a further torque, weighted by its noise."""
    effort = np.array(elbow.inverse)
    effort[:, ELBOW] += extra + NOISE * np.random.default_rng(5).standard_normal(len(effort))
    loud = replace(elbow, effort=elbow.filtered(effort), cache={})
    return select_rows(loud, (0,)).reweighted({ELBOW: NOISE})


def term(rows: Rows, name: str, theta: Mapping[str, float]) -> Term:
    columns = BY_NAME[name].columns(unfitted(rows.recording, ELBOW), theta)
    kept = tuple(range(columns[ELBOW].shape[1]))
    return Term(
        joint=ELBOW,
        columns=columns,
        lower=BY_NAME[name].lower,
        kept=kept,
        theta=theta,
        effect=BY_NAME[name],
        candidate=candidate(name),
    )
