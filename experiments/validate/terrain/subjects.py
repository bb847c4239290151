"""The robots that are tried: a box with two tracks, and robots from robot files."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import mujoco
import numpy as np

from sim.robot.named import load_tracked
from sim.robot.tracked import TrackedRobot
from sim.robot.tracked_model import Terrain, build_tracked
from sim.tracks import Belts, Tracks, add_tracks, bind
from trackslip.climbing_theory import SideView
from trackslip.kinematics import Array
from trackslip.skid_theory import Contact, line_contact

Wheels = tuple[tuple[float, float, float], ...]
UP = (np.pi / 2, np.pi / 2)
"""Angles of the front and the rear flippers when they are out of the way [rad]."""
STAIRS = (0.3, 0.0)
"""Angle of the flippers on stairs [rad]."""


@dataclass(frozen=True)
class TerrainRobot:
    """A compiled robot on its terrain, its flippers held, and its numbers for the theory."""

    model: mujoco.MjModel
    tracks: tuple[Tracks, ...]
    belts: Belts
    """Of all tracks, in this order."""
    track_side: np.ndarray  # (T,) 0 left, 1 right: whose command a belt runs with
    free: tuple[int, int]
    """First numbers of the robot's pose in qpos, and of its velocity in qvel."""
    qpos: Array  # (nq,) at the origin, with its tracks on z = 0
    control: Array  # (nu,) that holds the flippers
    half_gauge: float
    """Half the distance between the tracks [m]."""
    width: float
    """Width of the belts on the ground [m]."""
    view: SideView
    """Its tracks and its centre of mass from the side."""

    @property
    def half_length(self) -> float:
        """Half the length of the contact with level ground [m]."""
        return float(np.diff(self.view.touching)[0]) / 2

    def line_contact(self, friction: float) -> Contact:
        """The tracks as two lines on level ground, for the theory of turning."""
        ahead = self.view.centre_of_mass[0] - float(np.mean(self.view.touching))
        centre = (ahead, 0.0, self.view.height)
        return line_contact(self.half_gauge, self.half_length, friction, friction, centre)


class Subject(Protocol):
    """A robot that can be put on terrain."""

    @property
    def name(self) -> str:
        """Name in tables."""

    def stand(
        self, terrain: Terrain, preset: str, shift: float = 0.0, flippers: tuple[float, float] = UP
    ) -> TerrainRobot:
        """Put it on terrain, with its centre of mass `shift` further ahead [m]; a box has no `flippers`."""


@dataclass(frozen=True)
class BoxRobot:
    """A box with two tracks, in a few lines of `add_tracks`."""

    hull: Wheels = ((-0.25, 0.07, 0.07), (0.25, 0.07, 0.07))
    """Wheels (x, z, radius) [m]."""
    centre_of_mass: tuple[float, float] = (0.0, 0.12)
    """Ahead of the box' frame and above the ground [m]."""
    half_gauge: float = 0.2
    """Half the distance between the tracks [m]."""
    mass: float = 25.0
    """[kg]"""
    half_size: tuple[float, float, float] = (0.22, 0.16, 0.05)
    """Of the box, whose density is even [m]."""
    width: float = 0.0
    """Width of the belts on the ground [m]."""
    name: str = "box"

    def stand(
        self, terrain: Terrain, preset: str, shift: float = 0.0, flippers: tuple[float, float] = UP
    ) -> TerrainRobot:
        """See `Subject`."""
        x, z = self.centre_of_mass[0] + shift, self.centre_of_mass[1]
        spec = mujoco.MjSpec()
        ground = terrain.add_to(spec)
        body = spec.worldbody.add_body(name="box")
        body.add_freejoint()
        loose = {"contype": 0, "conaffinity": 0}
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=self.half_size, pos=[x, 0, z], mass=self.mass, **loose)
        friction = (terrain.friction, terrain.friction)
        tracks = add_tracks(
            spec,
            "box",
            half_gauge=self.half_gauge,
            hull=self.hull,
            preset=preset,
            friction=friction,
            width=self.width,
            terrain=ground,
        )
        model = spec.compile()
        view = SideView(np.array(self.hull), (x, z))
        qpos = model.qpos0.copy()
        qpos[2] = -view.ground
        return TerrainRobot(
            model,
            (tracks,),
            bind(model, tracks),
            np.arange(2),
            (0, 0),
            qpos,
            np.zeros(0),
            self.half_gauge,
            self.width,
            view,
        )


@dataclass(frozen=True)
class FromFile:
    """A robot by its name or from its file."""

    source: str
    """Name or file."""

    @cached_property
    def robot(self) -> TrackedRobot:
        """The robot that the file describes."""
        return load_tracked(self.source)

    @property
    def name(self) -> str:
        """See `Subject`."""
        return self.robot.name

    def stand(
        self, terrain: Terrain, preset: str, shift: float = 0.0, flippers: tuple[float, float] = UP
    ) -> TerrainRobot:
        """See `Subject`."""
        robot = self.robot
        built = build_tracked(robot, _Shifted(terrain, robot, shift), preset=preset)
        model, control = built.model, np.zeros(built.model.nu)
        control[built.flipper_motor] = built.flipper_control(np.where(built.flipper_front, *flippers))
        qpos = model.qpos0.copy()
        qpos[built.flipper_qpos] = control[built.flipper_motor]
        position, _ = built.free
        qpos[position : position + 7] = [0, 0, -robot.lowest, 1, 0, 0, 0]
        data = mujoco.MjData(model)
        data.qpos[:] = qpos
        mujoco.mj_forward(model, data)
        x, _, z = data.subtree_com[model.body_rootid[built.body]] - data.xpos[built.body]
        view = SideView(np.array(robot.hull), (float(x), float(z)))
        return TerrainRobot(
            model,
            built.tracks,
            bind(model, *built.tracks),
            built.track_side,
            built.free,
            qpos,
            control,
            robot.half_gauge,
            robot.contact_width,
            view,
        )


@dataclass(frozen=True)
class _Shifted:
    """Terrain for a robot whose heaviest part is moved, so that its centre of mass is `shift` further ahead."""

    terrain: Terrain
    robot: TrackedRobot
    shift: float

    @property
    def friction(self) -> float:
        """See `Terrain`."""
        return self.terrain.friction

    def add_to(self, spec: Any) -> list[str]:
        """See `Terrain`."""
        if self.shift:
            model = spec.copy().compile()
            chassis = model.body(self.robot.body or spec.worldbody.bodies[0].name)
            rigid = np.flatnonzero(model.body_weldid == chassis.id)
            heaviest = model.body(rigid[model.body_mass[rigid].argmax()])  # a URDF's root often has no mass
            data = mujoco.MjData(model)
            mujoco.mj_kinematics(model, data)
            turn = data.body(heaviest.id).xmat.reshape(3, 3).T @ data.body(chassis.id).xmat.reshape(3, 3)
            ahead = self.shift * float(chassis.subtreemass[0]) / float(heaviest.mass[0])
            moved = spec.body(heaviest.name)
            moved.explicitinertial, moved.fullinertia = True, np.full(6, np.nan)  # not given
            moved.mass, moved.inertia, moved.iquat = heaviest.mass[0], heaviest.inertia, heaviest.iquat
            moved.ipos = heaviest.ipos + ahead * turn[:, 0]
        return self.terrain.add_to(spec)


def subjects(robot: str | None) -> tuple[Subject, ...]:
    """The box and the rescue robot, or the robot of a file; raises SettingsFileError for one that can't be read."""
    if robot is None:
        return BoxRobot(), FromFile("rescue")
    load_tracked(robot)
    return (FromFile(robot),)
