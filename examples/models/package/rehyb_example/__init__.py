"""A model in a package: how much is left of what decays."""

from math import exp

from rehyb import ModelFailure


class Decay:
    """What an entry point of the group `rehyb.models` names."""

    name = "decay"
    description = "Exponential decay, with noise of its own"
    deterministic = False
    factors = (
        {"name": "rate", "unit": "1/s", "low": 0.1, "high": 1.0, "nominal": 0.5},
        {"name": "start", "unit": "kg", "low": 1.0, "high": 2.0, "nominal": 1.0},
    )
    outputs = (
        {"name": "left", "unit": "kg"},
        {"name": "over_time", "unit": "kg", "curve": 5},
    )

    def evaluate(self, parameters: dict[str, float], seed: int) -> dict[str, object]:
        """Return what is left after 1 s, and at 0, 1, 2, 3 and 4 s."""
        rate, start = parameters["rate"], parameters["start"]
        if start < 0:
            raise ModelFailure("nothing_there", f"start is {start} kg")
        curve = [start * exp(-rate * t) for t in range(5)]
        # What a stochastic model does with its seed: the same point and seed, the same answer.
        return {"left": curve[1] * (1 + 1e-6 * (seed % 1000 - 500) / 500), "over_time": curve}
