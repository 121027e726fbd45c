import numpy as np
import pytest

from analysis.closeloop.identification.arms.links import BASIS, PARAMETERS, fit_links
from sim.effects.rigid import point_mass

#: Two links of 2 kg, balls of 5 cm.
DECLARED = np.array([2.0 * point_mass(np.array([0.1, 0.0, 0.2]))] * 2)
DECLARED[:, 4:7] += 0.4 * 2.0 * 0.05**2
PSEUDO = np.einsum("bk,kij->bij", DECLARED, BASIS)
FREE = np.array([-np.inf])


def fit(data: np.ndarray, target: np.ndarray, strength: float = 1.0) -> np.ndarray:
    return fit_links(data.T @ data, data.T @ target, PSEUDO, strength, FREE)


def test_links_that_nothing_was_measured_of_stay_as_they_are_declared() -> None:
    data = np.zeros((5, 1 + 2 * PARAMETERS))
    data[:, 0] = 1.0
    assert fit(data, np.full(5, 3.0)) == pytest.approx([3.0] + [0.0] * 20, abs=1e-6)


def test_links_that_much_was_measured_of_are_what_was_measured() -> None:
    rng = np.random.default_rng(0)
    data = rng.normal(size=(400, 1 + 2 * PARAMETERS))
    truth = np.concatenate([[1.5], 0.1 * DECLARED.ravel()])
    assert fit(1e4 * data, 1e4 * data @ truth) == pytest.approx(truth, abs=1e-4)


def test_a_mass_is_never_negative_whatever_was_measured() -> None:
    data = np.zeros((50, 1 + 2 * PARAMETERS))
    data[:, 1] = 1.0
    found = fit(data, np.full(50, -5.0), strength=0.1)
    moved = PSEUDO + np.einsum("bk,kij->bij", found[1:].reshape(2, PARAMETERS), BASIS)
    assert np.linalg.eigvalsh(moved).min() > 0.0
    assert found[1] == pytest.approx(-2.0, abs=0.05)


@pytest.mark.parametrize(("seed", "rank"), [(22, 2), (27, 4), (29, 4)])
def test_data_that_ask_for_less_than_no_inertia_are_no_error(seed: int, rank: int) -> None:
    # One joint's effort in mNm: a singular matrix, or a link on the wrong side of no inertia.
    rng = np.random.default_rng(seed)
    table = rng.normal(size=(50, rank)) @ rng.normal(size=(rank, 1 + 2 * PARAMETERS))
    asked = np.concatenate([[1.5], -DECLARED.ravel()])
    found = fit(1e6 * table, 1e6 * table @ asked, strength=1e-8)
    moved = PSEUDO + np.einsum("bk,kij->bij", found[1:].reshape(2, PARAMETERS), BASIS)
    assert np.linalg.eigvalsh(moved).min() > 0.0


@pytest.mark.parametrize("bound", [0.0, -1.0])
def test_a_bounded_coefficient_is_held_at_its_bound_beside_the_links(bound: float) -> None:
    data = np.zeros((5, 2 + 2 * PARAMETERS))
    data[:, :2] = np.column_stack([np.ones(5), np.arange(5.0)])
    target, lower = np.full(5, -3.0), np.array([bound, -np.inf])
    found = fit_links(data.T @ data, data.T @ target, PSEUDO, 1.0, lower)
    slope = float(np.arange(5.0) @ (target - bound) / (np.arange(5.0) @ np.arange(5.0)))
    assert found == pytest.approx([bound, slope, *np.zeros(20)], abs=1e-6)
