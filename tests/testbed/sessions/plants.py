"""Sessions recorded from a device that MuJoCo simulates under its controller.

Unlike `tests/testbed/sessions/synthetic.py` nothing prescribes the motion: friction sticks, loads
bend the path, and the controller answers. The true model is the declared one with something changed
in it.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

STEP = 0.0005
#: Torque or force beyond the model at (time, positions, velocities).
Beyond = Callable[[float, np.ndarray, np.ndarray], np.ndarray]
#: Corners of a reference are rounded over so many seconds.
ROUND = 0.12


@dataclass(frozen=True, kw_only=True)
class Plant:
    """A declared device, its controller, and how it is moved."""

    mjcf: str
    joints: tuple[str, ...]
    centre: tuple[float, ...]
    amplitude: tuple[float, ...]
    kp: tuple[float, ...]
    kd: tuple[float, ...]
    encoder: float
    noise: float

    def changed(self, old: str, new: str) -> str:
        """Return the true model: the declared one with `new` in the place of `old`."""
        assert old in self.mjcf
        return self.mjcf.replace(old, new)


CARRIAGE = Plant(
    mjcf="""<mujoco>
  <worldbody>
    <body name="carriage">
      <joint name="slide" type="slide" axis="1 0 0" frictionloss="10" damping="20"/>
      <inertial pos="0 0 0" mass="30" diaginertia="0.1 0.1 0.1"/>
    </body>
  </worldbody>
</mujoco>
""",
    joints=("slide",),
    centre=(0.0,),
    amplitude=(0.12,),
    kp=(40000.0,),
    kd=(1800.0,),
    encoder=1e-6,
    noise=1.5,
)
ARM = Plant(
    mjcf="""<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" axis="0 -1 0" armature="0.1"/>
      <inertial pos="0.15 0 0" mass="3" diaginertia="0.01 0.03 0.03"/>
      <body name="fore" pos="0.3 0 0">
        <joint name="elbow" axis="0 -1 0" armature="0.05" frictionloss="0"/>
        <inertial pos="0.13 0 0" mass="1.4" diaginertia="0.003 0.01 0.01"/>
      </body>
    </body>
  </worldbody>
</mujoco>
""",
    joints=("shoulder", "elbow"),
    centre=(-0.4, 0.9),
    amplitude=(0.5, 0.6),
    kp=(400.0, 150.0),
    kd=(30.0, 8.0),
    encoder=2 * np.pi / 2**17,
    noise=0.08,
)
#: The arm with a spring of 900 Nm/rad between the shoulder's motor and its link.
ELASTIC_ARM = ARM.changed(
    """<body name="upper">
      <joint name="shoulder" axis="0 -1 0" armature="0.1"/>""",
    """<body name="motor">
      <joint name="shoulder" axis="0 -1 0" armature="0.1"/>
      <inertial pos="0 0 0" mass="1e-6" diaginertia="1e-9 1e-9 1e-9"/>
      <body name="upper">
      <joint name="spring" axis="0 -1 0" stiffness="900" damping="0.7"/>""",
).replace("</body>\n  </worldbody>", "</body></body>\n  </worldbody>")
#: The same with one of 60 Nm/rad at the elbow, too: the links swing against each other.
LIMP_ARM = ELASTIC_ARM.replace(
    """<body name="fore" pos="0.3 0 0">
        <joint name="elbow" axis="0 -1 0" armature="0.05" frictionloss="0"/>""",
    """<body name="second" pos="0.3 0 0">
        <joint name="elbow" axis="0 -1 0" armature="0.05" frictionloss="0"/>
        <inertial pos="0 0 0" mass="1e-6" diaginertia="1e-9 1e-9 1e-9"/>
        <body name="fore">
        <joint name="second_spring" axis="0 -1 0" stiffness="60" damping="0.08"/>""",
).replace("</body></body>\n  </worldbody>", "</body></body></body>\n  </worldbody>")
#: A limb whose elbow turns about a vertical axis: no gravity weighs it.
LIMB = Plant(
    mjcf="""<mujoco>
  <compiler angle="radian"/>
  <option gravity="0 0 0"/>
  <worldbody>
    <body name="fore">
      <joint name="elbow" axis="0 0 1" armature="0.02" frictionloss="0"/>
      <inertial pos="0.15 0 0" mass="1.4" diaginertia="0.008 0.03 0.03"/>
    </body>
  </worldbody>
</mujoco>
""",
    joints=("elbow",),
    centre=(1.0,),
    amplitude=(0.6,),
    kp=(150.0,),
    kd=(8.0,),
    encoder=2 * np.pi / 2**17,
    noise=0.05,
)


def write_recordings(
    folder: Path,
    plant: Plant,
    seed: int,
    *,
    truth: str = "",
    beyond: Beyond | None = None,
    rate: float = 100.0,
    seconds: float = 8.0,
    trials: int = 3,
) -> None:
    """Simulate trials and a holdout, and write them as a session with the declared model.

    Args:
        folder: made if need be.
        plant: what is declared.
        seed: of references and noise.
        truth: the true model, with further joints if need be; empty: the declared one.
        beyond: what acts on the joints besides.
        rate: of the sensors, Hz.
        seconds: length of a trial.
        trials: how many are fitted.
    """
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "device.xml").write_text(plant.mjcf)
    entries, clock = [], float(rng.uniform(0.0, 50.0))
    names = [
        "time",
        *(f"{joint}.{what}" for what in ("position", "effort") for joint in plant.joints),
    ]
    for number in range(trials + 1):
        reference = np.column_stack(
            [
                centre + amplitude * _to_and_fro(rng, seconds)
                for centre, amplitude in zip(plant.centre, plant.amplitude, strict=True)
            ]
        )
        position, effort = _follow(truth or plant.mjcf, plant, reference, beyond)
        every = slice(None, None, round(1.0 / (rate * STEP)))
        position = np.round(position[every] / plant.encoder) * plant.encoder
        effort = effort[every] + plant.noise * rng.standard_normal(effort[every].shape)
        time = clock + np.arange(len(position)) / rate
        table = np.column_stack([time, position, effort])
        file = f"trial_{number}.csv"
        np.savetxt(
            folder / file, table, fmt="%.9g", delimiter=",", header=",".join(names), comments=""
        )
        entries.append({"file": file, "role": "holdout" if number == trials else "fit"})
        clock = float(time[-1]) + 3.0
    session = {"schema": 1, "model": "device.xml", "declared_effects": [], "trials": entries}
    (folder / "session.json").write_text(json.dumps(session))


def _to_and_fro(rng: np.random.Generator, seconds: float) -> np.ndarray:
    """Return a triangle or a mixture of sines between -1 and 1, from rest and smooth."""
    time = np.arange(0.0, seconds, STEP)
    frequency = rng.uniform(0.1, 0.6)
    if rng.random() < 0.5:
        signal = 2.0 / np.pi * np.arcsin(np.sin(2 * np.pi * frequency * time))
    else:
        parts = [
            rng.uniform(0.4, 1.0) / k * np.sin(2 * np.pi * frequency * k * time + rng.uniform(0, 6))
            for k in (1, 2, 3)
        ]
        signal = np.sum(parts, axis=0)
        signal /= np.abs(signal).max()
    begin = np.clip(time, 0.0, 1.0)
    width = round(ROUND / STEP)
    kernel = np.hanning(2 * width + 1)
    padded = np.pad(signal * begin**2 * (3 - 2 * begin), width, mode="edge")
    return np.convolve(padded, kernel / kernel.sum(), mode="valid")


def _follow(
    mjcf: str, plant: Plant, reference: np.ndarray, beyond: Beyond | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and efforts of a simulated device that follows a reference."""
    model = mujoco.MjModel.from_xml_string(mjcf)
    model.opt.timestep = STEP
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    data = mujoco.MjData(model)
    # A true model may have joints that nobody declared.
    own = [int(model.joint(name).qposadr[0]) for name in plant.joints]
    data.qpos[own] = reference[0]
    mujoco.mj_forward(model, data)
    speed = np.gradient(reference, STEP, axis=0)
    gains = list(zip(own, plant.kp, plant.kd, strict=True))
    position, effort = [], []
    # The same memory at each step, and numbers instead of arrays of one: either takes longer anew
    # than a step.
    q, v, bias, applied = data.qpos, data.qvel, data.qfrc_bias, data.qfrc_applied
    for goal, goal_speed in zip(reference.tolist(), speed.tolist(), strict=True):
        there = [q.item(at) for at in own]
        going = [v.item(at) for at in own]
        torque = [
            bias.item(at) + kp * (goal[n] - there[n]) + kd * (goal_speed[n] - going[n])
            for n, (at, kp, kd) in enumerate(gains)
        ]
        position.append(there)
        effort.append(torque)
        for at, one in zip(own, torque, strict=True):
            applied[at] = one
        if beyond is not None:
            applied[own] += beyond(data.time, np.array(there), np.array(going))
        mujoco.mj_step(model, data)
    return np.array(position), np.array(effort)


def change_efforts(folder: Path, edit: Callable[[np.ndarray], np.ndarray]) -> None:
    """Change the efforts, (n,), of every trial of a session of one joint."""
    for path in sorted(folder.glob("*.csv")):
        header, table = path.read_text().split("\n")[0], np.loadtxt(path, delimiter=",", skiprows=1)
        table[:, 2] = edit(table[:, 2])
        np.savetxt(path, table, delimiter=",", header=header, comments="")
