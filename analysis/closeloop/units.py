"""Whether effort and positions are in the units that the declared model needs."""

import numpy as np

from analysis.closeloop.errors import SessionError
from analysis.closeloop.remedies import scaled
from analysis.closeloop.session.plausibility import LEAST_MOTION, in_motion, unknown_columns
from analysis.closeloop.session.recording import Recording
from sim.effects.laws.drive import GAINS, HEAVIEST

#: One newton metre in other units of torque (NIST SP 811, appendix B.8).
UNITS = {"lb in": 8.8507, "kgf cm": 10.197, "N cm": 100.0, "oz in": 141.61, "mNm": 1000.0}
#: A unit is exact; a sensor's gain and a link's declared inertia are known to within this share.
NEAR_UNIT = 0.1
#: Nobody puts a gear of so many turns in front of a joint; grams for kilograms are more.
LONGEST_GEAR = 300.0
#: Share of the effort's variance that one constant may leave: a poor model leaves more. Beyond
#: `GAINS` that is less than a quarter of what the model leaves as declared. Set before any session
#: was looked at.
ONE_CONSTANT_LEAVES = 0.1


def check_units(recording: Recording) -> None:
    """Refuse a session whose effort is a multiple of what the declared model needs.

    Gravity and inertia of the declared links, each fitted beside an unknown impedance and friction,
    must ask for the same constant, as a mass does only at the links' centre of percussion. Within
    `GAINS` that is a gain to be found. Beyond them it is refused if nothing could be so light or so
    heavy, or if it is the constant of a common unit. So are positions in turns, with which gravity
    and inertia are as declared, and without which neither is.

    Where nothing weighs, inertia has to say it alone. A motor's that nobody declared adds to it: of
    what is too large only a limb's is refused, if the constant is that of a unit and no such
    motor's; `doubtful_units` has the others.

    Raises:
        SessionError: names the joint's column in the first trial.
    """
    for joint in recording.joints:
        if int(in_motion(recording, joint).sum()) < LEAST_MOTION * recording.rate:
            continue
        effort, links = _beside_unknowns(recording, joint)
        hinge, name = recording.is_hinge(joint), recording.name(joint)
        first = recording.session.trials[recording.fit_trials[0]].file
        if hinge and _least_squares(links, effort)[0][1] > GAINS[1] and _in_turns(recording, joint):
            why = (
                f"looks like turns: 2 pi times as large, the declared model of {name} needs the "
                "recorded effort, and as recorded it does not; positions are in radians"
            )
            raise SessionError(why, file=first, column=f"{name}.position")
        limb, where = joint in recording.limbs, "gravity and inertia alike"
        constant = _constant(effort, links)
        question = _question(constant, hinge=hinge) if constant is not None else ""
        if constant is None and (constant := _weightless(effort, links)) is not None:
            where = "inertia, where gravity has no torque"
            certain = constant < 1.0 or (limb and constant > HEAVIEST and units_near(constant))
            question = _question(constant, hinge=hinge) if certain else ""
        if question:
            why = (
                f"is {constant:.4g} times what the declared model of {name} needs, in {where}: "
                f"{question} effort is what arrives at the joint, in {'Nm' if hinge else 'N'}"
            )
            raise SessionError(why, file=first, column=f"{name}.effort")


def doubtful_units(recording: Recording) -> list[str]:
    """Return a sentence for every joint whose effort asks for far more than is declared.

    In gravity and inertia alike that is a factor of the effort, or masses that nobody declared.
    Where nothing weighs, a motor's inertia that nobody declared looks like another unit.
    """
    found = []
    for joint in recording.joints:
        if int(in_motion(recording, joint).sum()) < LEAST_MOTION * recording.rate:
            continue
        effort, links = _beside_unknowns(recording, joint)
        name, unit = recording.name(joint), recording.device.unit(recording.name(joint))
        both, inertia = _constant(effort, links), _weightless(effort, links)
        if both is not None and both > GAINS[1]:
            found.append(
                f"the effort of {name} is {both:.3g} times what its declared model needs, in "
                f"gravity and inertia alike: efforts in no {unit}, currents times a wrong factor, "
                "or masses that are not declared; check the factor first"
            )
        elif inertia is not None and inertia > GAINS[1]:
            found.append(
                f"the effort of {name} needs {inertia:.3g} times the declared inertia, and no "
                f"gravity is there to tell why: if it is not in {unit}, every value is wrong by as "
                "much; if a motor's inertia is not declared (armature), none is"
            )
    return found


def _question(constant: float, *, hinge: bool) -> str:
    """Return what to ask of an effort that is so many times too large; empty if it may be right."""
    if GAINS[0] <= 1.0 / constant <= GAINS[1]:
        return ""
    if 1.0 / constant > LONGEST_GEAR:
        return "are the model's masses in g, or its lengths in mm? They are in kg and m, and"
    if constant < 1.0:
        return f"is it a current, or the torque before a gear of 1:{1.0 / constant:.3g}?"
    near = units_near(constant)
    if hinge and near:
        return f"is its unit {min(near, key=lambda unit: abs(constant - UNITS[unit]))}?"
    return "what is its unit?" if constant > HEAVIEST else ""


def units_near(constant: float) -> list[str]:
    """Return the units of torque of which a newton metre is about so many."""
    return [unit for unit, value in UNITS.items() if abs(constant / value - 1.0) < NEAR_UNIT]


def _in_turns(recording: Recording, joint: int) -> bool:
    """Whether gravity and inertia are as declared if a joint's positions, or all, are turns."""
    every = np.array([recording.is_hinge(other) for other in range(recording.position.shape[1])])
    for turned in (np.arange(len(every)) == joint, every):
        other = scaled(recording, np.where(turned, 2.0 * np.pi, 1.0))
        constant = _constant(*_beside_unknowns(other, joint))
        if constant is not None and abs(constant - 1.0) < NEAR_UNIT:
            return True
    return False


def _constant(effort: np.ndarray, links: np.ndarray) -> float | None:
    """Return the effort over what the declared links need; None if that is not one constant."""
    apart, left = _least_squares(links, effort)
    (constant,), remains = _least_squares(links.sum(axis=1, keepdims=True), effort)
    alike = bool(np.all(np.abs(apart - constant) < NEAR_UNIT * abs(constant)))
    # A part that takes less than is left asks for nothing.
    least = min(_least_squares(links[:, [part]], effort)[1] for part in (0, 1))
    little = remains < ONE_CONSTANT_LEAVES * float(effort @ effort)
    return float(constant) if constant > 0.0 and alike and little and least > 2.0 * left else None


def _weightless(effort: np.ndarray, links: np.ndarray) -> float | None:
    """Return the effort over what the declared inertia needs; None unless it alone says that.

    Gravity times the same constant takes less than is left: it could not say otherwise. What is
    left is little, as a delay, for one, does not leave it.
    """
    (constant,), left = _least_squares(links[:, [1]], effort)
    weight = constant * links[:, 0]
    rounding = 1e-9 * float(effort @ effort)
    alone = float(weight @ weight) <= left + rounding
    little = left < ONE_CONSTANT_LEAVES * float(effort @ effort)
    return float(constant) if constant > 0.0 and alone and little else None


def _beside_unknowns(recording: Recording, joint: int) -> tuple[np.ndarray, np.ndarray]:
    """Return effort, (r,), and gravity and inertia, (r, 2), less what the unknowns explain."""
    rows, gravity = in_motion(recording, joint), recording.static[:, joint]
    columns = np.column_stack([gravity, recording.rigid[:, joint] - gravity])
    columns = np.column_stack([columns, unknown_columns(recording, joint)])
    table = np.column_stack([recording.filtered(columns), recording.effort[:, joint]])[rows]
    unknown, wanted = table[:, 2:-1], table[:, [0, 1, -1]]
    rest = wanted - unknown @ np.linalg.lstsq(unknown, wanted, rcond=None)[0]
    return rest[:, -1], rest[:, :2]


def _least_squares(columns: np.ndarray, effort: np.ndarray) -> tuple[np.ndarray, float]:
    """Return coefficients, and the sum of squares that they leave."""
    found = np.linalg.lstsq(columns, effort, rcond=None)[0]
    rest = effort - columns @ found
    return found, float(rest @ rest)
