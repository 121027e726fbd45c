"""Whether our plan reaches a tolerance wherever any plan does, and what would narrow K further."""

from dataclasses import replace

import numpy as np

from analysis.interpretation.bank.bank import Bank, Samples
from analysis.interpretation.every_plan import every_plan
from analysis.interpretation.inference.interpreter import Interpreter
from analysis.interpretation.plan import half_width_after, shortest_plan, steps
from benchmarks.interpretation.judging import Look, judge

#: Half width that is wanted, Nm/rad.
TOLERANCE = 0.25
#: Wearers of whom every plan is looked at: those of whom everything measured tells just too little.
WEARERS = 24


def print_plans(
    interpreter: Interpreter,
    fresh: Samples,
    zero: np.ndarray,
    look: Look = Interpreter.look,
) -> None:
    """Print for how many wearers any plan reaches the tolerance, for how many ours does, and both.

    Whom everything measured tells well enough has a plan; of the others every set of steps is
    looked at.

    Args:
        interpreter: of a bank without these wearers.
        fresh: with their truth.
        zero: errors of their torques, Nm, shape (n, joints).
        look: whose intervals.
    """
    offered = steps(interpreter, ())
    to = {step.factor: step.to for step in offered}
    views = [look(interpreter, values) for values in fresh.curves(zero)]
    everything = np.array([half_width_after(interpreter, v, (), tuple(offered)) for v in views])
    print(
        f"\neverything measured, {len(views)} wearers: half width {everything.min():.2f} to "
        f"{everything.max():.2f} Nm/rad, median {np.median(everything):.2f}"
    )
    reached, held, minutes = np.flatnonzero(everything <= TOLERANCE), 0, []
    for number in reached:
        plan = shortest_plan(interpreter, views[number], (), offered, TOLERANCE)
        assert plan is not None
        minutes.append(sum(step.minutes for step in plan[0]))
        row = np.array([number])
        measured = {step.factor: step.to for step in plan[0]}
        came = judge(interpreter, fresh.some(row), zero[row], measured, int(number), look)
        held += bool(came.coverage(np.ones(1, bool)))
    print(f"  {TOLERANCE:.2f} Nm/rad is reached by everything for {len(reached)} of them", end="")
    if minutes:
        print(
            f", by our plan for all of these, in {min(minutes):g} to {max(minutes):g} min (median "
            f"{np.median(minutes):g}); then 90 % hold {100 * held / len(reached):.0f} %"
        )
    else:
        print()
    others = np.argsort(np.where(everything > TOLERANCE, everything, np.inf))[:WEARERS]
    any_plan, ours, least = 0, 0, []
    for number in others:
        widths = [w for names, w in every_plan(interpreter, views[number], (), to) if names]
        least.append(min(widths))
        any_plan += least[-1] <= TOLERANCE
        ours += shortest_plan(interpreter, views[number], (), offered, TOLERANCE) is not None
    print(
        f"  of the {len(others)} next ({everything[others].min():.3f} to "
        f"{everything[others].max():.3f}) any of {2 ** len(to) - 1} sets of steps reaches it for "
        f"{any_plan}, our plan for {ours}; the least of each {min(least):.3f} to {max(least):.3f}"
    )


def print_rows(bank: Bank, learnt: Interpreter, fresh: Samples, zero: np.ndarray) -> None:
    """Print how half widths of the first 200 wearers fall with the rows that have contact.

    Args:
        bank: whose rows without contact are kept.
        learnt: from all of it.
        fresh: wearers.
        zero: errors of their torques, Nm, shape (n, joints).
    """
    count = len(bank.contact)
    fresh, zero = fresh.some(np.arange(min(200, len(fresh)))), zero[:200]
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
