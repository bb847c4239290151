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

UP = (np.pi / 2, np.pi / 2)
"""Angles of the front and the rear flippers out of the way [rad]."""
STAIRS = (0.3, 0.0)
"""The same on stairs [rad]."""
FACE = 0.5
"""Place of a step's face, x [m]."""
SIZE = 50.0
"""Half of the ground's size [m]."""
DEPTH = 0.5
"""Half of a step's height [m]."""


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
        centre = (ahead, 0.0, self.view.height)
        return line_contact(self.half_gauge, self.half_length, friction, friction, centre)


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
    x, z = centre_of_mass
    spec = mujoco.MjSpec()
    ground = terrain.add_to(spec)
    body = spec.worldbody.add_body(name="box")
    body.add_freejoint()
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=half_size,
        pos=[x, 0, z],
        mass=mass,
        contype=0,
        conaffinity=0,
    )
    friction = (terrain.friction, terrain.friction)
    track = Track(half_gauge=half_gauge, hull=hull, preset=preset, friction=friction)
    add_tracks(spec, "box", track, terrain=ground)
    model = spec.compile()
    view = SideView(np.array(hull), (x, z))
    return Robot(
        model=model,
        belts=Belts(model),
        track_side=np.arange(2),
        qpos=np.array([0.0, 0.0, -view.ground, 1.0, 0.0, 0.0, 0.0]),
        control=np.zeros(0),
        half_gauge=half_gauge,
        view=view,
    )


def rescue(terrain, preset, flippers=UP):
    """The rescue robot with its flippers at these angles, front and rear [rad]."""
    robot = load_tracked("rescue")
    built = build_tracked(robot, terrain, preset=preset)
    model = built.model
    front, rear = flippers
    control = np.zeros(model.nu)
    control[built.flipper_motor] = built.flipper_control(
        np.where(built.flippers.front, front, rear)
    )
    qpos = model.qpos0.copy()
    qpos[built.flipper_qpos] = control[built.flipper_motor]
    qpos[:7] = [0, 0, -robot.lowest, 1, 0, 0, 0]
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    root = model.body_rootid[built.body]
    x, _, z = data.subtree_com[root] - data.xpos[built.body]
    return Robot(
        model=model,
        belts=built.belts,
        track_side=built.track_side,
        qpos=qpos,
        control=control,
        half_gauge=robot.half_gauge,
        view=SideView(np.array(robot.hull), (float(x), float(z))),
    )


class Trial:
    """N robots that start at rest at the origin."""

    def __init__(self, robot: Robot, size: int, heading=0.0):
        self.robot = robot
        self.size = size
        self.timestep = robot.model.opt.timestep
        self.batch = batch.Batch(robot.model, size, nthread=1)
        self.belts = robot.belts.bind_batch(self.batch)
        self.batch.qpos[:] = robot.qpos
        if robot.model.nu:
            self.batch.ctrl[:] = robot.control
        # live views
        self.position = self.batch.qpos[:, :3]
        self.quaternion = self.batch.qpos[:, 3:7]
        self.velocity = self.batch.qvel[:, :3]
        half = np.divide(heading, 2)
        self.quaternion[:, 0] = np.cos(half)
        self.quaternion[:, 3] = np.sin(half)
        self.gravity = self.batch.expand("opt.gravity")

    def drive(self, speeds):
        """Set the belts' speeds, (2,) or (N, 2), left and right [m/s]; flippers' belts follow their
        side.
        """
        of_sides = np.broadcast_to(speeds, (self.size, 2))
        self.belts.set(of_sides[:, self.robot.track_side])

    def tilt(self, slope):
        """Turn gravity as on slopes (N,) that rise along x [rad]."""
        down = np.column_stack([-np.sin(slope), np.zeros(self.size), -np.cos(slope)])
        self.gravity[:] = 9.81 * down

    def advance(self, duration, rows=None):
        """Simulate all robots, or those of `rows` (N,) bool [s]."""
        steps = max(1, round(duration / self.timestep))
        self.batch.step(ids=rows, nstep=steps)

    def heading(self):
        w, x, y, z = self.quaternion.T
        return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))

    def centre_of_mass(self):
        w, x, y, z = self.quaternion.T
        ahead, up = self.robot.view.centre_of_mass
        x_of_ahead = 1 - 2 * (y * y + z * z)  # of the robot's forward axis in the world
        x_of_up = 2 * (x * z + w * y)
        return self.position[:, 0] + ahead * x_of_ahead + up * x_of_up

    def lean(self):
        """Angles (N,) between the robots' vertical axes and the ground's normal [rad]."""
        _, x, y, _ = self.quaternion.T
        z_of_up = 1 - 2 * (x * x + y * y)
        return np.arccos(np.clip(z_of_up, -1, 1))


def limit(holds, low, high, rows, rounds=2):
    """The value from `low` to `high` up to which `holds`, of values (rows,), is true; NaN if that
    is not between.
    """
    for k in range(rounds):
        # the ends are known after the first round
        values = np.linspace(low, high, rows) if k == 0 else np.linspace(low, high, rows + 2)[1:-1]
        is_held = holds(values)
        first = rows if is_held.all() else int(np.argmin(is_held))  # that isn't held
        if k == 0 and first in (0, rows):
            return float("nan")
        if first > 0:
            low = values[first - 1]
        if first < rows:
            high = values[first]
    return float(low + high) / 2
