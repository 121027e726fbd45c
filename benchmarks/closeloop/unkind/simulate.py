"""A trial of a case in MuJoCo, in closed loop, and what its declared model leaves of it."""

from collections import deque
from dataclasses import dataclass

import mujoco
import numpy as np

from benchmarks.closeloop.unkind.cases import Case, Plan
from benchmarks.closeloop.unkind.chain import Signal
from benchmarks.closeloop.unkind.faults import OUTSIDE, Fault
from benchmarks.closeloop.unkind.laws import Bristles, Law, bump, friction_level, is_friction
from benchmarks.closeloop.unkind.motion import MOTIONS
from benchmarks.closeloop.unkind.robots import Hidden, declared_xml, real_xml

STEP = 0.002
#: With a spring or a gap behind a motor.
FINE_STEP = 0.001
#: Faults that act on the link rather than on the motor.
OF_LIMB = (
    "nonlinear_stiffness", "end_range_torque", "hysteresis", "thixotropic_stiffness",
    "stress_relaxation",
    "stretch_reflex", *OUTSIDE,
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Trial:
    """A simulated trial on the simulation's clock; all but `time` of shape (samples, joints)."""

    time: Signal
    #: At the encoders, without their errors.
    q: Signal
    v: Signal
    a: Signal
    #: What the controller commands, Nm.
    effort: Signal
    #: Torque of the limb and of declared friction, at the encoders' angles.
    known: Signal


class FlightError(Exception):
    """The simulated robot left its range."""


def hidden_build(case: Case) -> Hidden:
    """Return how the real device is built."""
    springs, gaps, loads, inertias = {}, {}, {}, {}
    for fault in case.faults:
        joint = case.robot.joints[case.robot.index(fault.joint)]
        match fault.name:
            case "series_elasticity":
                stiffness = 1 / fault.value("compliance")
                inertia = joint.inertia[1] + joint.mass * float(np.dot(joint.com, joint.com))
                damping = 2 * fault.value("ratio") * np.sqrt(stiffness * inertia)
                springs[fault.joint] = (stiffness, float(damping))
            case "backlash":
                gaps[fault.joint] = fault.value("gap")
            case "payload":
                loads[fault.joint] = (fault.value("mass"), fault.place)
            case "added_inertia":
                inertias[fault.joint] = fault.value("inertia")
    return Hidden(springs=springs, gaps=gaps, loads=loads, inertias=inertias)


class Bench:
    """A case's device, ready for its trials."""

    def __init__(self, case: Case) -> None:
        self.case = case
        hidden = hidden_build(case)
        self.step = FINE_STEP if hidden.springs or hidden.gaps else STEP
        self.real = mujoco.MjModel.from_xml_string(real_xml(case.robot, hidden, self.step))
        self.declared = mujoco.MjModel.from_xml_string(declared_xml(case.robot))
        names = case.robot.names
        self.dofs = np.array([self.real.joint(name).dofadr[0] for name in names])
        self.far = np.array(
            [
                self.real.joint(f"{name}_flex").dofadr[0]
                if name in {**hidden.springs, **hidden.gaps}
                else -1
                for name in names
            ]
        )
        offsets = {f.joint: f.value("angle") for f in case.faults if f.name == "position_offset"}
        self.offset = np.array([offsets.get(name, 0.0) for name in names])
        self.duration = sum(plan.seconds + plan.pause for plan in case.plans)

    def wanted(self, plan: Plan) -> tuple[Signal, Signal, Signal, Signal]:
        """Return clock and wanted angles, speeds and accelerations of a trial."""
        robot, case = self.case.robot, self.case
        time = np.arange(0.0, plan.seconds, self.step)
        paths = np.zeros((3, len(time), len(robot.joints)))
        for index, joint in enumerate(robot.joints):
            rng = case.rng(f"motion {joint.name}", plan.number)
            if robot.limb is not None and joint.name != robot.limb.joint:
                phase, turn = rng.uniform(0, 2 * np.pi), 2 * np.pi * rng.uniform(0.2, 0.5)
                angle = turn * time + phase
                paths[0, :, index] = plan.posture + plan.sway * np.sin(angle)
                paths[1, :, index] = plan.sway * turn * np.cos(angle)
                paths[2, :, index] = -plan.sway * turn**2 * np.sin(angle)
                continue
            low, high = joint.low, joint.high
            if robot.limb is not None and plan.motion != "ramp":
                # Each trial in its own part of the range: two postures even without a shoulder.
                width = (high - low) * rng.uniform(0.65, 1.0)
                low += (high - low - width) * (plan.number % 2)
                high = low + width
            paths[:, :, index] = MOTIONS[plan.motion](rng, time, low, high, plan.pace)
        return time, *paths

    def run(self, plan: Plan, start: float, pushes: dict[int, float]) -> Trial:
        """Simulate a trial that begins at `start` s of the session.

        Args:
            plan: the trial.
            start: s on the session's clock.
            pushes: peak torque (Nm) of the case's pushes by their number.

        Raises:
            FlightError: the controller lost the robot.
        """
        case, robot, real, dofs = self.case, self.case.robot, self.real, self.dofs
        time, q_want, v_want, a_want = self.wanted(plan)
        data, dt, count = mujoco.MjData(real), self.step, len(robot.joints)
        forward = inverse(self.declared, q_want, v_want, a_want)
        if case.controller.kind in ("pd", "pid"):
            forward[:] = forward[0] if case.controller.kind == "pid" else 0.0
        elif case.controller.kind == "pd_gravity":
            forward = inverse(self.declared, q_want, 0 * v_want, 0 * a_want)
        data.qpos[dofs] = q_want[0] - self.offset
        mujoco.mj_forward(real, data)
        mass = np.zeros((real.nv, real.nv))
        mujoco.mj_fullM(real, data, mass)
        own = np.diag(mass)[dofs]
        turn = 2 * np.pi * case.controller.hertz
        spring, damper = own * turn**2, own * 2 * 0.8 * turn
        integral = spring * turn / 8 * (case.controller.kind == "pid")
        forces = _Forces(case, self, start)
        total, late = np.zeros(count), _ActuatorPath(case, dt)
        q_out, v_out, a_out, e_out, k_out = (np.zeros((len(time), count)) for _ in range(5))
        seen = q_want[0].copy()
        speed = np.zeros(count)
        error_sum = np.zeros(count)
        command = forward[0].copy()
        least = case.chain.encoder
        # A coarse encoder's speed has to be smoothed more, or the motor chatters.
        smooth = 1 - np.exp(-2 * np.pi * (40.0 if least < 1e-3 else 15.0) * 2 * STEP)
        every = round(2 * STEP / dt)
        hits = [
            (robot.index(push.joint), push.start, push.seconds, pushes.get(n, 0.0))
            for n, push in enumerate(case.pushes)
            if push.trial == plan.number
        ]
        angles, speeds, pulls, applied = data.qpos, data.qvel, data.qacc, data.qfrc_applied
        for k in range(len(time)):
            q_real, v = angles[dofs], speeds[dofs]
            q = q_real + self.offset
            if k % every == 0:
                now = np.round(q / least) * least
                speed += smooth * ((now - seen) / (every * dt) - speed)
                seen = now
                error = q_want[k] - now
                error_sum += error * (every * dt)
                command = forward[k] + spring * error + damper * (v_want[k] - speed)
                command = command + integral * error_sum
            total[:] = late(command)
            known = forces.add(k, q_real, v, data, total, q)
            for joint, begin, length, peak in hits:
                total[joint] += peak * bump((time[k] - begin) / length)
            applied[:] = 0
            applied[dofs] = total
            forces.far_side(data)
            q_out[k], v_out[k], e_out[k] = q, v, command
            mujoco.mj_step(real, data)
            a_out[k] = pulls[dofs]
            k_out[k] = known + forces.solver_friction(data)
        if not np.all(np.isfinite(q_out)) or np.max(np.abs(q_out - q_want)) > 1.2:
            raise FlightError(f"{case.name}, trial {plan.number}")
        return Trial(time=time, q=q_out, v=v_out, a=a_out, effort=e_out, known=k_out)

    def missing(self, trial: Trial, every: int = 5) -> Signal:
        """Return the torque that the declared model lacks at every so manieth step: the truth."""
        part = slice(None, None, every)
        need = inverse(self.declared, trial.q[part], trial.v[part], trial.a[part])
        return np.asarray(need - trial.effort[part] - trial.known[part])


class _Forces:
    """All torque beside the motors'."""

    def __init__(self, case: Case, bench: Bench, start: float) -> None:
        self.case, self.robot, self.bench = case, case.robot, bench
        names = case.robot.names
        self.limb = case.robot.limb
        self.at_limb = names.index(self.limb.joint) if self.limb else -1
        self.step = bench.step
        #: Declared friction's share of what the solver holds.
        self.levels: dict[int, list[Fault]] = {}
        self.smooth: list[tuple[int, int, Law]] = []
        for number, fault in enumerate(case.faults):
            joint = names.index(fault.joint)
            here = case.robot.joints[joint]
            other = names.index(fault.other) if fault.other else joint
            law = Law(
                fault, (here.low, here.high), self.limb, start, bench.duration, bench.step,
                case.rng(f"law {number}", round(start * 1000)),
            )  # fmt: skip
            if is_friction(fault):
                self.levels.setdefault(joint, []).append(fault)
            self.smooth.append((joint, other, law))
        self.known = {names.index(name): value for name, value in case.declared.items()}
        self.bristles = {
            joint: Bristles(case.presliding)
            for joint in {*self.levels, *self.known}
            if case.presliding
        }
        self.friction_share = np.zeros(len(names))
        self.far_torque: tuple[int, float] | None = None

    def add(
        self, k: int, q: Signal, v: Signal, data: mujoco.MjData, total: Signal, seen: Signal
    ) -> Signal:
        """Add limb, faults and friction to the torque; return what of it is declared."""
        known = np.zeros(len(total))
        extra = np.zeros(len(total))
        self.far_torque = None
        q_far = q.copy()
        v_far = v.copy()
        for joint, dof in enumerate(self.bench.far):
            if dof >= 0:
                q_far[joint] += data.qpos[dof]
                v_far[joint] += data.qvel[dof]
        behind = 0.0
        for joint, other, law in self.smooth:
            of_limb = joint == self.at_limb and law.fault.name in OF_LIMB
            place, pace = (q_far, v_far) if of_limb else (q, v)
            torque = law.torque(k, float(place[joint]), float(pace[joint]), float(q[other]))
            extra[joint] += torque
            behind += torque if of_limb else 0.0
        load = total.copy()
        if self.limb is not None:
            one = self.at_limb
            torque = -self.limb.stiffness * (q_far[one] - self.limb.neutral)
            torque -= self.limb.damping * v_far[one]
            known[one] = (
                -self.limb.stiffness * (seen[one] - self.limb.neutral) - self.limb.damping * v[one]
            )
            dof = int(self.bench.far[one])
            if dof >= 0:
                # Behind a spring or gap the limb acts on the link, not on the motor.
                self.far_torque = (dof, float(torque) + behind)
            extra[one] += torque
        total += extra
        self._friction(q, v, load, total, known)
        return known

    def _friction(self, q: Signal, v: Signal, load: Signal, total: Signal, known: Signal) -> None:
        model = self.bench.real
        for joint in {*self.levels, *self.known}:
            rate, force = float(v[joint]), abs(float(load[joint]))
            mine = sum(
                friction_level(fault, float(q[joint]), rate, force)
                for fault in self.levels.get(joint, [])
            )
            coulomb, viscous = self.known.get(joint, (0.0, 0.0))
            level = max(mine + coulomb, 1e-9)
            self.friction_share[joint] = coulomb / level
            total[joint] -= viscous * rate
            known[joint] -= viscous * rate
            if joint in self.bristles:
                torque = self.bristles[joint].torque(level, rate, self.step)
                total[joint] += torque
                known[joint] += torque * coulomb / level
            else:
                model.dof_frictionloss[self.bench.dofs[joint]] = level

    def solver_friction(self, data: mujoco.MjData) -> Signal:
        """Return what of the solver's friction is declared; after a step."""
        if self.bristles or not self.known:
            return np.zeros(len(self.friction_share))
        return np.asarray(self.friction_share * data.qfrc_constraint[self.bench.dofs])

    def far_side(self, data: mujoco.MjData) -> None:
        """Apply the limb's torque to the link behind a spring, too."""
        if self.far_torque is not None:
            dof, torque = self.far_torque
            data.qfrc_applied[dof] += torque


class _ActuatorPath:
    """Gain, dead time and lag between a command and the joint."""

    def __init__(self, case: Case, step: float) -> None:
        names = case.robot.names
        self.gain = np.ones(len(names))
        self.keep = np.zeros(len(names))
        self.queues: list[tuple[int, deque[float]]] = []
        self.state: Signal | None = None
        self.lengths = {}
        for fault in case.faults:
            joint = names.index(fault.joint)
            match fault.name:
                case "torque_gain":
                    self.gain[joint] = 1 + fault.value("excess")
                case "actuator_lag":
                    self.keep[joint] = np.exp(-step / fault.value("seconds"))
                case "time_delay":
                    self.lengths[joint] = max(1, round(fault.value("seconds") / step))

    def __call__(self, command: Signal) -> Signal:
        if self.state is None:
            self.state = command * self.gain
            self.queues = [(j, deque([command[j]] * n)) for j, n in self.lengths.items()]
        wanted = command.copy()
        for joint, queue in self.queues:
            queue.append(float(command[joint]))
            wanted[joint] = queue.popleft()
        self.state = self.keep * self.state + (1 - self.keep) * (wanted * self.gain)
        return self.state


def inverse(model: mujoco.MjModel, q: Signal, v: Signal, a: Signal) -> Signal:
    """Return the torque that a motion needs, (samples, joints) Nm."""
    data = mujoco.MjData(model)
    torque = np.empty_like(q)
    with_limits = model.opt.disableflags
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    angles, speeds, pulls, need = data.qpos, data.qvel, data.qacc, data.qfrc_inverse
    for k in range(len(q)):
        angles[:], speeds[:], pulls[:] = q[k], v[k], a[k]
        mujoco.mj_inverse(model, data)
        torque[k] = need
    model.opt.disableflags = with_limits
    return torque
