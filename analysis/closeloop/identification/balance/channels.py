"""Effects of an effort channel, late or low-passed: the parameter with which least is left."""

from dataclasses import replace

from scipy.optimize import minimize_scalar

from analysis.closeloop.identification.balance.model import Model, evaluate, unfitted
from analysis.closeloop.identification.balance.regression import Rows, Score
from analysis.closeloop.identification.balance.terms import Candidate, Channel
from sim.effects.effect import Theta

#: By what share the parameter of a channel may be beside the best, and moves to come there.
BESIDE, MOVES = 1e-3, 12


def best_channel(
    model: Model, rows: Rows, candidate: Candidate, thetas: list[Theta]
) -> tuple[Model, Score] | None:
    """Return the model with the best of several parameters of a channel; None if there is none."""
    tried = []
    for theta in thetas:
        channel = Channel(candidate=candidate, theta=theta)
        changed = replace(model, channels=(*model.channels, channel))
        tried.append((changed, evaluate(changed, rows)))
    return min(tried, key=lambda pair: pair[1].sse) if tried else None


def between(model: Model, rows: Rows, candidate: Candidate, theta: Theta, scale: float) -> Model:
    """Return the model with a channel's parameter where least is left between neighbours.

    Halved steps end beside it, by more than its error (an opponent's lags).
    """
    rest, ((name, value),) = model.without(candidate), theta.items()

    def at(moved: float) -> Model:
        channel = Channel(candidate=candidate, theta={name: moved})
        return replace(rest, channels=(*rest.channels, channel))

    low, high = sorted(candidate.effect.nonlinear[0].near(value, scale))
    found = minimize_scalar(
        lambda moved: evaluate(at(moved), rows).sse,
        bounds=(low, high),
        method="bounded",
        options={"xatol": BESIDE * abs(value), "maxiter": MOVES},
    )
    joint = unfitted(model.recording, candidate.joint)
    if found.fun > evaluate(model, rows).sse or candidate.effect.beyond(joint, {name: found.x}, {}):
        return model
    return at(float(found.x))
