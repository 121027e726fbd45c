"""Other ways to an interval, for comparison: quantile regression made conformal (MAPIE, crepes)."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from analysis.interpretation.bank import Bank
from analysis.interpretation.features import Features
from analysis.interpretation.inference import Interpreter, noisy, targets_of

FOLDS = 5


def compare(
    bank: Bank, recorded: np.ndarray, truth: np.ndarray
) -> Iterator[tuple[str, float, float]]:
    """Yield each method with its coverage and its median half width of K (Nm/rad)."""
    found: dict[str, list[np.ndarray]] = {}
    held: dict[str, list[np.ndarray]] = {}
    fold = np.arange(len(truth)) % FOLDS
    learnt = Interpreter.read(bank)
    for number in range(FOLDS):
        test = fold == number
        without = replace(bank, fitted={}, contact=bank.contact.some(~test))
        for name, low, high in (
            _ours(without, learnt, recorded[test]),
            *_quantiles(without, recorded[~test], truth[~test], recorded[test]),
        ):
            found.setdefault(name, []).append((high - low) / 2.0)
            held.setdefault(name, []).append((low <= truth[test]) & (truth[test] <= high))
    for name, widths in found.items():
        yield (
            name,
            float(np.mean(np.concatenate(held[name]))),
            float(np.median(np.concatenate(widths))),
        )


def _ours(
    bank: Bank, learnt: Interpreter, recorded: np.ndarray
) -> tuple[str, np.ndarray, np.ndarray]:
    interpreter = Interpreter.fit(bank, learnt)
    quantiles = np.array(
        [
            interpreter.infer(interpreter.look(one)).quantiles(np.array([0.05, 0.95]))[:, 0]
            for one in recorded
        ]
    )
    return "Gaussian processes, conformal (kept)", quantiles[:, 0], quantiles[:, 1]


def _quantiles(
    bank: Bank, contact: np.ndarray, truth: np.ndarray, recorded: np.ndarray
) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Yield boosted quantiles of K learnt from bushings, conformal on the rows with contact."""
    from crepes import ConformalRegressor
    from mapie.regression import ConformalizedQuantileRegressor
    from sklearn.ensemble import HistGradientBoostingRegressor

    own = noisy(bank, bank.bushing)
    features = Features.fit(own)
    x, y = features.inputs(own), targets_of(bank.bushing)[:, 0]
    near, fresh = features.inputs(contact), features.inputs(recorded)
    models = [
        HistGradientBoostingRegressor(loss="quantile", quantile=q, max_iter=300).fit(x, y)
        for q in (0.05, 0.95, 0.5)
    ]
    conformal = ConformalizedQuantileRegressor(models, confidence_level=0.9, prefit=True)
    conformal.conformalize(near, truth)
    _, intervals = conformal.predict_interval(fresh)
    yield "boosted quantiles, conformal (MAPIE)", intervals[:, 0, 0], intervals[:, 1, 0]
    mean = HistGradientBoostingRegressor(max_iter=300).fit(x, y)
    regressor = ConformalRegressor().fit(truth - mean.predict(near))
    low, high = regressor.predict_int(mean.predict(fresh), confidence=0.9).T
    yield "boosted mean, conformal (crepes)", low, high
