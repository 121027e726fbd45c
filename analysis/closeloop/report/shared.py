"""What joints share, in the contract's words: links other than declared, and declared payloads.

Intervals are those of `identification.arms.spread`.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy.stats import t

from analysis.closeloop.contract import CONFIDENCE
from analysis.closeloop.identification.arms.links import PARAMETERS, freed_links, links_of
from analysis.closeloop.identification.arms.spread import NO_MASS, Spread, mass_and_place
from analysis.closeloop.identification.arms.whole_fit import WholeFit
from analysis.closeloop.identification.balance.declared import PLACED
from analysis.closeloop.identification.balance.model import Model
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.findings import Carried
from analysis.closeloop.session.recording import Recording
from sim.effects.laws.inertia import OWN_INERTIA, PLACE

INERTIA = ("xx", "yy", "zz", "xy", "xz", "yz")
GAINS = (
    "the mass scales with the gains that turned currents into efforts: gains that are 1 % too "
    "large make it 1 % too large; its place does not change"
)
#: By less, as a share of its mass or in m, a link is as declared: what no joint feels stays so but
#: for rounding.
AS_DECLARED = 1e-6
#: Why a load has no place.
MASSLESS = "the load may have no mass"
#: An interval that is so many times the device's reach has numbers that mean nothing.
UNTOLD = 100.0
#: Of a load whose moments are told and whose mass comes out as none.
WEIGHTLESS = (
    "these trials show its moments (mass times place), and no mass fits them: they contain what is "
    "wrong with the links; close the loop without its trials first, and take that session's "
    "model_after.xml as the model"
)


def link_parameters(model: Model, rows: Rows) -> dict[str, Any]:
    """Return what of links' mass and centre of mass is other than declared, with 90 % intervals.

    What no joint feels of a link (of a turret that turns about an upright axis, its mass) stays as
    it is declared in every fit: its interval would have no width, as if it had been measured.

    A mass that could be none has no value, nor has its centre: a joint feels moments, and of a link
    near its axis they say little of the mass (Khalil and Dombre 2002, Modeling, identification and
    control of robots, chapter 9, on base parameters). `repaired` has what was fitted all the same.
    """
    links = freed_links(model, links_of(model.recording))
    fit = WholeFit(replace(model, given=None), rows, links)
    spread = Spread(fit, links=True)
    assert model.given is not None
    found = _described(np.array([model.given.links[name] for name in links.names]))
    every = [_described(links.declared + changes) for _, changes in spread.fits]
    change = np.array([model.given.changes[body] for body in links.bodies])
    half = np.hypot(spread.half_width(found, every), _drawn(found, *fit.drawn(change)))
    moved = other_than(found, _described(links.declared))
    return {
        f"{name}.{word}": entry
        for name, values, widths, other in zip(links.names, found, half, moved, strict=True)
        for (word, entry), apart in zip(_link(values, widths).items(), other, strict=True)
        if apart
    }


def _drawn(described: np.ndarray, covariance: np.ndarray, freedom: float) -> np.ndarray:
    """Return half of the 90 % intervals of mass and centre that a covariance makes, (links, 4).

    Args:
        described: mass (kg) and centre (m), (links, 4).
        covariance: of the links' inertial parameters, (10 links, 10 links).
        freedom: how many numbers tell its size.
    """
    found = np.empty_like(described)
    for number, (mass, *place) in enumerate(described):
        first = PARAMETERS * number
        own = covariance[first : first + 4, first : first + 4]
        # The centre is the first moments over the mass.
        slope = np.diag([1.0, *np.full(3, 1.0 / mass)])
        slope[1:, 0] = -np.array(place) / mass
        found[number] = np.sqrt(np.diag(slope @ own @ slope.T))
    return float(t.ppf((1 + CONFIDENCE) / 2, freedom)) * found


def other_than(found: np.ndarray, declared: np.ndarray) -> np.ndarray:
    """Return which of mass (kg) and centre (m) of links are not as declared, all (links, 4)."""
    apart = np.abs(found - declared)
    apart[:, 0] /= declared[:, 0]
    return np.asarray(apart > AS_DECLARED)


def _link(values: np.ndarray, widths: np.ndarray) -> dict[str, dict[str, Any]]:
    """Return the entries of one link: mass and centre, (4,), and half of their intervals."""
    units = dict(zip(("mass", *PLACE), ("kg", "m", "m", "m"), strict=True))
    mass, width = values[0], widths[0]
    if width >= mass:
        why = (
            f"its 90 % interval, {mass - width:.3g} to {mass + width:.3g} kg, holds a link without "
            "mass: only moments of the link are known, not its mass and centre"
        )
        unknown = {
            word: {"value": None, "ci90": None, "unit": unit} for word, unit in units.items()
        }
        unknown["mass"]["refused"] = why
        return unknown
    return {
        word: {"value": value, "ci90": [value - half, value + half], "unit": unit}
        for (word, unit), value, half in zip(units.items(), values, widths, strict=True)
    }


def _described(parameters: np.ndarray) -> np.ndarray:
    """Return mass and centre of mass of inertial parameters, (..., 4)."""
    mass = parameters[..., :1]
    return np.concatenate([mass, parameters[..., 1:4] / mass], axis=-1)


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


def unnamed_load_entries(recording: Recording, loads: Sequence[Carried]) -> list[dict[str, Any]]:
    """Return the loads that trials seem to carry without naming them."""
    entries: list[dict[str, Any]] = []
    names: dict[tuple[float, ...], str] = {}
    for load in loads:
        trial = recording.session.trials[load.trial]
        # One load of several trials has one name.
        name = names.setdefault(tuple(load.value), f"load {len(names) + 1}")
        reach = recording.reach(load.joint)
        entries.append(
            {
                "file": trial.file,
                "from": float(trial.time[0]),
                "to": float(trial.time[-1]),
                "body": load.body,
                "name": name,
                "mass": mass_entry(load.value[0], load.half[0]),
                "position": place_entry(load.value, load.half, load.felt, reach),
                "moments": moments_entry(load),
                "takes": load.share,
                "fitted": load.fitted,
            }
        )
    return entries


def mass_entry(mass: float, half: float) -> dict[str, Any]:
    """Return the entry of a mass; without a value where the load may have none."""
    low, high = mass - half, mass + half
    if low > 0.0:
        return {"value": float(mass), "ci90": [float(low), float(high)], "unit": "kg"}
    why = (
        f"its 90 % interval ends at {high:.3g} kg and holds a load without mass: only its moments "
        "are known"
    )
    return {"value": None, "ci90": None, "unit": "kg", "refused": why}


def moments_entry(load: Carried) -> dict[str, Any]:
    """Return the entry of a load's first moments: null where no joint feels them."""
    known = [number in load.felt for number in (1, 2, 3)]
    both = zip(known, load.moments.tolist(), load.half_moments.tolist(), strict=True)
    intervals = [[value - half, value + half] if felt else None for felt, value, half in both]
    return {
        "value": [
            value if felt else None
            for felt, value in zip(known, load.moments.tolist(), strict=True)
        ],
        "ci90": intervals,
        "unit": "kg m",
    }


def of_unnamed_loads(entries: Sequence[Mapping[str, Any]], *, lone: bool = False) -> list[str]:
    """Return a warning for every load that a trial seems to carry, with what to declare.

    Args:
        entries: the loads.
        lone: whether one joint alone shows them.
    """
    gain = ", unless its efforts have another factor, which one joint does not tell from it" * lone
    return [
        f"{entry['file']}: it looks as if {_weight(entry)} hung at {entry['body']} that other "
        f"trials do not carry{gain}; "
        f'if so, give the trial "payload": {{"name": "{entry["name"]}", '
        f'"body": "{entry["body"]}"}} and close the loop again: '
        + (
            "the errors here, before and after, allow for it"
            if entry["fitted"]
            else "until then its errors are wrong"
        )
        for entry in entries
    ]


def _weight(entry: Mapping[str, Any]) -> str:
    """Say how heavy a load is, or what is known instead."""
    mass = entry["mass"]
    if mass["value"] is not None:
        low, high = mass["ci90"]
        return f"some {mass['value']:.2g} kg ({low:.2g} to {high:.2g})"
    felt = [value for value in entry["moments"]["value"] if value is not None]
    return f"a load of {np.linalg.norm(felt):.2g} kg m, of unknown mass,"


def payload_entries(
    fits: tuple[tuple[Model, np.ndarray], tuple[Model, np.ndarray]], rows: Rows
) -> list[dict[str, Any]]:
    """Return mass and place of every payload that trials name, before and after the repair."""
    if not any(term.load and not term.load.supposed for term in fits[0][0].terms):
        return []
    before, after = (_payloads(model, coefficients, rows) for model, coefficients in fits)
    entries = []
    for (name, body), values in after.items():
        old = before[name, body]
        parameters = {
            key: {**entry, "before": old[key]["value"], "ci90_before": old[key]["ci90"]}
            for key, entry in values.items()
        }
        entry = {"effect": PLACED.name, "name": name, "body": body, "parameters": parameters}
        entries.append(entry | {"depends_on": GAINS})
    return entries


def _payloads(
    model: Model, coefficients: np.ndarray, rows: Rows
) -> dict[tuple[str, str], dict[str, Any]]:
    links = freed_links(model, links_of(model.recording))
    fit = WholeFit(replace(model, given=None), rows, links)
    spread = Spread(fit, links=model.given is not None)
    found = {}
    for number, (term, own) in enumerate(model.split(coefficients)):
        if term.load is None or term.load.supposed:
            continue
        value = mass_and_place(model, term, own[None])[0]
        half = spread.of_term(number, own, partial(mass_and_place, model, term))
        mass = float(value[0]) if value[0] > NO_MASS else 0.0
        felt = bool(np.any(np.abs(own) > spread.of_term(number, own, lambda fits: fits)))
        found[term.load.name, term.load.body] = {
            "mass": payload_mass(mass, float(half[0]), felt=felt),
            "position": place_entry(value, half, term.kept, model.recording.reach(term.joint)),
            "inertia": _inertia_entry(
                term.kept, own, spread.of_term(number, own, lambda fits: fits)
            ),
        }
    return found


def payload_mass(mass: float, half: float, *, felt: bool) -> dict[str, Any]:
    """Return the entry of a payload's mass: null where it is none and its moments are not.

    Args:
        mass: kg.
        half: of its interval, kg.
        felt: whether these trials show the load at all.
    """
    if felt and mass == 0.0:
        return {"value": None, "ci90": None, "unit": "kg", "refused": WEIGHTLESS}
    return {"value": mass, "ci90": [max(mass - half, 0.0), mass + half], "unit": "kg"}


def _inertia_entry(kept: Sequence[int], own: np.ndarray, half: np.ndarray) -> dict[str, Any]:
    """Return the entry of a payload's own inertia; without a value where no trial tells it.

    Args:
        kept: columns of the payload that were fitted.
        own: their coefficients.
        half: of their intervals.
    """
    if OWN_INERTIA not in kept:
        why = "these trials do not determine it: a point mass was fitted"
        return {"value": None, "ci90": None, "unit": "kg m2", "refused": why}
    value, width = float(own[-1]), float(half[-1])
    return {"value": value, "ci90": [max(value - width, 0.0), value + width], "unit": "kg m2"}


def place_entry(
    value: np.ndarray, half: np.ndarray, felt: Collection[int], reach: float
) -> dict[str, Any]:
    """Return the entry of a payload's place: null where these trials do not determine it.

    Args:
        value: mass and place, (4,).
        half: of their intervals, (4,).
        felt: numbers of those that some joint feels.
        reach: how far the device can be, m.
    """
    low, high = value - half, value + half
    unknown = dict.fromkeys((1, 2, 3), MASSLESS) if low[0] <= NO_MASS else {}
    for number, name in enumerate(PLACE, start=1):
        if number in unknown:
            continue
        if number not in felt:
            unknown[number] = f"{name}: no joint feels it"
        elif high[number] - low[number] > UNTOLD * reach:
            unknown[number] = f"{name}: these trials do not determine it"
        elif high[number] - low[number] > 2.0 * reach:
            unknown[number] = (
                f"{name}: its 90 % interval, {low[number]:.2g} to {high[number]:.2g} m, is wider "
                "than the device reaches"
            )
    known = [None if number in unknown else float(value[number]) for number in (1, 2, 3)]
    entry: dict[str, Any] = {
        "value": known,
        "ci90": [
            None if number in unknown else [float(low[number]), float(high[number])]
            for number in (1, 2, 3)
        ],
        "unit": "m",
    }
    return entry | ({"refused": "; ".join(dict.fromkeys(unknown.values()))} if unknown else {})


def undetermined_loads(entries: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a warning for every declared payload whose mass or place is not determined."""
    warnings = []
    for entry in entries:
        if why := entry["parameters"].get("mass", {}).get("refused"):
            warnings.append(f"payload {entry['name']}: its mass is not determined ({why})")
        elif why := entry["parameters"].get("position", {}).get("refused"):
            warnings.append(
                f"payload {entry['name']}: not every coordinate of its place is determined ({why})"
            )
    return warnings
