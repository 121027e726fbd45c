"""How links that hang on springs move, all as one system whose matrices change with time."""

from math import factorial

import numpy as np

#: Terms of a matrix exponential's series, three times some, of a matrix whose rows add up to less
#: than a half: what is left is below 1e-9.
TERMS, SMALL = 9, 0.5
#: Turns of a step below which a sine over them is one.
ALIKE = 1e-6


def hanging(
    inertia: np.ndarray,
    damping: np.ndarray,
    stiffness: np.ndarray,
    loads: np.ndarray,
    begins: np.ndarray,
    step: float,
) -> np.ndarray:
    """Return how what hangs on springs moves: M x'' + D x' + K x = u, which all change with time.

    Between two samples M, D and K are their means and u changes evenly: then every step is exact,
    however quick the springs (Franklin, Powell and Workman 1998, Digital Control of Dynamic
    Systems, section 6.3, triangle hold). All steps are one triangular system of equations.

    Time comes last in all arrays: numpy is slow where the last dimension is short.

    Args:
        inertia, damping, stiffness: M, D and K of every sample, (m, m, n); M and K can be inverted.
        loads: several u, (m, k, n).
        begins: the first samples of stretches, in which all begins anew.
        step: between samples, s.

    Returns:
        Place and speed of each, (2, m, k + 2 m, n): under each load from where that would hold all
        still, without a load from a place of 1 of each, then from a speed of 1.
    """
    # What computes assessments knows this module, and needs no SciPy.
    from scipy.linalg.lapack import dtbtrs

    links, several, count = loads.shape
    states = 2 * links
    # A row for each step, from one sample to the next; none goes from one stretch to another.
    mass, drag, held = (0.5 * (x[..., :-1] + x[..., 1:]) for x in (inertia, damping, stiffness))
    swing = _swing(mass, drag, held, step)
    swing[..., begins[begins > 0] - 1] = 0.0
    # A row for each diagonal, the main one first.
    band = np.zeros((states * count, 2 * states))
    band[:, 0] = 1.0
    steps = band.reshape(count, states, 2 * states)[:-1]
    for row in range(states):
        for column in range(states):
            np.negative(swing[row, column], out=steps[:, column, states + row - column])
    given = np.zeros((several + states, count, states))
    begun = np.moveaxis(given, -1, 0)
    # Under a load that changes evenly all may go evenly, too.
    rate = over(held, (loads[..., 1:] - loads[..., :-1]) / step)
    even = np.concatenate([over(held, loads[..., :-1] - times(drag, rate)), rate])
    begun[:, :several, 1:] = even - times(swing, even)
    begun[:links, :several, 1:] += rate * step
    begun[:links, :several, begins] = over(stiffness[..., begins], loads[..., begins])
    begun[links:, :several, begins] = 0.0
    begun[:, several:, begins] = np.eye(states)[..., None]
    dtbtrs(band.T, given.reshape(len(given), -1).T, uplo="L", diag="U", overwrite_b=True)
    return np.ascontiguousarray(begun).reshape(2, links, several + states, count)


def over(matrices: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return what each matrix, (m, m, n), turns into another, (m, k, n)."""
    links = len(matrices)
    if links == 1:
        return np.asarray(others / matrices)
    if links > 2:
        solved = np.linalg.solve(np.moveaxis(matrices, -1, 0), np.moveaxis(others, -1, 0))
        return np.asarray(np.moveaxis(solved, 0, -1))
    # Cramer's rule: to solve each of thousands by itself takes three times as long.
    (a, b), (c, d) = matrices
    first, second = others
    each = np.stack([d * first - b * second, a * second - c * first])
    return np.asarray(each / (a * d - b * c))


def times(matrices: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return each matrix, (m, m, n), times another, (m, k, n)."""
    return np.asarray(np.einsum("ijn,jkn->ikn", matrices, others))


def _swing(mass: np.ndarray, drag: np.ndarray, held: np.ndarray, step: float) -> np.ndarray:
    """Return what a step makes of places and speeds of what nothing drives, (2 m, 2 m, n)."""
    links = len(mass)
    decay, square = 0.5 * over(mass, drag), over(mass, held)
    if links == 1:
        return _swing_of_one(decay[0, 0], square[0, 0], step)
    # In steps instead of seconds, so that all is of one size.
    rates = np.zeros((mass.shape[-1], 2 * links, 2 * links))
    rates[:, :links, links:] = np.eye(links)
    rates[:, links:, :links] = np.moveaxis(-(step**2) * square, -1, 0)
    rates[:, links:, links:] = np.moveaxis(-2.0 * step * decay, -1, 0)
    swing = np.moveaxis(_exponential(rates), 0, -1)
    swing[:links, links:] *= step
    swing[links:, :links] /= step
    return swing


def _swing_of_one(decay: np.ndarray, square: np.ndarray, step: float) -> np.ndarray:
    """Return the same of one link, (2, 2, n), whose exponential is known, and much quicker.

    Args:
        decay: half of damping over inertia, 1/s, (n,).
        square: stiffness over inertia, 1/s2, (n,).
        step: s.
    """
    turned, fades = decay**2 - square, np.exp(-decay * step)
    # Sums of two exponentials beyond critical damping, else of a sine and a cosine.
    turn = np.sqrt(np.abs(turned))
    angle = np.maximum(turn * step, ALIKE)
    even, odd = fades * np.cos(angle), fades * step * np.sin(angle) / angle
    beyond = np.flatnonzero(turned > 0.0)
    if len(beyond):
        fall, angle = decay[beyond] * step, angle[beyond]
        slow, quick = np.exp(angle - fall), np.exp(-(angle + fall))
        even[beyond] = 0.5 * (slow + quick)
        odd[beyond] = 0.5 * step * (slow - quick) / angle
    return np.array([[even + decay * odd, odd], [-square * odd, even - decay * odd]])


def _exponential(matrices: np.ndarray) -> np.ndarray:
    """Return the exponential of each matrix, (n, k, k), by scaling and squaring.

    As `scipy.linalg.expm`, which takes each by itself, five times as long.
    """
    largest = np.abs(matrices).sum(axis=-1).max(initial=SMALL)
    halvings = int(np.ceil(np.log2(largest / SMALL)))
    one = matrices / 2.0**halvings
    square = one @ one
    powers = np.eye(matrices.shape[-1]), one, square
    cube = square @ one
    # By threes (Paterson and Stockmeyer 1973), which takes four products instead of nine.
    found = cube / factorial(TERMS)
    for least in range(TERMS - 3, -1, -3):
        found = sum((p / factorial(least + n) for n, p in enumerate(powers)), found)
        if least:
            found = cube @ found
    for _ in range(halvings):
        found = found @ found
    return np.asarray(found)
