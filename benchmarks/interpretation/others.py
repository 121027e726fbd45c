"""Recordings unlike a bank, wearers whose muscles it lacks: who is called strange, and held."""

import re
from collections import Counter
from dataclasses import replace

import numpy as np

from analysis.interpretation.bank.bank import Bank
from analysis.interpretation.inference.interpreter import Interpreter
from analysis.interpretation.inference.rows import JOINTS
from analysis.interpretation.strange import unfamiliar
from benchmarks.interpretation.judging import MUSCLES, judge
from benchmarks.interpretation.wearers import Wearers


def print_header(what: str) -> None:
    """Print what stands above the lines of `print_called`."""
    print(f"\n{what:36}n   called   90 % of K hold   of the familiar   half   by the bank's sets")
    print(" " * 38 + "strange, %" + " " * 33 + "width    hold   half width")


def print_other_muscles(bank: Bank, seed: int, wearers: Wearers) -> None:
    """Leave each set of muscles out of the bank, and interpret wearers of `seed` who have it."""
    column = bank.population.names.index("muscles")
    print_header("muscles left out of the bank")
    for number, name in enumerate(MUSCLES):
        without = replace(
            bank,
            fitted={},
            bushing=bank.bushing.some(bank.bushing.factors[:, column] != number),
            contact=bank.contact.some(bank.contact.factors[:, column] != number),
        )
        own = wearers.some(wearers.samples.factors[:, column] == number)
        print_called(name, without, Interpreter.fit(without), seed, own)


def print_called(
    name: str, bank: Bank, interpreter: Interpreter, seed: int, wearers: Wearers
) -> None:
    """Print how many recordings are called strange, why, and how often intervals hold."""
    samples = wearers.samples
    zero = bank.population.zero_errors(seed, samples.rows, JOINTS)
    first = judge(interpreter, samples, zero)
    by_sets = judge(interpreter, samples, zero, look=Interpreter.look_by_sets)
    why = [
        unfamiliar(bank, interpreter, recording, recording.values())
        for recording in wearers.recordings(zero)
    ]
    everyone, familiar = np.ones(len(why), bool), np.array([one is None for one in why])
    among = f"{100 * first.coverage(familiar):.1f} of {familiar.sum()}" if familiar.any() else "-"
    print(
        f"  {name:32}{len(why):4}{100 * np.mean(~familiar):9.1f}"
        f"{100 * first.coverage(everyone):16.1f}{among:>18}"
        f"{np.median(first.half_widths[:, 0]):8.2f}{100 * by_sets.coverage(everyone):8.1f}"
        f"{np.median(by_sets.half_widths[:, 0]):11.2f}"
    )
    reasons = Counter(re.split(r"[-+]?\d|unlike", one)[0].strip() for one in why if one)
    for reason, count in reasons.most_common():
        print(f"    {count:4} of them: {reason} ...")
