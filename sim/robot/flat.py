"""Robots for flat ground: the parameters of a tracked robot that stands on a plane.

The plane engine has one rigid body on two rows of pads, so it takes robots on one pair of tracks or
rows of wheels. Others are refused by the name of what it can't have.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from typing import Any, Final

import mujoco
import numpy as np

from sim.robot.gear import BOTH, SKID
from sim.robot.joint_rules import FREE
from sim.robot.parameters import WHEELS, RobotParameters
from sim.robot.robot import composite
from sim.robot.tracked import TrackedRobot
from sim.robot.tracked_model import (
    TrackedModel,
    build_tracked,
    clear_angles,
    lowest_of_flippers,
)
from sim.robot.urdf import engine_errors, some
from sim.robot.wheels import outline, start
from trackslip.errors import InvalidValueError, RobotWarning, TrackslipError

_PLATE_ABOVE: Final = 0.1  # least height of the plate's lower edge above the robot's top [m]
_PLATE_HALF_HEIGHT: Final = 0.1  # from models/tracked_robot.xml [m]
# height of a flipper above the ground up to which it may bear weight, as tracks sink in by
# 0.34 mm (`accurate`) to 1.25 mm (`fast`) [m]
_TOUCHING: Final = 1e-3
_ROUNDING: Final = 1e-12  # of coordinates, which are sums over some tens of links [m]
_GRAVITY: Final = (0.0, 0.0, -9.81)  # of the plane engine, from models/field.xml [m/s^2]
# difference from it of values that models have for the Earth, from 9.78 to 9.83 [m/s^2]
_SAME_GRAVITY: Final = 0.05
_SETTLED: Final = 1.0  # time after which a robot that is put down stands [s]
_TERRAIN: Final = "`trackslip drive` and Traverse-v0 simulate the whole robot"


def on_flat_ground(robot: TrackedRobot, looks: str = "") -> RobotParameters:
    """The parameters of a tracked robot on level ground: a rigid body that stands on the longest
    runs of its tracks.

    Its joints stay in their starting positions, its flippers as low as possible without touching
    the ground. Its frame is in the middle of the runs, its sprockets are as large as its largest
    wheels, and the plate stands above the rest of the robot. It is drawn as the robot with the name
    or file `looks`. A RobotWarning is issued if its flippers bear weight or joints swing.

    Raises InvalidValueError for a robot out of range or that doesn't stand on two wheels of each
    track, TrackslipError for a model that can't be compiled, and for running gear that isn't one
    pair of tracks.
    """
    if reason := beyond_the_plane(robot):
        raise TrackslipError(
            f"{robot.model}: flat ground takes one pair of tracks or rows of wheels on the "
            f"chassis, but {reason}; {_TERRAIN}"
        )
    built = build_tracked(robot, looks=True)
    model = built.model
    with engine_errors(robot.model):
        data = standing(built)
        own = np.flatnonzero(model.body_rootid == built.body)
        mass, (x, y, z), total = composite(model, data, own)
        shapes = np.flatnonzero(model.body_rootid[model.geom_bodyid] == built.body).tolist()
        top = max(float(outline(model, data, data.body(0), shape)[:, 2].max()) for shape in shapes)
        _warn_of_what_differs(built, data)
    (track_width,) = {gear.width for gear in robot.gear if gear.flipper is None}
    contact: dict[str, Any] = {"contact_length": robot.contact_length}
    if robot.contact == WHEELS:
        axles = tuple(axle - robot.middle for axle in robot.standing)
        contact = {"contact": WHEELS, "axles": axles, "patch_length": robot.patch_length}
    try:
        return RobotParameters(
            half_gauge=robot.half_gauge,
            **contact,
            sprocket_radius=robot.sprocket_radius,
            radius_error=0.0,
            mass=mass,
            com_x=without_rounding(x),
            com_y=without_rounding(y),
            com_height=float(z),
            inertia=tuple(total[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]].tolist()),
            plate_height=max(RobotParameters.plate_height, top + _PLATE_ABOVE + _PLATE_HALF_HEIGHT),
            looks=looks,
            track_width=track_width,
            drive=robot.drive,
        )
    except InvalidValueError as error:
        if not error.field.startswith("com_"):
            raise
        way_on = f"{error.allowed}: fold its arm by [joints] or `key`; {_TERRAIN}"
        raise InvalidValueError(error.field, error.value, way_on) from error


def beyond_the_plane(robot: TrackedRobot) -> str:
    """What the plane engine can't have of a robot's running gear, "" if it can have all."""
    bearing = [gear for gear in robot.gear if gear.flipper is None]
    if not bearing:
        return "it stands on its flippers"
    if len(bearing) > 1:
        names = [gear.body or robot.body or "the chassis" for gear in bearing]
        return f"it has {len(bearing)} entries of running gear, on {some(names)}"
    (gear,) = bearing
    if gear.body not in ("", robot.body):
        return f"its running gear is on {gear.body}"
    if gear.sides != BOTH:
        return f"its only running gear is on the side {gear.sides!r}"
    if gear.contact == SKID:
        return "it stands on skids only"
    if gear.drive:
        return f"its running gear has drive = {gear.drive!r}"
    if gear.aside:
        halves = [f"{gear.places[0] - robot.offset + aside:g}" for aside in gear.aside]
        return f"its axles have different half gauges, {', '.join(halves)} m"
    if gear.contact == WHEELS and len(set(robot.standing)) < 2:
        return f"its wheels {gear.origin} stand on one axle only".replace("  ", " ")
    return ""


def _vector(values: Iterable[float]) -> str:
    """A vector's numbers, for messages."""
    return f"({', '.join(f'{value:g}' for value in values)})"


def without_rounding(coordinate: float) -> float:
    """A coordinate of the centre of mass [m], 0 for what is only the error of rounding."""
    return 0.0 if abs(coordinate) < _ROUNDING else float(coordinate)


def standing(built: TrackedModel) -> mujoco.MjData:
    """Data of a robot that stands on level ground, with the middle of its runs at the origin."""
    robot, data, first = built.robot, start(built.model), built.free[0]
    place = [-robot.middle, -robot.offset, -robot.lowest]
    data.qpos[first : first + 7] = [*place, 1.0, 0.0, 0.0, 0.0]
    data.qpos[built.flipper_qpos] = built.flipper_control(clear_angles(built))
    mujoco.mj_kinematics(built.model, data)
    mujoco.mj_comPos(built.model, data)
    return data


def _warn_of_what_differs(built: TrackedModel, data: mujoco.MjData) -> None:
    """Issue a RobotWarning for gravity that isn't the Earth's, for flippers that bear weight and
    for joints that swing on terrain.
    """
    robot = built.robot
    gravity = built.model.opt.gravity
    if np.linalg.norm(gravity - _GRAVITY) > _SAME_GRAVITY:
        what = (
            f"its gravity, {_vector(gravity)} m/s^2, counts on terrain; flat ground has "
            f"{_vector(_GRAVITY)} m/s^2"
        )
        warnings.warn(f"{robot.model}: {what}", RobotWarning, stacklevel=3)
    if swinging := built.joints.named(FREE):
        what = f"{some(swinging)} swing freely on terrain, but keep their start on flat ground"
        warnings.warn(f"{robot.model}: {what}", RobotWarning, stacklevel=3)
    if not built.flipper_names:
        return
    if (lowest_of_flippers(built, data) > robot.lowest + _TOUCHING).all():
        return
    share = share_on_flippers(built, data)
    if share > 0.0:
        what = (
            f"its flippers bear {share:.0%} of its weight on level ground, even as high as they "
            "start; flat ground leaves that out, so its turns differ from those on terrain"
        )
        warnings.warn(f"{robot.model}: {what}", RobotWarning, stacklevel=3)


def share_on_flippers(built: TrackedModel, data: mujoco.MjData) -> float:
    """Share of the weight on the flippers of a robot that stands on level ground [-].

    `built` has no terrain but a plane; `data` is where the robot is put down.
    """
    model = built.model
    tried = mujoco.MjData(model)
    tried.qpos[:] = data.qpos
    tried.ctrl[built.flipper_motor] = data.qpos[built.flipper_qpos]
    built.belts.set(np.zeros(len(built.belts.names)))
    mujoco.mj_step(model, tried, nstep=round(_SETTLED / model.opt.timestep))
    load = built.belts.read(tried).load
    on_flippers = [track.gear.gear.flipper is not None for track in built.tracks]
    return float(load[on_flippers].sum() / load.sum())
