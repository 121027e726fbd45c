"""Ways to a smaller error of K_h, side by side."""

from collections.abc import Mapping

import numpy as np

from analysis.given.measures.hdmr import hdmr
from analysis.interpretation.bank.bank import Bank, Samples
from analysis.interpretation.inference.rows import targets_of
from benchmarks.interpretation.judging import Judged
from benchmarks.interpretation.wearers import FRESH

#: What an answer rests on.
WHATEVER, BY_SETS = "whatever the muscles are", "if they are one of the bank's sets"
#: What two tape measures and scales say.
TAPE = {"upper_arm_length": 0.005, "forearm_length": 0.005, "forearm_mass": 0.1}


def print_ways(bank: Bank, fresh: Samples, answers: Mapping[str, tuple[Judged, Judged]]) -> None:
    """Print what errors of K_h are left by each way to make them smaller, and by both together.

    Personal identification alone is K_h by least squares of the affine regression and of what tapes
    and scales say, on the bank's rows with contact. Below each are the factors that explain most of
    what is left, as first-order shares of given samples. Of each answer: without and with these.
    """
    columns = [bank.population.names.index(name) for name in TAPE]
    told = np.array(list(TAPE.values())) * np.random.default_rng(FRESH).standard_normal(
        (len(fresh), len(TAPE))
    )

    def inputs(samples: Samples, off: np.ndarray) -> np.ndarray:
        measured = samples.factors[:, columns] + off
        return np.column_stack([np.ones(len(samples)), samples.of("stiffness_estimate"), measured])

    truth = targets_of(bank.contact)[:, 0]
    weights = np.linalg.lstsq(inputs(bank.contact, np.zeros((1, len(TAPE)))), truth)[0]
    personal = inputs(fresh, told) @ weights - targets_of(fresh)[:, 0]
    affine = -fresh.of("stiffness_estimate")[:, 0] - targets_of(fresh)[:, 0]
    print("\nways to a smaller error of K_h, Nm/rad       mean     sd   90 % of errors are below")
    for name, error in (
        ("affine alone", affine),
        ("affine, lengths and mass identified", personal),
        *(
            (f"{name}{measured}", judged.errors[:, 0])
            for name, pair in answers.items()
            for measured, judged in zip(("", ", identified"), pair, strict=True)
        ),
    ):
        worst = np.quantile(np.abs(error), 0.9)
        print(f"  {name:48}{error.mean():5.2f}{error.std():7.2f}{worst:10.2f}")
        shares = hdmr(fresh.factors, error)
        most = [f"{bank.population.names[i]} {shares[i]:.2f}" for i in np.argsort(-shares)[:4]]
        print(f"      of its variance: {', '.join(most)}; all alone {shares.sum():.2f}")
