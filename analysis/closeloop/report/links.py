"""Links that are others than declared: mass and centre of mass with intervals, for the report."""

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.stats import t

from analysis.closeloop.identification.links import links_of
from analysis.closeloop.identification.model import Model
from analysis.closeloop.identification.regression import Rows
from analysis.closeloop.identification.uncertainty import CONFIDENCE
from analysis.closeloop.identification.whole_fit import WholeFit
from sim.effects.inertia import PLACE

#: Parts of every trial that are left out in turn.
PARTS = 10
#: A value whose spread over strengths of the prior is this many of its intervals is the prior's.
INERTIA = ("xx", "yy", "zz", "xy", "xz", "yz")


def link_parameters(model: Model, rows: Rows) -> dict[str, Any]:
    """Return mass and centre of mass of every link, with 90 % intervals.

    An interval is the wider of two jackknifes: by parts of time, and by joints, since what a model
    lacks at one joint does not average out over time.
    """
    links = links_of(model.recording)
    fit = WholeFit(replace(model, given=None), rows, links)
    terms = range(len(model.terms))
    assert model.given is not None
    found = _described(np.array([model.given.links[name] for name in links.names]))
    half = np.zeros_like(found)
    for clusters in (_times(rows), rows.joint_of_block[rows.block]):
        numbers = np.unique(clusters)
        without = [
            _described(links.declared + fit.links_without(terms, np.flatnonzero(clusters == n)))
            for n in numbers
        ]
        moved = np.array(without) - found
        variance = (len(numbers) - 1) / len(numbers) * (moved**2).sum(axis=0)
        half = np.maximum(half, t.ppf((1 + CONFIDENCE) / 2, len(numbers) - 1) * np.sqrt(variance))
    entries = {}
    for name, values, widths in zip(links.names, found, half, strict=True):
        for word, unit, value, width in zip(
            ("mass", *PLACE), ("kg", "m", "m", "m"), values, widths, strict=True
        ):
            low = max(value - width, 0.0) if word == "mass" else value - width
            entries[f"{name}.{word}"] = {
                "value": value,
                "ci90": [low, value + width],
                "unit": unit,
            }
    return entries


def _described(parameters: np.ndarray) -> np.ndarray:
    """Return mass and centre of mass of inertial parameters, (links, 4)."""
    return np.column_stack([parameters[:, 0], parameters[:, 1:4] / parameters[:, :1]])


def _times(rows: Rows) -> np.ndarray:
    """Return each row's part of the time that the session took, (r,)."""
    clock = np.concatenate([rows.recording.time[own] for own in rows.samples.values()])
    edges = np.quantile(clock, np.linspace(0.0, 1.0, PARTS + 1)[1:-1])
    return np.asarray(np.searchsorted(edges, clock))


def link_values(model: Model) -> dict[str, Any]:
    """Return the inertial parameters of every link, about the origin of its frame."""
    given = {} if model.given is None else model.given.links
    return {
        name: {
            "mass": values[0],
            "first_moments": list(values[1:4]),
            "inertia": dict(zip(INERTIA, values[4:].tolist(), strict=True)),
            "units": "kg, kg m and kg m2, about the origin of the body's frame",
        }
        for name, values in given.items()
    }
