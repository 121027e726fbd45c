"""How often closing the loop is right, over synthetic sessions whose truth is known.

`python -m benchmarks.closeloop.synthetic [--seeds FIRST COUNT] [--clean COUNT]
[--effects NAME ...] [--long]`

Protocol: four speeds in two postures and one holdout trial; effect over noise at least 3. Every
session has random numbers of its own. Seeds below 6000 were used while developing; the default
starts at 6000, where nobody had looked before the figures in docs/measurements/close_loop.md were
taken. With `--resume FILE` every session's outcome is kept in a file as it ends, and sessions that
are there already are not analysed again.
"""

import argparse
import json
import multiprocessing
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from analysis.closeloop.loop import analyse, close_loop
from benchmarks.machine import describe_machine
from tests.testbed.sessions.effects import ABSORBED, BETWEEN, EFFECTS, OUTSIDE
from tests.testbed.sessions.synthetic import write_session

#: Pairs of effects that act through different signals.
PAIRS = list(
    combinations(
        ("coulomb_friction", "payload", "added_inertia", "torque_ripple", "stretch_reflex"), 2
    )
)


@dataclass(frozen=True, kw_only=True)
class Case:
    """One session's truth.

    Kinds: `one` effect undeclared; the same where no impedance is declared either (`bare`); `two`;
    `outside` of the catalogue; `absorbed` by the declared unknowns; `clean`.
    """

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
    #: Relative errors of the stiffness; None where none is declared.
    stiffness_before: float | None
    stiffness_after: float | None
    #: Whether the 90 % intervals hold the truth; true where nothing is declared.
    stiffness_covered: bool
    damping_covered: bool
    seconds: float
    report: dict[str, Any]


def cases(first: int, count: int, clean: int, only: list[str] | None) -> Iterator[Case]:
    """Yield the sessions of the benchmark, every seed in turn, so that any part of them is fair."""
    kinds: dict[str, list[tuple[str, ...]]] = {
        "one": [(name,) for name in (*EFFECTS, *BETWEEN)],
        "bare": [(name,) for name in ABSORBED],
        "absorbed": [(name,) for name in ABSORBED],
        "two": list(PAIRS),
        "outside": [(name,) for name in OUTSIDE],
    }
    share = -(-clean // max(count, 1))
    for number in range(count):
        for kind, truths in kinds.items():
            for effects in truths:
                if only is None or "+".join(effects) in only:
                    yield Case(kind=kind, effects=effects, seed=first + number)
        for extra in range(number * share, min((number + 1) * share, clean)):
            if only is None or "clean" in only:
                yield Case(kind="clean", effects=(), seed=first + extra)


def run(case: Case) -> Outcome:
    """Write the session, analyse it blind, compare with the truth."""
    with tempfile.TemporaryDirectory() as directory:
        folder = Path(directory) / "session"
        arm = write_session(folder, case.seed, case.effects, declared=case.kind != "bare")
        started = time.perf_counter()
        report = analyse(folder).report
        seconds = time.perf_counter() - started
    before = after = None
    held = {"stiffness": True, "damping": True}
    if "elbow" in report["impedance"]:
        found = report["impedance"]["elbow"]
        words = ("before", "after")
        before, after = (abs(found["stiffness"][w] / arm.stiffness - 1) for w in words)
        for key, truth in (("stiffness", arm.stiffness), ("damping", arm.damping)):
            low, high = found[key]["ci90_after"]
            held[key] = bool(low <= truth <= high)
    effects = report["effects"]
    first = (effects[0]["name"], *effects[0]["indistinguishable_from"]) if effects else ()
    return Outcome(
        case=case,
        verdict=report["verdict"],
        names=tuple(effect["name"] for effect in effects),
        returned=first,
        stiffness_before=before,
        stiffness_after=after,
        stiffness_covered=held["stiffness"],
        damping_covered=held["damping"],
        seconds=seconds,
        report=report,
    )


def run_all(work: list[Case], processes: int, kept: Path | None) -> list[Outcome]:
    """Run every case that `kept` does not hold yet, and say on stderr how long it will take."""
    done: dict[Case, Outcome] = {}
    if kept is not None and kept.exists():
        for line in kept.read_text().splitlines():
            entry = json.loads(line)
            case = entry.pop("case")
            own = Case(kind=case["kind"], effects=tuple(case["effects"]), seed=case["seed"])
            names, returned = tuple(entry.pop("names")), tuple(entry.pop("returned"))
            done[own] = Outcome(case=own, names=names, returned=returned, **entry)
    left = [case for case in work if case not in done]
    started = time.perf_counter()
    # One thread each: the matrices are small, and the processes share the cores already.
    os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, mp_context=context) as pool:
        futures = [pool.submit(run, case) for case in left]
        for number, future in enumerate(as_completed(futures), 1):
            outcome = future.result()
            done[outcome.case] = outcome
            if kept is not None:
                with kept.open("a") as file:
                    file.write(json.dumps(asdict(outcome)) + "\n")
            spent = time.perf_counter() - started
            rest = spent / number * (len(left) - number) / 60
            text = f"\r{number} of {len(left)} sessions, {rest:.1f} min left "
            print(text, end="" if number < len(left) else "\n", file=sys.stderr, flush=True)
    return [done[case] for case in work if case in done]


def share(values: list[bool]) -> str:
    return f"{np.mean(values):5.2f} of {len(values)}" if values else "none"


def print_effects(outcomes: list[Outcome]) -> None:
    """Print one line for every effect that was undeclared alone."""
    print(f"{'truth':31s} detected  first  in set  K before    after  other answers")
    for kind, name in dict.fromkeys((o.case.kind, o.case.effects[0]) for o in outcomes):
        own = [o for o in outcomes if o.case.kind == kind and o.case.effects == (name,)]
        others = sorted({"+".join(o.names) or o.verdict for o in own if o.names[:1] != (name,)})
        pairs = [
            100 * float(np.median([value for value in values if value is not None] or [np.nan]))
            for values in zip(*((o.stiffness_before, o.stiffness_after) for o in own), strict=True)
        ]
        print(
            f"{name + ' *' * (kind == 'bare'):31s} "
            f"{np.mean([o.verdict != 'adequate' for o in own]):8.2f} "
            f"{np.mean([name in o.names[:1] for o in own]):6.2f} "
            f"{np.mean([name in o.returned for o in own]):7.2f} "
            f"{pairs[0]:8.2f}% {pairs[1]:7.2f}%  {', '.join(others)}"
        )
    print("* no impedance was declared")


def print_wrong(outcomes: list[Outcome], right: list[bool]) -> None:
    for o, good in zip(outcomes, right, strict=True):
        if not good:
            print(f"  {'+'.join(o.case.effects)} ({o.case.seed}): {o.verdict} {', '.join(o.names)}")


def print_table(outcomes: list[Outcome]) -> None:
    """Print the table of docs/measurements/close_loop.md."""
    kinds = ("two", "outside", "absorbed", "clean")
    one = [o for o in outcomes if o.case.kind in ("one", "bare")]
    two, outside, absorbed, clean = ([o for o in outcomes if o.case.kind == k] for k in kinds)
    if one:
        print_effects(one)
    print(f"detection                {share([o.verdict != 'adequate' for o in one])}")
    print(f"first name right         {share([o.case.effects[0] in o.names[:1] for o in one])}")
    print(f"truth in returned set    {share([o.case.effects[0] in o.returned for o in one])}")
    sizes = [len(o.returned) for o in one if o.names]
    print(f"mean set size            {np.mean(sizes or [0]):5.2f}")
    both = [set(o.case.effects) <= set(o.names) for o in two]
    print(f"both of two              {share(both)}")
    print_wrong(two, both)
    print(f"names on clean sessions  {share([bool(o.names) for o in clean])}")
    print(f"clean called adequate    {share([o.verdict == 'adequate' for o in clean])}")
    adequate = [o.verdict == "adequate" for o in absorbed]
    print(f"absorbed: adequate       {share(adequate)}")
    print_wrong(absorbed, adequate)
    unnamed = [o.verdict == "unexplained" for o in outside]
    print(f"outside: unexplained     {share(unnamed)}")
    print_wrong(outside, unnamed)
    errors = [
        (o.stiffness_before, o.stiffness_after)
        for o in one + two
        if o.names and o.stiffness_before is not None and o.stiffness_after is not None
    ]
    worse = [after > before + 0.005 for before, after in errors]
    print(
        f"K error after repair     {100 * np.median([e[1] for e in errors] or [0]):5.2f} % (median)"
    )
    print(f"K made worse             {share(worse)}")
    declared = [o for o in one + two + clean if o.stiffness_after is not None]
    named = [o for o in declared if o.names or o.verdict == "adequate"]
    print_intervals(named)
    print(f"seconds per session      {np.median([o.seconds for o in outcomes]):5.1f} (median)")


def print_intervals(named: list[Outcome]) -> None:
    """Print how often 90 % intervals hold the truth.

    The mean slope of an asymmetric friction is damping too, so there D's truth is not the arm's.
    """
    print(f"intervals of K cover     {share([o.stiffness_covered for o in named])}")
    for kind, word in (("one", "one effect"), ("two", "two effects"), ("clean", "clean")):
        own = [o.stiffness_covered for o in named if o.case.kind == kind]
        print(f"  {word:22s} {share(own)}")
    damped = [o for o in named if "asymmetric_friction" not in o.case.effects]
    print(f"intervals of D cover     {share([o.damping_covered for o in damped])}")
    missed = Counter("+".join(o.case.effects) or "clean" for o in named if not o.stiffness_covered)
    print("K missed:", ", ".join(f"{name} {count}" for name, count in missed.most_common()))


def time_long() -> None:
    """Print how long a session of 8 trials of 30 s at 1 kHz takes, report and all."""
    with tempfile.TemporaryDirectory() as directory:
        folder = Path(directory) / "session"
        effects = ("coulomb_friction", "payload")
        write_session(folder, 0, effects, holdout=False, rate=1000.0, seconds=30.0)
        wall, cpu = time.perf_counter(), time.process_time()
        report = close_loop(folder, Path(directory) / "out")
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    names = " and ".join(effect["name"] for effect in report["effects"])
    print(f"8 trials x 30 s x 1 kHz: {wall:.1f} s, of them {cpu:.1f} s of a core; found {names}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", nargs=2, type=int, default=(6000, 5), metavar=("FIRST", "COUNT"))
    parser.add_argument("--clean", type=int, default=200, help="clean sessions")
    parser.add_argument("--effects", nargs="*", help="only these effects, or clean, or pairs a+b")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--resume", type=Path, metavar="FILE", help="keep outcomes, and go on")
    parser.add_argument("--long", action="store_true", help="time one long session instead")
    options = parser.parse_args()
    print(describe_machine())
    if options.long:
        time_long()
        return
    first, count = options.seeds
    work = list(cases(first, count, options.clean, options.effects))
    print(f"seeds {first} to {first + count - 1}, {options.clean} clean sessions")
    print_table(run_all(work, options.processes, options.resume))


if __name__ == "__main__":
    main()
