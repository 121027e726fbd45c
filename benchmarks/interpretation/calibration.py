"""Coverage and width of the intervals of K_h, by subgroup, on wearers with contact.

`python -m benchmarks.interpretation.calibration BANK [--wearers 500] [--seed SEED] [--keep FOLDER]`

Wearers are drawn with a seed of their own, which neither the bank nor any choice has seen;
those with slack straps (7143), with one cut (7145, 7146) and with friction (7112) were reported on
before, and nothing was chosen on them; those at the ends (7161, 7162) were looked at. `--keep`
keeps what was simulated and uses it again.
"""

import argparse
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from analysis.interpretation.bank.bank import Bank, Samples, load_bank
from analysis.interpretation.inference.interpreter import Interpreter
from analysis.interpretation.inference.posterior import TARGETS
from analysis.interpretation.inference.rows import JOINTS, targets_of
from analysis.interpretation.plan import half_width_after, steps
from analysis.interpretation.strange import unfamiliar
from benchmarks.interpretation.judging import Judged, judge, subgroups
from benchmarks.interpretation.others import print_called, print_header, print_other_muscles
from benchmarks.interpretation.plans import print_plans, print_rows
from benchmarks.interpretation.ways import BY_SETS, TAPE, WHATEVER, print_ways
from benchmarks.interpretation.wearers import FRESH, Wearers, simulated, strap_cut
from benchmarks.machine import describe_machine

#: Seeds of wearers who are reported on beside fresh ones, and what is changed in them.
FRICTION, SLACK = 7112, 7143
STRANGE = (
    ("undeclared friction of 2.8 Nm", FRICTION, {"robot_friction": 2.8}),
    ("both straps slack, 4 N", SLACK, {"strap_tension": 4.0}),
)
#: Seeds of wearers one of whose straps is cut, and which.
CUT = (("upper arm's strap cut", 7145, 0), ("forearm's strap cut", 7146, 1))
#: Seeds of stiff wearers at the ends of lengths, the lengths (m) between which their upper arms
#: are, and their least passive stiffness, Nm/rad.
ENDS = (("stiff and short", 7161, (0.0, 0.29)), ("stiff and long", 7162, (0.35, 1.0)))
STIFF = 3.0


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bank", type=Path)
    parser.add_argument("--wearers", type=int, default=500)
    parser.add_argument("--seed", type=int, default=FRESH)
    parser.add_argument("--strange", type=int, nargs=2, default=(40, 120), help="of each kind")
    parser.add_argument("--keep", type=Path)
    asked = parser.parse_args()
    bank, seed = load_bank(asked.bank), asked.seed
    interpreter = Interpreter.read(bank)
    print(describe_machine())
    print(f"\nbank {bank.id}: {len(bank.bushing)} bushings, {len(bank.contact)} with contact")
    wearers = simulated(bank.population, seed, range(asked.wearers), keep=asked.keep)
    fresh = wearers.samples
    zero = bank.population.zero_errors(seed, fresh.rows, JOINTS)
    print(f"{len(fresh)} fresh wearers with contact, {dict(fresh.failed)} failed")
    judged = judge(interpreter, fresh, zero)
    by_sets = judge(interpreter, fresh, zero, look=Interpreter.look_by_sets)
    _widths(fresh, {WHATEVER: judged, BY_SETS: by_sets})
    print(f"\n{WHATEVER}: what is said first")
    _coverage(interpreter, fresh, judged)
    print(f"\n{BY_SETS}")
    _coverage(interpreter, fresh, by_sets)
    print("\nwith both lengths to 5 mm and the forearm's mass to 0.1 kg")
    known = judge(interpreter, fresh, zero, TAPE, seed=seed)
    _coverage(interpreter, fresh, known, ("all",))
    told = judge(interpreter, fresh, zero, TAPE, seed=seed, look=Interpreter.look_by_sets)
    print(f"\nthe same, {BY_SETS}")
    _coverage(interpreter, fresh, told, ("all",))
    print_ways(bank, fresh, {WHATEVER: (judged, known), BY_SETS: (by_sets, told)})
    print_other_muscles(bank, seed, wearers)
    _strange(bank, interpreter, wearers, asked)
    _ends(bank, interpreter, asked)
    _encoders(bank, interpreter, wearers, zero)
    _next(interpreter, fresh, zero)
    print_plans(interpreter, fresh, zero)
    print(f"\n{BY_SETS}", end="")
    print_plans(interpreter, fresh, zero, Interpreter.look_by_sets)
    print_rows(bank, interpreter, fresh, zero)
    _speed(interpreter, fresh)


def _widths(samples: Samples, answers: Mapping[str, Judged]) -> None:
    """Print errors of the regressions and half widths of each answer."""
    truth = targets_of(samples)[:, 0]
    own = samples.of("true_stiffness_paper")[:, 0]
    affine, paper = -samples.of("stiffness_estimate", "stiffness_estimate_paper").T
    print("\nNm/rad                                    mean     sd   90 % of errors are below")
    for name, error in (
        ("paper's regression, of K_h", paper - truth),
        ("paper's regression, of its own truth", paper - own),
        ("affine, of K_h", affine - truth),
        *((f"median, {name}", judged.errors[:, 0]) for name, judged in answers.items()),
    ):
        worst = np.quantile(np.abs(error), 0.9)
        print(f"  {name:44}{error.mean():7.2f}{error.std():7.2f}{worst:10.2f}")
    print("half width of the 90 % interval              10 to 90 %  median  over paper's  affine's")
    errors = [np.quantile(np.abs(one - truth), 0.9) for one in (paper, affine)]
    for name, judged in answers.items():
        low, middle, high = np.quantile(judged.half_widths[:, 0], [0.1, 0.5, 0.9])
        shares = "".join(f"{middle / error:10.2f}" for error in errors)
        print(f"  {name:44}{low:.2f}-{high:.2f}{middle:8.2f}{shares}")
    print(f"  standard deviation of K_h among these wearers: {truth.std():.2f}")


def _coverage(
    interpreter: Interpreter,
    samples: Samples,
    judged: Judged,
    names: tuple[str, ...] = (),
) -> None:
    print("coverage, %                  n    K 50   K 90   D 50   D 90   median half width of K")
    for name, chosen in subgroups(interpreter, samples).items():
        if (names and name not in names) or not chosen.any():
            continue
        shares = [judged.coverage(chosen, s, t) for t in (0, 1) for s in (0.5, 0.9)]
        cells = "".join(f"{100 * share:7.1f}" for share in shares)
        width = np.median(judged.half_widths[chosen, 0])
        print(f"  {name:24}{chosen.sum():5}{cells}{width:9.2f}")
    everyone = judged.coverage(np.ones(len(samples), bool))
    within = 1.96 * np.sqrt(everyone * (1.0 - everyone) / len(samples))
    print(f"  K 90 of all lies within {100 * within:.1f} of that with 95 % probability")
    places = [100 * judged.coverage(np.ones(len(samples), bool), 0.9, t) for t in (2, 3, 4)]
    print("  K at a tenth, half, nine tenths, 90 %: " + ", ".join(f"{p:.1f}" for p in places))
    print(f"  ranks of K uniform: p {judged.uniformity():.2f}; of D: p {judged.uniformity(1):.2f}")
    counts = np.histogram(judged.ranks[:, 0], 10, (0.0, 1.0))[0]
    print("  ranks of K in tenths: " + " ".join(map(str, counts)))


def _strange(
    bank: Bank, interpreter: Interpreter, wearers: Wearers, asked: argparse.Namespace
) -> None:
    print_header("recordings unlike the bank")
    print_called("none: fresh wearers", bank, interpreter, asked.seed, wearers)
    for (name, seed, changed), count in zip(STRANGE, asked.strange, strict=True):
        keep = asked.keep
        other = simulated(bank.population, seed, range(count), changed=changed, keep=keep)
        if len(other):
            print_called(name, bank, interpreter, seed, other)
        else:
            print(f"  {name}: every assessment failed")
    for name, seed, limb in CUT:
        with strap_cut(limb):
            other = simulated(bank.population, seed, range(max(asked.strange)), keep=asked.keep)
        print_called(name, bank, interpreter, seed, other)


def _ends(bank: Bank, interpreter: Interpreter, asked: argparse.Namespace) -> None:
    """Print how often intervals hold of stiff limbs at the ends of lengths, told and untold."""
    names = bank.population.names
    print("\nends of lengths                     n   90 % of K hold   half width   bias")
    for name, seed, (low, high) in ENDS:
        drawn = bank.population.draw(seed, np.arange(1 << 15))
        length = drawn[:, names.index("upper_arm_length")]
        stiff = drawn[:, names.index("passive_stiffness")] > STIFF
        rows = np.flatnonzero(stiff & (length > low) & (length < high))[: max(asked.strange)]
        samples = simulated(bank.population, seed, rows.tolist(), keep=asked.keep).samples
        zero = bank.population.zero_errors(seed, samples.rows, JOINTS)
        for what, known in (("", None), (", measured", TAPE)):
            judged = judge(interpreter, samples, zero, known, seed=seed)
            everyone = np.ones(len(samples), bool)
            print(
                f"  {name + what:32}{len(samples):4}{100 * judged.coverage(everyone):14.1f}"
                f"{np.median(judged.half_widths[:, 0]):14.2f}{judged.errors[:, 0].mean():10.2f}"
            )


def _encoders(bank: Bank, interpreter: Interpreter, wearers: Wearers, zero: np.ndarray) -> None:
    """Print how many recordings are called strange whose held joint is read a degree wrong."""
    some = wearers.some(np.arange(min(len(wearers), 40)))
    for joint in range(JOINTS - 1):
        strange = []
        for by in (-np.radians(1.0), np.radians(1.0)):
            for recording in some.recordings(zero[: len(some)]):
                motion = recording.motion
                moved = replace(motion, theta=motion.theta + by * np.eye(JOINTS)[joint])
                wrong = replace(recording, motion=moved)
                strange.append(unfamiliar(bank, interpreter, wrong, wrong.values()) is not None)
        name = f"J{joint + 1} read a degree off, either way"
        print(f"  {name:33}{len(strange):5}{100 * np.mean(strange):15.1f}")


def _next(interpreter: Interpreter, fresh: Samples, zero: np.ndarray, count: int = 200) -> None:
    """Print how often the half width after the best step is as it was said."""
    recorded = fresh.curves(zero)[:count]
    names = interpreter.population.names
    ratios = []
    for row, values in enumerate(recorded):
        view = interpreter.look(values)
        said = {s: half_width_after(interpreter, view, (), (s,)) for s in steps(interpreter, ())}
        best = min(said, key=lambda step: said[step])
        one = fresh.some(np.array([row]))
        came = judge(interpreter, one, zero[[row]], {best.factor: best.to}, seed=row)
        ratios.append(came.half_widths[0, 0] / said[best])
    assert names
    good = np.mean(np.abs(np.array(ratios) - 1.0) <= 0.25)
    low, high = np.quantile(ratios, [0.05, 0.95])
    print(
        f"\nhalf width after the best step over what was said, {len(ratios)} wearers: within 25 % "
        f"in {100 * good:.1f} %, 5 to 95 %: {low:.2f}-{high:.2f}"
    )


def _speed(interpreter: Interpreter, fresh: Samples) -> None:
    recorded = fresh.curves(np.zeros((len(fresh), JOINTS)))[:20]
    started = time.process_time()
    for values in recorded:
        interpreter.infer(interpreter.look(values))
    seconds = (time.process_time() - started) / len(recorded)
    print(f"\none recording, read and bank loaded: {1e3 * seconds:.0f} ms of a core")


if __name__ == "__main__":
    assert TARGETS[0] == "stiffness"
    main()
