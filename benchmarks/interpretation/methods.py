"""Other ways to an interval: boosted trees made conformal (MAPIE, crepes).

`python -m benchmarks.interpretation.methods BANK`

Methods are compared on the bank's own rows with contact, by cross-validation; all of them know the
sets of muscles.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from analysis.interpretation.bank.bank import Bank, load_bank
from analysis.interpretation.inference.features import Features
from analysis.interpretation.inference.interpreter import Interpreter
from analysis.interpretation.inference.rows import noisy, targets_of
from benchmarks.machine import describe_machine

FOLDS = 5
TREES = 150


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bank", type=Path)
    bank = load_bank(parser.parse_args().bank)
    print(describe_machine())
    _methods(bank)


def compare(
    bank: Bank, recorded: np.ndarray, truth: np.ndarray
) -> Iterator[tuple[str, float, float]]:
    """Yield each method with its coverage and its median half width of K (Nm/rad).

    Trees learn from bushings, and the rows with contact make them conformal.
    """
    from crepes import ConformalRegressor
    from mapie.regression import ConformalizedQuantileRegressor
    from sklearn.ensemble import HistGradientBoostingRegressor

    own = noisy(bank, bank.bushing)
    features = Features.fit(own)
    x, y = features.inputs(own), targets_of(bank.bushing)[:, 0]
    models = [
        HistGradientBoostingRegressor(loss="quantile", quantile=q, max_iter=TREES).fit(x, y)
        for q in (0.05, 0.95, 0.5)
    ]
    mean = HistGradientBoostingRegressor(max_iter=TREES).fit(x, y)
    inputs, learnt = features.inputs(recorded), Interpreter.read(bank)
    found: dict[str, list[np.ndarray]] = {}
    fold = np.arange(len(truth)) % FOLDS
    for number in range(FOLDS):
        test = fold == number
        without = replace(bank, fitted={}, contact=bank.contact.some(~test))
        quantile = ConformalizedQuantileRegressor(models, confidence_level=0.9, prefit=True)
        quantile.conformalize(inputs[~test], truth[~test])
        regressor = ConformalRegressor().fit(truth[~test] - mean.predict(inputs[~test]))
        for name, ends in (
            ("Gaussian processes, conformal (kept)", _ours(without, learnt, recorded[test])),
            (
                "boosted quantiles, conformal (MAPIE)",
                quantile.predict_interval(inputs[test])[1][:, :, 0],
            ),
            (
                "boosted mean, conformal (crepes)",
                regressor.predict_int(mean.predict(inputs[test]), confidence=0.9),
            ),
        ):
            found.setdefault(name, []).append(np.column_stack([ends, truth[test]]))
    for name, parts in found.items():
        low, high, true = np.concatenate(parts).T
        inside = (low <= true) & (true <= high)
        yield name, float(inside.mean()), float(np.median(high - low) / 2.0)


def _ours(bank: Bank, learnt: Interpreter, recorded: np.ndarray) -> np.ndarray:
    interpreter = Interpreter.fit(bank, learnt)
    return np.array(
        [
            interpreter.infer(interpreter.look_by_sets(one)).quantiles(np.array([0.05, 0.95]))[:, 0]
            for one in recorded
        ]
    )


def _methods(bank: Bank) -> None:
    """Compare conformal predictions of K on the bank's own rows with contact, five folds."""
    recorded = noisy(bank, bank.contact)
    print("\nmethods, K on the bank's rows with contact, five folds: coverage of 90 %, half width")
    for name, coverage, width in compare(bank, recorded, targets_of(bank.contact)[:, 0]):
        print(f"  {name:44}{100 * coverage:6.1f}{width:8.2f}")


if __name__ == "__main__":
    main()
