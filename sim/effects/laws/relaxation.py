"""Tissue whose torque is lost in time."""

from collections.abc import Callable

import numpy as np

from sim.effects.effect import AppliedEffect, Columns, Limits, Theta
from sim.effects.motion import Motion, RecordedJoint
from sim.effects.parameter import RELATIVE, Nonlinear, Parameter, Values, named

#: Least time constant of tissue, s: up to 3 Hz, where limbs are moved, a faster Maxwell element is
#: damping and inertia. (Set on a limb of an opponent's, with 0.02 s for friction of another form.)
FASTEST = 0.05
#: How far from where it is a time is looked for, as a factor; Maxwell elements that stand for a
#: spectrum of times, and the most decades that it is wide.
FURTHER, ELEMENTS, MOST_DECADES = 3.0, 5, 4.0


class StressRelaxation(AppliedEffect):
    """A further spring whose torque is lost in time: a Maxwell element beside the declared ones.

    With those it is the standard linear solid of soft tissue (Fung 1993, Biomechanics: Mechanical
    Properties of Living Tissues, section 2.11): stiffer when fast, and after a step its torque
    falls to that of the declared spring. A trial begins relaxed. Where that leaves less, the times
    are spread evenly over decades, as tissue's are (the same, section 7.6): elements of one
    stiffness at even steps of the logarithm.
    """

    limb = filters = True
    name = "stress_relaxation"
    remembers = True
    complexity = 2
    signature = "after a movement the torque falls with time, on either side"
    separating_trial = "step to three angles and hold each for twenty seconds"
    parameters = named(
        stiffness=Parameter("Nm/rad", "of what relaxes", floor=0.0),
        relaxation_time=Parameter("s", "in which 63 % is lost", neutral=1.0, floor=FASTEST),
        decades=Parameter("1", "over which they are spread", floor=0.0, ceiling=MOST_DECADES),
    )
    coefficients = ("stiffness",)
    lower = (0.0,)
    nonlinear = (
        Nonlinear("relaxation_time", (0.1, 0.3, 1.0, 3.0, 10.0), scaling=0.4, step=RELATIVE),
        Nonlinear("decades", shift=0.2, step=RELATIVE),
    )

    def thetas(self, joint: RecordedJoint) -> list[Theta]:
        return [{"relaxation_time": time} for time in self.nonlinear[0].grid]

    def searches(self, theta: Theta) -> list[tuple[Theta, Limits]]:
        time = theta["relaxation_time"]
        near = {"relaxation_time": (time / FURTHER, time * FURTHER)}
        spread = {"decades": theta.get("decades", 1.0)}
        return [(theta, near), ({**theta, **spread}, near | {"decades": (0.0, MOST_DECADES)})]

    def columns(self, joint: RecordedJoint, theta: Theta) -> Columns:
        relaxed = [self._relaxed(joint, time) for time in _times(theta)]
        stretch = joint.position - np.mean(relaxed, axis=0)
        return {joint.number: stretch[:, None]}

    def _relaxed(self, joint: RecordedJoint, time: float) -> np.ndarray:
        """Return the angle at which it has no torque, (n,), as `Structure.along` goes over gaps."""
        recording, place = joint.recording, joint.position
        found = recording.lagged(place, time)
        last = None
        for piece in recording.slices:
            first = piece.start
            if last is not None and recording.trial[last] == recording.trial[first]:
                gap = float(recording.time[first] - recording.time[last])
                behind = time * float(place[first] - place[last]) / gap
                left = float(found[last] - place[last]) + behind
                late = left * np.exp(-gap / time) - behind
                since = recording.time[piece] - recording.time[first]
                found[piece] += late * np.exp(-since / time)
            last = piece.stop - 1
        return found

    def simulated(self, parameters: Values, step: float) -> Callable[[Motion], float]:
        kept = np.exp(-step / _times(parameters))
        relaxed = np.full(len(kept), np.nan)

        def torque(motion: Motion) -> float:
            nonlocal relaxed
            place = float(motion.position)
            stretch = place - np.where(np.isnan(relaxed), place, relaxed)
            relaxed = place - kept * stretch
            return parameters["stiffness"] * float(stretch.mean())

        return torque


def _times(parameters: Values) -> np.ndarray:
    """Return the times of what relaxes, s, evenly over the decades about the middle one."""
    decades = parameters.get("decades", 0.0)
    places = np.linspace(-0.5, 0.5, ELEMENTS) if decades else np.zeros(1)
    return np.asarray(parameters["relaxation_time"] * 10.0 ** (decades * places))
