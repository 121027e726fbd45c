"""How often closing the loop is right, over synthetic sessions whose truth is known.

`python -m benchmarks.closeloop [--seeds FIRST COUNT] [--effects NAME ...]`

Protocol: four speeds in two postures and one holdout trial; effect over noise at least 3. Seeds 0
to 99 were used while developing; the default starts at 1000, and no seed from there on was looked
at before the figures in docs/closeloop.md were taken.
"""

import argparse
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

from analysis.closeloop.answer import answer
from benchmarks.machine import describe_machine
from tests.closeloop_sessions import EFFECTS, OUTSIDE, write_session

#: Pairs of effects that act through different signals.
PAIRS = list(
    combinations(
        ("coulomb_friction", "payload", "added_inertia", "torque_ripple", "stretch_reflex"), 2
    )
)


@dataclass(frozen=True, kw_only=True)
class Case:
    """One session's truth."""

    kind: str
    effects: tuple[str, ...]
    seed: int


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What closing the loop answered."""

    case: Case
    verdict: str
    names: tuple[str, ...]
    #: The first name with all that it cannot be told from.
    returned: tuple[str, ...]
    stiffness_before: float
    stiffness_after: float
    covered: bool
    seconds: float


def cases(first: int, count: int, clean: int, only: list[str] | None) -> Iterator[Case]:
    """Yield the sessions of the benchmark."""
    for seed in range(first, first + count):
        for name in EFFECTS:
            if only is None or name in only:
                yield Case(kind="one", effects=(name,), seed=seed)
        if only is None:
            for name in OUTSIDE:
                yield Case(kind="outside", effects=(name,), seed=seed)
    if only is None:
        for number, pair in enumerate(PAIRS):
            yield Case(kind="two", effects=pair, seed=first + number)
        for seed in range(first, first + clean):
            yield Case(kind="clean", effects=(), seed=seed)


def run(case: Case) -> Outcome:
    """Write the session, analyse it blind, compare with the truth."""
    with tempfile.TemporaryDirectory() as directory:
        folder = Path(directory) / "session"
        arm = write_session(folder, case.seed, case.effects)
        started = time.perf_counter()
        report = answer(folder).report
        seconds = time.perf_counter() - started
    stiffness = report["impedance"]["elbow"]["stiffness"]
    low, high = stiffness["ci90_after"]
    effects = report["effects"]
    first = (effects[0]["name"], *effects[0]["indistinguishable_from"]) if effects else ()
    return Outcome(
        case=case,
        verdict=report["verdict"],
        names=tuple(effect["name"] for effect in effects),
        returned=first,
        stiffness_before=abs(stiffness["before"] / arm.stiffness - 1),
        stiffness_after=abs(stiffness["after"] / arm.stiffness - 1),
        covered=bool(low <= arm.stiffness <= high),
        seconds=seconds,
    )


def share(values: list[bool]) -> str:
    return f"{np.mean(values):5.2f} of {len(values)}" if values else "none"


def print_effects(outcomes: list[Outcome]) -> None:
    """Print one line for every effect that was undeclared alone."""
    print(f"{'truth':28s} detected  first  in set  K before    after  other answers")
    for name in dict.fromkeys(o.case.effects[0] for o in outcomes):
        own = [o for o in outcomes if o.case.effects == (name,)]
        others = sorted({"+".join(o.names) or o.verdict for o in own if o.names[:1] != (name,)})
        print(
            f"{name:28s} {np.mean([o.verdict != 'adequate' for o in own]):8.2f} "
            f"{np.mean([name in o.names[:1] for o in own]):6.2f} "
            f"{np.mean([name in o.returned for o in own]):7.2f} "
            f"{100 * np.median([o.stiffness_before for o in own]):8.2f}% "
            f"{100 * np.median([o.stiffness_after for o in own]):7.2f}%  {', '.join(others)}"
        )


def print_table(outcomes: list[Outcome]) -> None:
    """Print the table of docs/closeloop.md."""
    kinds = ("one", "two", "outside", "clean")
    one, two, outside, clean = ([o for o in outcomes if o.case.kind == kind] for kind in kinds)
    print_effects(one)
    print(f"detection                {share([o.verdict != 'adequate' for o in one])}")
    print(f"first name right         {share([o.case.effects[0] in o.names[:1] for o in one])}")
    print(f"truth in returned set    {share([o.case.effects[0] in o.returned for o in one])}")
    sizes = [len(o.returned) for o in one if o.names]
    print(f"mean set size            {np.mean(sizes):5.2f}")
    both = [set(o.case.effects) <= set(o.names) for o in two]
    unnamed = [o.verdict == "unexplained" for o in outside]
    print(f"both of two              {share(both)}")
    print(f"names on clean sessions  {share([bool(o.names) for o in clean])}")
    print(f"clean called adequate    {share([o.verdict == 'adequate' for o in clean])}")
    print(f"outside: unexplained     {share(unnamed)}")
    for o, right in zip([*two, *outside], [*both, *unnamed], strict=True):
        if not right:
            print(f"  {'+'.join(o.case.effects)} ({o.case.seed}): {o.verdict} {', '.join(o.names)}")
    repaired = [o for o in one + two if o.names]
    after = 100 * np.median([o.stiffness_after for o in repaired])
    worse = [o.stiffness_after > o.stiffness_before + 0.005 for o in repaired]
    print(f"K error after repair     {after:5.2f} % (median)")
    print(f"K made worse             {share(worse)}")
    print(f"intervals of K cover     {share([o.covered for o in repaired + clean])}")
    print(f"seconds per session      {np.median([o.seconds for o in outcomes]):5.1f} (median)")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", nargs=2, type=int, default=(1000, 1), metavar=("FIRST", "COUNT"))
    parser.add_argument("--clean", type=int, default=24, help="clean sessions")
    parser.add_argument("--effects", nargs="*", help="only these effects, one at a time")
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    print(describe_machine())
    first, count = options.seeds
    work = list(cases(first, count, options.clean, options.effects))
    with ProcessPoolExecutor(options.processes) as pool:
        print_table(list(pool.map(run, work)))


if __name__ == "__main__":
    main()
