"""What the bench prints: figures with their number of sessions and 90 % Wilson intervals."""

from collections.abc import Callable, Iterable, Sequence
from math import sqrt

import numpy as np

from benchmarks.closeloop.unkind.chain import LOSING, SENSORS, TIMINGS
from benchmarks.closeloop.unkind.judge import Outcome

#: Half width of a 90 % interval in standard deviations.
Z = 1.645


def wilson(hits: int, count: int) -> tuple[float, float]:
    """Return a 90 % interval of a share (Wilson 1927, JASA 22, 209-212)."""
    share, weight = hits / count, Z * Z / count
    middle = (share + weight / 2) / (1 + weight)
    half = Z / (1 + weight) * sqrt(share * (1 - share) / count + weight / (4 * count))
    return max(0.0, middle - half), min(1.0, middle + half)


def names(outcome: Outcome) -> list[str]:
    """Return the names that it answered, without joints."""
    return [name for name, _ in outcome.names]


def truths(outcome: Outcome) -> list[str]:
    """Return the names that are true, without joints."""
    return [name for name, _ in outcome.truth]


def unnamed(outcome: Outcome) -> bool:
    """Say whether it was called unexplained, or external, and nothing of the catalogue."""
    return outcome.verdict == "unexplained" or set(names(outcome)) == {"external"}


#: Figure: over which sessions with a limb, and what counts.
Figure = tuple[str, Callable[[Outcome], bool], Callable[[Outcome], bool]]
LIMB: tuple[Figure, ...] = (
    ("names on clean", lambda o: o.kind == "clean", lambda o: bool(o.names)),
    ("clean called adequate", lambda o: o.kind == "clean", lambda o: o.verdict == "adequate"),
    ("detection", lambda o: o.kind == "one", lambda o: o.verdict != "adequate"),
    ("first name right", lambda o: o.kind == "one", lambda o: names(o)[:1] == truths(o)),
    ("in the set", lambda o: o.kind == "one", lambda o: truths(o)[0] in o.returned),
    ("both of two", lambda o: o.kind == "two", lambda o: set(truths(o)) <= set(names(o))),
    ("all of three", lambda o: o.kind == "three", lambda o: set(truths(o)) <= set(names(o))),
    (
        "a name that is false",
        lambda o: o.kind in ("one", "two", "three"),
        lambda o: not set(names(o)) <= set(truths(o)),
    ),
    ("outside: unexplained", lambda o: o.kind == "outside", unnamed),
    ("pushes: unexplained", lambda o: o.kind == "push", unnamed),
    ("pushes: all with time", lambda o: o.kind == "push", lambda o: o.found_pushes == o.pushes),
    ("K made worse", lambda o: bool(o.names) and o.after is not None, lambda o: _worse(o)),
    ("90 % intervals of K", lambda o: _answered(o), lambda o: bool(o.covered)),
)
ARM: tuple[Figure, ...] = (
    ("clean with a name", lambda o: o.kind == "clean", lambda o: bool(o.names)),
    ("detection", lambda o: bool(o.truth), lambda o: o.verdict != "adequate"),
    ("cases wholly right", lambda o: bool(o.truth), lambda o: set(o.names) == set(o.truth)),
    ("pushes: unexplained", lambda o: o.kind == "push", unnamed),
    ("pushes: all with time", lambda o: o.kind == "push", lambda o: o.found_pushes == o.pushes),
)


def _worse(o: Outcome) -> bool:
    return o.after is not None and o.before is not None and o.after > o.before + 0.005


def _answered(o: Outcome) -> bool:
    return o.covered is not None and (bool(o.names) or o.verdict == "adequate")


def print_table(outcomes: Sequence[Outcome]) -> None:
    """Print all figures."""
    weak = [o for o in outcomes if o.weak]
    kept = [o for o in outcomes if not o.weak]
    print(f"{len(kept)} sessions; {len(weak)} more had effects below the sensors and do not count")
    for world, figures in (("limb", LIMB), ("arm", ARM)):
        own = [o for o in kept if o.world == world]
        if own:
            print(f"\n{'ONE JOINT WITH A LIMB' if world == 'limb' else 'ARMS OF 2 TO 6 JOINTS'}")
            _print_world(own, figures)
    _print_effects(kept)
    _print_chains(kept)
    _print_wrong(kept)
    seconds = [o.seconds for o in kept]
    print(f"\nseconds per session {np.median(seconds):.1f} (median), {max(seconds):.1f} (longest)")


def _print_world(own: list[Outcome], figures: Iterable[Figure]) -> None:
    lost = [o for o in own if o.timing in LOSING]
    rest = [o for o in own if o.timing not in LOSING]
    print(f"{'':25s} {'all':>26s} {'no sample lost':>16s} {'samples lost':>16s}")
    for title, chosen, right in figures:
        cells = [_share([right(o) for o in part if chosen(o)]) for part in (rest, lost)]
        every = [right(o) for o in own if chosen(o)]
        span = "({:.2f}-{:.2f})".format(*wilson(sum(every), len(every))) if every else ""
        print(f"{title:25s} {_share(every):>14s} {span:11s} {cells[0]:>16s} {cells[1]:>16s}")
    if own[0].world == "limb":
        sizes = [float(len(o.returned)) for o in own if o.kind == "one" and o.names]
        after = [o.after for o in own if o.names and o.after is not None]
        before = [o.before for o in own if o.names and o.before is not None]
        print(f"{'mean set size':25s} {np.mean(sizes or [np.nan]):6.2f} of {len(sizes)}")
        print(
            f"{'K error, median':25s} {100 * np.median(before or [np.nan]):6.2f} % before, "
            f"{100 * np.median(after or [np.nan]):.2f} % after, of {len(after)} repaired"
        )
        return
    for title, part in (("", own), (", no sample lost", rest), (", samples lost", lost)):
        found = [set(o.names) for o in part]
        true = [set(o.truth) for o in part]
        hits = sum(len(a & b) for a, b in zip(found, true, strict=True))
        said, there = sum(map(len, found)), sum(map(len, true))
        print(
            f"{'(effect, joint)' + title:40s} precision {hits / max(said, 1):5.2f} of {said}, "
            f"recall {hits / max(there, 1):5.2f} of {there}"
        )
    for title, all_gains in (
        ("held-out gain over that of the true torque", [o.gain for o in own]),
        ("... over that of the true effects, fitted", [o.fitted_gain for o in own]),
    ):
        gains = [gain for gain in all_gains if gain is not None]
        print(
            f"{title:45s} {np.median(gains or [np.nan]):5.2f} median, "
            f"{_share([gain >= 0.95 for gain in gains])} reach 0.95"
        )


def _share(values: Sequence[bool]) -> str:
    return f"{np.mean(values):5.2f} of {len(values)}" if values else "-"


def _print_effects(kept: list[Outcome]) -> None:
    print("\nBY EFFECT: alone at a limb; anywhere on an arm")
    print(
        f"{'':29s} {'n':>3s} {'detected':>9s} {'first':>6s} {'in set':>7s} {'K after':>8s}"
        f" {'arm':>12s}"
    )
    everything = sorted({name for o in kept for name in truths(o)})
    for name in everything:
        one = [
            o
            for o in kept
            if o.world == "limb" and o.kind in ("one", "outside") and truths(o) == [name]
        ]
        arm = [
            (name, joint) in o.names
            for o in kept
            if o.world == "arm"
            for effect, joint in o.truth
            if effect == name
        ]
        errors = [100 * o.after for o in one if o.after is not None]
        figures = (
            f"{np.mean([o.verdict != 'adequate' for o in one]):9.2f} "
            f"{np.mean([names(o)[:1] == [name] for o in one]):6.2f} "
            f"{np.mean([name in o.returned for o in one]):7.2f} "
            f"{np.median(errors or [np.nan]):7.2f}%"
            if one
            else " " * 33
        )
        print(f"{name:29s} {len(one):3d} {figures} {_share(arm):>12s}")


def _print_chains(kept: list[Outcome]) -> None:
    print("\nBY MEASURING CHAIN, limbs then arms")
    columns = [*((title, f) for title, *f in LIMB if title in SHORT)]
    print(
        f"{'':12s}"
        + "".join(f"{SHORT[title]:>13s}" for title, _ in columns)
        + f"{'precision':>13s}{'recall':>13s}"
    )
    parts = [*(("sensor", word) for word in SENSORS), *(("timing", word) for word in TIMINGS)]
    for field, word in parts:
        part = [o for o in kept if getattr(o, field) == word]
        limb = [o for o in part if o.world == "limb"]
        cells = [_share([f[1](o) for o in limb if f[0](o)]) for _, f in columns]
        arm = [o for o in part if o.world == "arm"]
        said, there = (sum(len(getattr(o, key)) for o in arm) for key in ("names", "truth"))
        hits = sum(len(set(o.names) & set(o.truth)) for o in arm)
        cells += [f"{hits / n:5.2f} of {n}" if n else "-" for n in (said, there)]
        print(f"{word:12s}" + "".join(f"{cell:>13s}" for cell in cells))


SHORT = {
    "names on clean": "clean named",
    "detection": "detected",
    "first name right": "first",
    "in the set": "in set",
    "both of two": "both",
    "outside: unexplained": "outside",
    "pushes: unexplained": "pushes",
    "K made worse": "K worse",
    "90 % intervals of K": "K covered",
}


def right(o: Outcome) -> bool:
    """Say whether an answer is what an ideal answer would be."""
    match o.kind:
        case "clean":
            return o.verdict == "adequate"
        case "outside" | "push":
            return unnamed(o) and o.found_pushes == o.pushes
    return set(o.names) == set(o.truth)


def line(o: Outcome) -> str:
    """Return one line: what was true and what was answered."""
    true = ", ".join(f"{name} at {joint}" for name, joint in o.truth) or o.kind
    said = ", ".join(f"{name} at {joint}" for name, joint in o.names)
    stiffness = (
        "" if o.after is None else f"; K {100 * (o.before or 0):.1f} -> {100 * o.after:.1f} %"
    )
    return (
        f"{o.case} ({o.sensor}, {o.timing}): {true}: {o.verdict} {said}{stiffness}"
        f"{'; ' + o.trouble if o.trouble else ''}"
    )


def _print_wrong(kept: list[Outcome]) -> None:
    wrong = [o for o in kept if not right(o)]
    print(f"\n{len(wrong)} of {len(kept)} sessions not wholly right")
    for o in wrong[:40]:
        print(f"  {line(o)}")
    if len(wrong) > 40:
        print(f"  and {len(wrong) - 40} more")
