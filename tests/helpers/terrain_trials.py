"""Robots on terrain: a box with two tracks and the rescue robot, N copies side by side."""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from climbing_theory import SideView
from mujoco import batch

from sim import build_tracked, load_tracked
from sim.tracks import Belts, Track, add_tracks
from trackslip.skid_theory import line_contact

UP, STAIRS = (np.pi / 2, np.pi / 2), (0.3, 0.0)
"""Angles of the front and the rear flippers: out of the way, and on stairs [rad]."""
FACE = 0.5
"""Place of a step's face, x [m]."""
SIZE, DEPTH = 50.0, 0.5  # half of the ground's size and of a step's height [m]


@dataclass(frozen=True)
class LevelGround:
    """Level ground at z = 0, with a step at FACE whose height is set in the model."""

    friction: float = 0.7
    step: bool = False

    def add_to(self, spec: Any) -> list[str]:
        spec.worldbody.add_geom(
            name="ground", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[SIZE, SIZE, 1]
        )
        if not self.step:
            return ["ground"]
        box = {
            "type": mujoco.mjtGeom.mjGEOM_BOX,
            "size": [SIZE, SIZE, DEPTH],
            "pos": [FACE + SIZE, 0, -DEPTH],
        }
        spec.worldbody.add_geom(name="step", **box)
        return ["ground", "step"]


@dataclass(frozen=True)
class Robot:
    """A compiled robot on its terrain, its flippers held, and its numbers for the theory."""

    model: mujoco.MjModel
    belts: Any
    track_side: np.ndarray  # (T,) 0 left, 1 right
    qpos: np.ndarray  # (nq,) at the origin, its tracks on z = 0; the first seven are its pose
    control: np.ndarray  # (nu,) that holds the flippers
    half_gauge: float
    view: SideView

    @property
    def half_length(self):
        return float(np.diff(self.view.touching)[0]) / 2

    def line_contact(self, friction):
        ahead = self.view.centre_of_mass[0] - float(np.mean(self.view.touching))
        return line_contact(
            self.half_gauge, self.half_length, friction, friction, (ahead, 0.0, self.view.height)
        )


def box(
    terrain,
    preset,
    hull=((-0.25, 0.07, 0.07), (0.25, 0.07, 0.07)),
    centre_of_mass=(0.0, 0.12),
    half_gauge=0.2,
    mass=25.0,
    half_size=(0.22, 0.16, 0.05),
):
    """A box with two tracks; its centre of mass is ahead and above the ground by `centre_of_mass`
    [m].
    """
    (x, z), spec = centre_of_mass, mujoco.MjSpec()
    ground = terrain.add_to(spec)
    body = spec.worldbody.add_body(name="box")
    body.add_freejoint()
    shape = {"size": half_size, "pos": [x, 0, z], "mass": mass, "contype": 0, "conaffinity": 0}
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, **shape)
    friction = (terrain.friction, terrain.friction)
    given = {"half_gauge": half_gauge, "hull": hull, "preset": preset, "friction": friction}
    add_tracks(spec, "box", Track(**given), terrain=ground)
    model, view = spec.compile(), SideView(np.array(hull), (x, z))
    qpos = np.array([0.0, 0.0, -view.ground, 1.0, 0.0, 0.0, 0.0])
    return Robot(model, Belts(model), np.arange(2), qpos, np.zeros(0), half_gauge, view)


def rescue(terrain, preset, flippers=UP):
    robot = load_tracked("rescue")
    built = build_tracked(robot, terrain, preset=preset)
    model, control = built.model, np.zeros(built.model.nu)
    control[built.flipper_motor] = built.flipper_control(np.where(built.flippers.front, *flippers))
    qpos = model.qpos0.copy()
    qpos[built.flipper_qpos] = control[built.flipper_motor]
    qpos[:7] = [0, 0, -robot.lowest, 1, 0, 0, 0]
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    x, _, z = data.subtree_com[model.body_rootid[built.body]] - data.xpos[built.body]
    view = SideView(np.array(robot.hull), (float(x), float(z)))
    return Robot(model, built.belts, built.track_side, qpos, control, robot.half_gauge, view)


class Trial:
    """N robots that start at rest at the origin."""

    def __init__(self, robot: Robot, size: int, heading=0.0):
        self.robot, self.size, self.timestep = robot, size, robot.model.opt.timestep
        self.batch = batch.Batch(robot.model, size, nthread=1)
        self.belts = robot.belts.bind_batch(self.batch)
        self.batch.qpos[:] = robot.qpos
        if robot.model.nu:
            self.batch.ctrl[:] = robot.control
        self.position, self.quaternion = self.batch.qpos[:, :3], self.batch.qpos[:, 3:7]  # live
        self.velocity = self.batch.qvel[:, :3]  # live
        self.quaternion[:, 0], self.quaternion[:, 3] = (
            np.cos(np.divide(heading, 2)),
            np.sin(np.divide(heading, 2)),
        )
        self.gravity = self.batch.expand("opt.gravity")

    def drive(self, speeds):
        """Set the belts' speeds, (2,) or (N, 2), left and right [m/s]; flippers' belts follow their
        side.
        """
        self.belts.set(np.broadcast_to(speeds, (self.size, 2))[:, self.robot.track_side])

    def tilt(self, slope):
        """Turn gravity as on slopes (N,) that rise along x [rad]."""
        self.gravity[:] = 9.81 * np.column_stack(
            [-np.sin(slope), np.zeros(self.size), -np.cos(slope)]
        )

    def advance(self, duration, rows=None):
        """Simulate all robots, or those of `rows` (N,) bool [s]."""
        self.batch.step(ids=rows, nstep=max(1, round(duration / self.timestep)))

    def heading(self):
        w, x, y, z = self.quaternion.T
        return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))

    def centre_of_mass(self):
        """Places (N,) of the centres of mass along x [m]."""
        w, x, y, z = self.quaternion.T
        ahead, up = self.robot.view.centre_of_mass
        return self.position[:, 0] + ahead * (1 - 2 * (y * y + z * z)) + up * 2 * (x * z + w * y)

    def lean(self):
        """Angles (N,) between the robots' vertical axes and the ground's normal [rad]."""
        _, x, y, _ = self.quaternion.T
        return np.arccos(np.clip(1 - 2 * (x * x + y * y), -1, 1))


def limit(holds, low, high, rows, rounds=2):
    """The value from `low` to `high` up to which `holds`, of values (rows,), is true; NaN if that
    is not between.
    """
    for k in range(rounds):
        values = np.linspace(low, high, rows) if k == 0 else np.linspace(low, high, rows + 2)[1:-1]
        held = holds(values)
        first = rows if held.all() else int(np.argmin(held))
        if k == 0 and first in (0, rows):
            return float("nan")
        low, high = values[first - 1] if first > 0 else low, values[first] if first < rows else high
    return float(low + high) / 2
