"""Whether our plan reaches a tolerance wherever any plan does, and what would narrow K further."""

from dataclasses import replace

import numpy as np

from analysis.interpretation.bank.bank import Bank, Samples
from analysis.interpretation.every_plan import every_plan
from analysis.interpretation.inference.interpreter import Interpreter
from analysis.interpretation.plan import half_width_after, shortest_plan, steps
from benchmarks.interpretation.judging import judge

#: Half widths that are wanted, Nm/rad.
TOLERANCES = (0.25, 0.4)
#: Wearers of whom every plan is looked at: those who everything measured tells best.
WEARERS = 40


def print_plans(interpreter: Interpreter, fresh: Samples, zero: np.ndarray) -> None:
    """Print for how many wearers any plan reaches a tolerance, and ours, and the minutes of both.

    Args:
        interpreter: of a bank without these wearers.
        fresh: with their truth.
        zero: errors of their torques, Nm, shape (n, joints).
    """
    offered = steps(interpreter, ())
    to = {step.factor: step.to for step in offered}
    minutes = {step.factor: step.minutes for step in offered}
    views = [interpreter.look(values) for values in fresh.curves(zero)]
    everything = np.array([half_width_after(interpreter, v, (), tuple(offered)) for v in views])
    best = np.argsort(everything)[:WEARERS]
    said = ", ".join(f"{np.sum(everything <= limit)} to {limit:.2f}" for limit in TOLERANCES)
    print(
        f"\neverything measured, {len(views)} wearers: half width {everything.min():.2f} to "
        f"{everything.max():.2f} Nm/rad, median {np.median(everything):.2f}; {said}"
    )
    print(
        f"every set of {len(to)} steps ({2 ** len(to) - 1}), the {len(best)} wearers told best by "
        "all: reached by any, by ours; minutes of the\n"
        "shortest, of ours; then 90 % hold"
    )
    plans = []
    for number in best:
        found = [one for one in every_plan(interpreter, views[number], (), to) if one[0]]
        plans.append(
            (
                np.array([width for _, width in found]),
                np.array([sum(minutes[name] for name in names) for names, _ in found]),
            )
        )
    for tolerance in TOLERANCES:
        reached, ours, held, shortest, own = 0, 0, 0, 0.0, 0.0
        for number, (widths, times) in zip(best, plans, strict=True):
            reached += bool((widths <= tolerance).any())
            plan = shortest_plan(interpreter, views[number], (), offered, tolerance)
            if plan is None:
                continue
            ours += 1
            own += sum(step.minutes for step in plan[0])
            shortest += times[widths <= tolerance].min()
            measured = {step.factor: step.to for step in plan[0]}
            row = np.array([number])
            came = judge(interpreter, fresh.some(row), zero[row], measured, seed=int(number))
            held += bool(came.coverage(np.ones(1, bool)))
        print(
            f"  {tolerance:.2f} Nm/rad: {reached:3}{ours:5}"
            + (f"{shortest / ours:8.1f}{own / ours:6.1f}{100 * held / ours:7.0f} %" if ours else "")
        )


def print_rows(bank: Bank, learnt: Interpreter, fresh: Samples, zero: np.ndarray) -> None:
    """Print how half widths fall with the rows that have contact.

    Args:
        bank: whose rows without contact are kept.
        learnt: from all of it.
        fresh: wearers.
        zero: errors of their torques, Nm, shape (n, joints).
    """
    count = len(bank.contact)
    print("\nrows with contact: median half width, with all measured; standard deviation of errors")
    for rows in (count // 4, count // 2, count):
        some = replace(bank, fitted={}, contact=bank.contact.some(np.arange(rows)))
        interpreter = learnt if rows == count else Interpreter.fit(some, learnt)
        judged = judge(interpreter, fresh, zero)
        offered = tuple(steps(interpreter, ()))
        views = [interpreter.look(values) for values in fresh.curves(zero)[:100]]
        all_known = [half_width_after(interpreter, view, (), offered) for view in views]
        print(
            f"  {rows:5}{np.median(judged.half_widths[:, 0]):8.2f}{np.median(all_known):8.2f}"
            f"{judged.errors[:, 0].std():8.2f}"
        )
