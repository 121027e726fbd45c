"""A search for sessions that get a wrong name, each made as small as it still is wrong.

As property-based tests shrink a failure (MacIver and Donaldson 2020, ECOOP): simpler variants of a
session are tried in turn, and kept where the answer is still wrong.
"""

import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from benchmarks.closeloop.unkind.cases import Case, draw, to_json
from benchmarks.closeloop.unkind.judge import Outcome, run
from benchmarks.closeloop.unkind.table import line

#: What most fools: turns of kinds that the search goes through.
KINDS = ("clean", "push", "one", "outside", "two")
#: The fewest trials that a session keeps, its holdout among them.
FEWEST_TRIALS = 4


def fooled(outcome: Outcome) -> bool:
    """Say whether an answer holds a name that is not true, or is a crash."""
    false = set(outcome.names) - set(outcome.truth) - {("external", j) for _, j in outcome.names}
    return not outcome.weak and (bool(false) or outcome.trouble.startswith("crashed"))


def simpler(case: Case) -> Iterator[tuple[str, Case]]:
    """Yield a case's simpler variants, the largest steps first, each with what it leaves out."""
    chain = case.chain
    for n, fault in enumerate(case.faults):
        if len(case.faults) > 1:
            left = case.faults[:n] + case.faults[n + 1 :]
            yield f"without {fault.name}", replace(case, faults=left)
    for n in range(len(case.pushes)):
        if len(case.pushes) > 1:
            yield "one push less", replace(case, pushes=case.pushes[:n] + case.pushes[n + 1 :])
    if case.declared:
        yield "no declared friction", replace(case, declared={})
    if chain.timing != "regular":
        yield "regular samples", replace(case, chain=replace(chain, timing="regular"))
    plain = replace(chain, memory=0.0, pink=0.0, filter_hz=0.0, per_ampere=0.0, speed_hz=0.0)
    if plain != chain:
        yield "white noise, torque, no filter", replace(case, chain=plain)
    if chain.encoder > 1e-5:
        yield "a fine encoder", replace(case, chain=replace(chain, encoder=6e-6))
    if case.controller.kind != "computed_torque":
        best = replace(case.controller, kind="computed_torque")
        yield "computed torque", replace(case, controller=best)
    if case.presliding:
        yield "rigid friction", replace(case, presliding=0.0)
    pushed = {push.trial for push in case.pushes}
    for n, plan in enumerate(case.plans):
        if len(case.plans) > FEWEST_TRIALS and not plan.holdout and not pushed:
            less = case.plans[:n] + case.plans[n + 1 :]
            yield f"without {plan.motion} {plan.number}", replace(case, plans=less)
    if any(plan.sway for plan in case.plans):
        plans = tuple(replace(plan, sway=0.0) for plan in case.plans)
        yield "a shoulder that holds", replace(case, plans=plans)
    if case.faults and max(fault.ratio for fault in case.faults) > 4.0:
        faults = tuple(replace(fault, ratio=max(3.5, fault.ratio / 2)) for fault in case.faults)
        yield "half as strong", replace(case, faults=faults)
    if chain.noise > 0.002:
        quiet = replace(chain, noise=chain.noise / 2, least_count=chain.least_count / 2)
        yield "half the noise", replace(case, chain=quiet)


def shrink(case: Case, outcome: Outcome) -> tuple[Case, Outcome]:
    """Return the smallest case on the way down that still is answered wrongly."""
    tried: set[str] = set()
    going = True
    while going:
        going = False
        for what, smaller in simpler(case):
            mark = json.dumps(to_json(smaller), sort_keys=True)
            if mark in tried:
                continue
            tried.add(mark)
            answer = run(smaller)
            print(f"  {what}: {'still' if fooled(answer) else 'no longer'}", file=sys.stderr)
            if fooled(answer):
                case, outcome, going = smaller, answer, True
                break
    return case, outcome


def search(seeds: str, first: int, count: int, keep: Path | None) -> None:
    """Look among `count` sessions for the first that fools us, shrink it, and print it.

    `keep` is a new folder for the session, its truth and its report.
    """
    for number in range(first, first + count):
        kind = KINDS[number % len(KINDS)]
        world = "arm" if number % 3 == 2 and kind != "outside" else "limb"
        case = draw(seeds, world, number, kind)
        outcome = run(case)
        print(f"{number}: {line(outcome)}", file=sys.stderr)
        if fooled(outcome):
            case, outcome = shrink(case, outcome)
            if keep is not None:
                run(case, keep, whole=True)
            print(line(outcome))
            print(json.dumps(to_json(case)))
            return
    print(f"none of {count} sessions got a wrong name")
