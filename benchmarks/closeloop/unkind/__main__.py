"""How often closing the loop is right on recordings that are not kind to it.

`python -m benchmarks.closeloop.unkind [--seeds tuning|reporting] [--first N] [--limbs N]
[--arms N] [--jobs N] [--resume FILE]` records sessions, closes their loops and prints the table.
`--case tuning:limb:17 [--keep FOLDER]` does one. `--search N` looks among N sessions for one that
gets a wrong name, and makes it as small as it still is wrong.
"""

import argparse
import json
import multiprocessing
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from pathlib import Path

# The matrices are small, and the processes share the cores already; set before NumPy is read.
os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

from benchmarks.closeloop.unkind.cases import SEEDS, Case, draw, named
from benchmarks.closeloop.unkind.judge import Outcome, from_line, kept_at, recorded, run
from benchmarks.closeloop.unkind.search import search
from benchmarks.closeloop.unkind.table import line, print_table, right
from benchmarks.machine import describe_machine
from benchmarks.measurement import digest

#: An outcome that was kept is of this code.
MEASURED = ("analysis/closeloop", "sim/effects")


def run_all(
    work: list[Case], jobs: int, kept: Path | None, sessions: Path | None, loud: bool
) -> list[Outcome]:
    """Run the cases that `kept` does not hold of this code yet; say on stderr how far it is."""
    code = digest(MEASURED)
    done: dict[str, Outcome] = {}
    if kept is not None and kept.exists():
        lines = [json.loads(line) for line in kept.read_text().splitlines()]
        same = [from_line(line["outcome"]) for line in lines if line["code"] == code]
        done = {outcome.case: outcome for outcome in same}
    left = [case for case in work if case.name not in done]
    started = time.perf_counter()
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context) as pool:
        futures = [
            pool.submit(run, case, kept_at(sessions, case) if sessions else None) for case in left
        ]
        for number, future in enumerate(as_completed(futures), 1):
            outcome = future.result()
            done[outcome.case] = outcome
            if kept is not None:
                with kept.open("a") as file:
                    file.write(json.dumps({"code": code, "outcome": asdict(outcome)}) + "\n")
            if loud and not right(outcome):
                print(f"\r{line(outcome)}", file=sys.stderr)
            minutes = (time.perf_counter() - started) / number * (len(left) - number) / 60
            bar = "#" * (30 * number // len(left))
            text = f"\r[{bar:30s}] {number} of {len(left)} sessions, {minutes:.1f} min left "
            print(text, end="" if number < len(left) else "\n", file=sys.stderr, flush=True)
    return [done[case.name] for case in work if case.name in done]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", choices=SEEDS, default="tuning")
    parser.add_argument("--first", type=int, default=0, help="number of the first session")
    parser.add_argument("--limbs", type=int, default=40, help="sessions of one joint with a limb")
    parser.add_argument("--arms", type=int, default=10, help="sessions of arms of 2 to 6 joints")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--resume", type=Path, metavar="FILE", help="keep outcomes, and go on")
    parser.add_argument("--sessions", type=Path, metavar="FOLDER", help="keep sessions, use those")
    parser.add_argument("--only-record", action="store_true", help="fill --sessions, no answers")
    parser.add_argument("--loud", action="store_true", help="show what is wrong as it comes")
    parser.add_argument("--case", type=named, metavar="SEEDS:WORLD:N", help="one session only")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="where to keep that session")
    parser.add_argument("--search", type=int, metavar="N", help="look for a session that fools us")
    options = parser.parse_args()
    if options.case:
        print(line(run(options.case, options.keep, whole=True)))
        return
    if options.search:
        search(options.seeds, options.first, options.search, options.keep)
        return
    # Both worlds in step, so that whatever is done so far is fair.
    turns = sorted(
        (n / count, world, options.first + n)
        for world, count in (("limb", options.limbs), ("arm", options.arms))
        for n in range(count)
    )
    work = [draw(options.seeds, world, number) for _, world, number in turns]
    if options.only_record:
        if options.sessions is None:
            parser.error("--only-record needs --sessions FOLDER")
        for number, case in enumerate(work, 1):
            recorded(case, kept_at(options.sessions, case))
            print(f"\r{number} of {len(work)} sessions ", end="", file=sys.stderr, flush=True)
        return
    print(describe_machine())
    last = options.first + max(options.limbs, options.arms) - 1
    sizes = f"{options.limbs} limbs, {options.arms} arms"
    print(f"{options.seeds} seeds {options.first} to {last}: {sizes}")
    outcomes = run_all(work, options.jobs, options.resume, options.sessions, options.loud)
    print_table(outcomes)


if __name__ == "__main__":
    main()
