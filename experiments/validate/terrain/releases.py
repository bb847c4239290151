"""Robots that are let fall with belts at rest: they must gain no energy, and hardly bounce."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from experiments.validate.terrain.subjects import BoxRobot, Subject, TerrainRobot
from experiments.validate.terrain.trial import LevelGround
from experiments.validate.theory import GRAVITY
from trackslip.kinematics import Array

COUNT = 60
"""Number of releases with each preset: of a robot, or of as many random robots."""
LEAST_GAIN = 1e-6
"""Gain that rounding explains [m]."""
_TILT = float(np.radians(35.0))  # largest roll and pitch [rad]
_SLIGHT = float(np.radians(3.0))  # standard deviation of small ones [rad]
_HIGHEST = 0.3  # highest drop, in lengths of the robot [-]
_SHARE = 0.005  # tolerated gain, of the energy of the drop [-]
_WATCH = 1.5  # time after the first touch, with as many swings of a pendulum as long as the robot [s]


@dataclass(frozen=True)
class Releases:
    """Robots that were let fall, each once tilted and once level."""

    gain: Array  # (N,) largest mechanical energy after tilted releases, minus that at the start, the motors' work and
    # 0.5 % of the drop's energy, over the robot's weight [m]
    rebound: Array  # (N,) height to which level robots rose again, over the drop [-]


def releases(subject: Subject | None, preset: str, rng: np.random.Generator, count: int = COUNT) -> Releases:
    """Release a robot, or random ones, from up to 0.3 of its length, with roll and pitch of up to 35 degrees."""
    found = np.empty((count, 2))
    for k in range(count):
        stand = (subject or random_robot(rng)).stand(LevelGround(), preset)
        roll, steep = rng.uniform(-_TILT, _TILT, 2)
        pitch = rng.choice([steep, rng.normal(0.0, _SLIGHT), 0.0])
        high = 2 * stand.half_length * rng.uniform(0.02, _HIGHEST)
        found[k] = _release(stand, float(rng.choice([high, 1e-3])), roll, pitch)[0], _release(stand, high)[1]
    return Releases(*found.T)


def random_robot(rng: np.random.Generator) -> BoxRobot:
    """A box with tracks of 0.2 to 6 m and a mass of 1 to 5,000 kg, with or without raised noses."""
    length, mass = np.exp(rng.uniform(np.log([0.2, 1.0]), np.log([6.0, 5000.0]))).tolist()
    half_gauge, radius = length * rng.uniform([0.2, 0.03], [0.6, 0.25])
    hull = [(-length / 2, radius, radius), (length / 2, radius, radius)]
    if rng.random() < 0.5:
        nose = radius * rng.uniform(0.4, 1.0)
        ahead, up = radius + length * rng.uniform(0.05, 0.3), radius + length * rng.uniform(0.05, 0.25)
        hull = [(-length / 2 - ahead, up, nose), *hull, (length / 2 + ahead, up, nose)]
    half_size = rng.uniform([0.3, 0.5, 0.05], [0.6, 1.2, 0.25]) * [length, half_gauge, length]
    x, z = length * rng.uniform([-0.15, 0.1], [0.15, 0.35])
    return BoxRobot(tuple(hull), (x, z), float(half_gauge), mass, tuple(half_size.tolist()))


def _release(stand: TerrainRobot, drop: float, roll: float = 0.0, pitch: float = 0.0) -> tuple[float, float]:
    """Gain [m] and rebound [-] of a robot released with its lowest point `drop` above level ground [m, rad]."""
    model, data = stand.model, mujoco.MjData(stand.model)
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    position, _ = stand.free
    data.qpos[:], data.ctrl[:] = stand.qpos, stand.control
    mujoco.mju_euler2Quat(data.qpos[position + 3 : position + 7], [roll, pitch, 0.0], "XYZ")
    mujoco.mj_kinematics(model, data)
    data.qpos[position + 2] += drop - _lowest(stand, data)
    mujoco.mj_forward(model, data)
    start, weight = float(data.energy.sum()), GRAVITY * float(model.body_subtreemass[0])
    swing = np.sqrt(2 * stand.half_length / GRAVITY)
    steps = round((_WATCH * (1 + swing) + 2 * np.sqrt(2 * drop / GRAVITY)) / model.opt.timestep)
    height, gained, work = np.empty(steps), np.empty(steps), 0.0
    for k in range(steps):
        before = data.qvel.copy()
        mujoco.mj_step(model, data)
        gained[k] = float(data.energy.sum()) - start - work  # before the step
        height[k] = data.qpos[position + 2]
        work += float(data.qfrc_actuator @ (before + data.qvel)) / 2 * model.opt.timestep
    landed = int(np.argmin(height))
    rebound = float(height[landed:].max() - stand.qpos[position + 2]) / drop
    return float(gained.max()) / weight - _SHARE * drop, rebound


def _lowest(stand: TerrainRobot, data: mujoco.MjData) -> float:
    """Height of the lowest point of the tracks, which are capsules and spheres [m]."""
    model = stand.model
    geoms = [model.geom(name).id for each in stand.tracks for names in each.geoms for name in names]
    reach = model.geom_size[geoms, 0] + np.abs(data.geom_xmat[geoms, 8]) * model.geom_size[geoms, 1]
    lowest: Array = data.geom_xpos[geoms, 2] - reach
    return float(lowest.min())
