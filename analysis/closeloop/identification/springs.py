"""Parameters of springs between motors and what hangs on them, all at once."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from analysis.closeloop.identification.balance.least_squares import beyond
from analysis.closeloop.identification.balance.luck import MIN_GAIN
from analysis.closeloop.identification.balance.model import (
    Model,
    estimate_beside,
    evaluate,
    gain,
)
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.balance.terms import Term, kept_columns
from sim.effects.catalogue import BY_NAME
from sim.effects.effect import Theta
from sim.effects.laws.elastic import Viscoelastic
from sim.effects.laws.loose_link import (
    AGREES,
    BEHIND,
    DAMPED,
    RESONANCES,
    WEIGHED,
    springs_together,
)
from sim.effects.motion import RecordedJoint

ELASTIC = BY_NAME["series_elasticity"]
#: Steps of all springs' parameters at once, at most; the share of what is left that one has to take
#: away for another to follow, and by what share a parameter is moved to see what it does.
STEPS, SETTLED, STEP = 15, 1e-3, 0.01
#: How far a parameter may go, as a factor, and the least damping ratio that it begins from.
FURTHEST, LEAST_DAMPING = 8.0, 0.005
#: Damping ratio, and shares of the inertia, with which a search begins. (Set while looking at five
#: of an opponent's limbs.)
BEGIN_DAMPING, BEGIN_BEHIND = 0.05, (1.0, 0.3)
#: Share of the damping that is behind the spring of a motor with much friction.
BEHIND_FRICTION = 0.3
#: What is always looked for, and what else is where that leaves less: all of the damping is the
#: limb's otherwise, and as much of the weight is behind as of the inertia.
ALWAYS = ("resonance", "damping_ratio", BEHIND)
FREED: tuple[tuple[str, ...], ...] = (ALWAYS, (*ALWAYS, DAMPED), (*ALWAYS, DAMPED, WEIGHED))


def left_by(
    rest: Model,
    rows: Rows,
    joint: RecordedJoint,
    beside: np.ndarray | None = None,
    *,
    agrees: float = AGREES,
) -> Callable[[Mapping[int, Theta]], np.ndarray]:
    """Return what tells what springs leave, (r,), of given parameters by their joints.

    Args:
        rest: a model that has none; its terms are fitted anew beside each.
        rows: the samples that are fitted.
        joint: one of those with a spring, with the estimate that the springs carry.
        beside: further columns that are fitted beside them, (r, k).
        agrees: factor by which their compliance and that of their resonance may differ.
    """
    base, _ = rest.base(rows)
    if beside is not None:
        base = np.column_stack([base, beside])
    left_of = beyond(base)
    target = left_of(rest.target(rows))

    def left(thetas: Mapping[int, Theta]) -> np.ndarray:
        own = left_of(_of_springs(rest, rows, joint, thetas))
        size = float(own @ target) / max(float(own @ own), 1e-300)
        return np.asarray(target - np.clip(size, 1.0 / agrees, agrees) * own)

    return left


def _of_springs(
    rest: Model, rows: Rows, joint: RecordedJoint, thetas: Mapping[int, Theta]
) -> np.ndarray:
    """Return what springs add to the efforts that are fitted, (r,)."""
    return np.asarray(rows.stack(rest.transformed(springs_together(joint, thetas)), 1)[:, 0])


def nearest(
    left: Callable[[Mapping[int, Theta]], np.ndarray],
    thetas: Mapping[int, Theta],
    free: Sequence[str] = tuple(ELASTIC.parameters),
) -> dict[int, Theta]:
    """Return the parameters of springs, all at once, that leave least near where they are.

    Args:
        left: what they leave, (r,).
        thetas: those that a search begins with, by joint.
        free: names of those that may change.
    """
    search = Search(thetas, free)
    return search.at(search.ends(lambda x: left(search.at(x)))[0])


class Search:
    """Levenberg and Marquardt's method over logarithms of springs' parameters.

    Args:
        thetas: those that it begins with, by joint.
        free: names of those that may change. The share of a weight goes with the inertia's else.
    """

    def __init__(self, thetas: Mapping[int, Theta], free: Sequence[str]) -> None:
        self._thetas = thetas
        self._names = [(n, name) for n, theta in thetas.items() for name in theta if name in free]

    def at(self, logarithms: np.ndarray) -> dict[int, Theta]:
        """Return the parameters of logarithms, (k,)."""
        found = {number: dict(theta) for number, theta in self._thetas.items()}
        for (number, name), value in zip(self._names, np.exp(logarithms).tolist(), strict=True):
            found[number][name] = value
        for number, theta in found.items():
            if WEIGHED in theta and (number, WEIGHED) not in self._names:
                theta[WEIGHED] = theta[BEHIND]
        return dict(found)

    def ends(
        self, left: Callable[..., np.ndarray], *others: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the logarithms, (k,), and other numbers, (m,), that leave least near the begin.

        Args:
            left: what is left, (r,), of both.
            others: numbers without bounds to begin with, (m,), if there are any.
        """
        began = [self._began(number, name) for number, name in self._names]
        begin, low, high = np.reshape(began, (-1, 3)).T
        more = np.concatenate([np.empty(0), *others])
        free, size = np.full(len(more), np.inf), len(begin)
        found = least_squares(
            lambda x: left(x[:size], x[size:]) if others else left(x),
            np.concatenate([begin, more]),
            bounds=(np.concatenate([low, -free]), np.concatenate([high, free])),
            diff_step=STEP,
            x_scale="jac",
            ftol=SETTLED,
            max_nfev=STEPS,
        )
        return found.x[:size], found.x[size:]

    def _began(self, number: int, name: str) -> tuple[float, float, float]:
        """Return the logarithm of a parameter where the search begins, and how far it may go."""
        parameter, far = ELASTIC.parameters[name], float(np.log(FURTHEST))
        begin = float(np.log(max(self._thetas[number][name], LEAST_DAMPING)))
        low = max(begin - far, float(np.log(max(parameter.floor, 1e-300))))
        high = min(begin + far, float(np.log(parameter.ceiling)))
        return float(np.clip(begin, low + STEP, high - STEP)), low, high


def begins_of(theta: Theta, free: Sequence[str]) -> list[Theta]:
    """Return where searches begin: where a spring is, and behind a motor that rubs.

    Its friction does much of what a stiffer spring does: one of 7 Hz was found at 18. (Set on
    sessions of our own.)
    """
    if DAMPED not in free:
        return [{**theta, DAMPED: 1.0, BEHIND: share} for share in {theta[BEHIND], *BEGIN_BEHIND}]
    if theta[DAMPED] < 1.0:
        return [theta]
    return [theta, {**theta, "resonance": 0.5 * theta["resonance"], DAMPED: BEHIND_FRICTION}]


def nearest_of_limb(
    model: Model,
    coefficients: np.ndarray,
    own: Term,
    rows: Rows,
    begins: Sequence[Theta],
    free: Sequence[str],
) -> tuple[Theta, RecordedJoint]:
    """Return the parameters of a limb's spring that leave least near where searches begin.

    At once with the impedance that hangs on it, which comes back in the joint's estimate: each anew
    for the other they go so slowly that K stayed a sixth too low. (On sessions of our own.)

    Args:
        model: with the spring.
        coefficients: of the model.
        own: the term of the spring.
        rows: the samples that are fitted.
        begins: parameters of the spring with which searches begin.
        free: names of those that may change.
    """
    number, recording, rest = own.joint, model.recording, model.without(own.at)
    joint = RecordedJoint(recording, number, estimate_beside(model, coefficients, own))
    limb = next((term for term in rest.terms if _holds(term, number)), None)
    if limb is None:
        # Nobody declares what the limb does.
        left_alone = left_by(rest, rows, joint, agrees=1.0)
        every = [nearest(left_alone, {number: theta}, free) for theta in begins]
        return min(every, key=lambda found: _sum_of(left_alone(found)))[number], joint
    base, _ = rest.base(rows)
    places = next(own for term, own in rest.split(np.arange(base.shape[1])) if term is limb)
    known = next(own for term, own in model.split(coefficients) if term is limb)
    columns, left_of = base[:, places], beyond(np.delete(base, places, axis=1))
    torques = kept_columns(limb)[number]
    smooth = recording.filtered(rest.transformed({number: torques})[number])
    target, gained = rest.target(rows), gain(model, coefficients, number)
    size = np.linalg.norm(target) / np.linalg.norm(columns, axis=0)

    def moved(impedance: np.ndarray) -> RecordedJoint:
        estimate, change = joint.estimate, impedance - known
        carried, residual = estimate.carried.copy(), estimate.residual.copy()
        carried[:, number] += torques @ change
        residual[:, number] -= smooth @ change
        stiffness, damping = estimate.stiffness.copy(), estimate.damping.copy()
        named = dict(zip(limb.kept, impedance.tolist(), strict=True))
        values = Viscoelastic().impedance(named, gained)
        stiffness[number], damping[number] = values["stiffness"], values["damping"]
        found = replace(
            estimate, carried=carried, residual=residual, stiffness=stiffness, damping=damping
        )
        return replace(joint, estimate=found)

    ends = []
    for begin in begins:
        search = Search({number: begin}, free)

        def left(x: np.ndarray, sizes: np.ndarray, search: Search = search) -> np.ndarray:
            impedance = size * sizes
            spring = _of_springs(rest, rows, moved(impedance), search.at(x))
            return left_of(target - columns @ impedance - spring)

        x, sizes = search.ends(left, known / size)
        ends.append((_sum_of(left(x, sizes)), search.at(x)[number], size * sizes))
    _, theta, impedance = min(ends, key=lambda end: end[0])
    return theta, moved(impedance)


def _holds(term: Term, number: int) -> bool:
    """Whether a term is the impedance of a joint's limb."""
    return isinstance(term.effect, Viscoelastic) and term.joint == number


def _sum_of(left: np.ndarray) -> float:
    """Return the sum of squares."""
    return float(left @ left)


def of_limb(rest: Model, rows: Rows, joint: RecordedJoint) -> list[Theta]:
    """Return where a search for a limb's spring ends from the best points of a grid; or nothing.

    A link that swings with little damping is soon out of step on a spring that is an eighth too
    stiff: then no point of a grid has the size that its resonance says. (An opponent's.)

    Args:
        rest: a model that has none.
        rows: the samples that are fitted.
        joint: the limb's, with the estimate that the spring carries.
    """
    left, number = left_by(rest, rows, joint, agrees=1.0), joint.number
    least = (1.0 - MIN_GAIN) * evaluate(rest, rows).sse
    ends = []
    for behind in BEGIN_BEHIND:
        begun = {"damping_ratio": BEGIN_DAMPING, BEHIND: behind, WEIGHED: behind}
        usual = {**ELASTIC.thetas(joint)[0]}
        usual.update((name, value) for name, value in begun.items() if name in usual)
        grid: list[dict[int, Theta]] = [
            {number: {**usual, "resonance": hertz}} for hertz in RESONANCES
        ]
        begin = min(grid, key=lambda thetas: _sum_of(left(thetas)))
        if _sum_of(left(begin)) < least:
            ends.append(nearest(left, begin, ALWAYS)[number])
    return ends
