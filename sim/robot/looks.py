"""How robots are drawn on the paper's field and on terrain, and the camera that follows them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from sim.robot.named import load_tracked
from sim.robot.parameters import WHEELS, RobotParameters
from sim.robot.robot import BODY_LOOKS, shaped_robot
from sim.robot.tracked import TrackedRobot
from sim.robot.tracked_model import TrackedModel, build_tracked, chassis_of, clear_angles, load_spec
from sim.robot.urdf import engine_errors
from sim.robot.wheels import start
from sim.tracks.drawing import TrackLook, draw
from trackslip.kinematics import Array

# the camera looks at the robot from the right, slightly ahead of it [deg]
_AZIMUTH, _ELEVATION = 106.0, -21.0
_AWAY = 2.8  # distance of the camera from the robot, in robot lengths
_CALM = 0.6  # share of the robot's heave that the camera follows

# shipped robot: wheels x, z, radius; belt's width [m]
_WHEELS, _BELT = ((-0.2, 0.07, 0.07), (0.2, 0.07, 0.07)), 0.09
_TYRE = 0.76  # ratio of a wheel's drawn width to its radius [-]
_ATTACHED = "robot/"  # prefix of all names that come from a tracked robot's model


@dataclass(frozen=True)
class RobotLooks:
    """The model of a robot to draw, and the looks of its tracks."""

    model: mujoco.MjModel  # without the tracks
    body: int  # the chassis
    # name, body and look of each track: left, right, then the flippers'
    tracks: list[tuple[str, int, TrackLook]]
    track_side: np.ndarray  # (T,) side whose speed each track's belt follows: 0 left, 1 right
    rest: Array  # (nq,) positions of all joints, with the chassis at the origin

    @classmethod
    def of(cls, world: TrackedModel) -> RobotLooks:
        """The looks of a robot on its terrain; `world` must have been built with `looks=True`."""
        model = world.model
        tracks = []
        for k, track in enumerate(world.tracks):
            gear = track.gear.gear
            body = model.body(track.gear.body).id
            y = track.y
            if not track.gear.frame.is_bodys:  # the track has a frame of its own
                body = int(world.belts.bodies[k])
                y = 0.0
            look = TrackLook(np.array(track.gear.hull), y, gear.width, gear.contact != WHEELS)
            tracks.append((f"{world.belts.names[k]}_track", body, look))
        return cls(model, world.body, tracks, world.track_side, start(model).qpos.copy())

    def draw(self, scene: mujoco.MjvScene, data: mujoco.MjData, travel: Array) -> None:
        """Append the tracks to a scene, for belts that have travelled `travel` (T,) forwards
        [m].
        """
        for (_, body, look), way in zip(self.tracks, travel, strict=True):
            draw(scene, look.pieces(way), data.xpos[body], data.xmat[body].reshape(3, 3))

    def camera(self, data: mujoco.MjData, height: float = 0.0) -> mujoco.MjvCamera:
        """A camera that follows the robot without turning; `height` is that of the ground [m]."""
        x, _, radius = np.array([wheel for _, _, look in self.tracks for wheel in look.hull]).T
        length = float((x + radius).max() - (x - radius).min())
        camera = mujoco.MjvCamera()
        x, y, z = data.xpos[self.body]
        camera.lookat[:] = x, y, height + _CALM * (z - height) + length / 6
        camera.distance, camera.azimuth, camera.elevation = _AWAY * length, _AZIMUTH, _ELEVATION
        return camera

    def qpos(self, pose: Array) -> Array:
        """Positions (..., nq) of all joints of robots on level ground at poses (..., 3) [m, m,
        rad].
        """
        qpos = np.tile(self.rest, (*pose.shape[:-1], 1))
        qpos[..., :2] = pose[..., :2]
        qpos[..., 3], qpos[..., 6] = np.cos(pose[..., 2] / 2), np.sin(pose[..., 2] / 2)
        return qpos


def robot_looks(parameters: RobotParameters, colour: Sequence[float] = ()) -> RobotLooks:
    """The looks of a robot, in its own colours or in one `colour` (4,); raises TrackslipError if
    its file is gone.
    """
    spec = shaped_robot(parameters)
    looks = (
        _tracked_looks(spec, parameters.looks)
        if parameters.looks
        else _shipped_looks(spec, parameters)
    )
    model = looks.model
    if len(colour):
        painted = [model.geom("plate").id]
        if parameters.looks:
            painted += np.flatnonzero(
                model.body_rootid[model.geom_bodyid] == model.body("chassis").id
            ).tolist()
        else:
            painted.append(model.geom("hull").id)
        model.geom_rgba[painted], model.geom_matid[painted] = colour, -1
    return looks


def _shipped_looks(spec: Any, parameters: RobotParameters) -> RobotLooks:
    model = spec.compile()
    body, radius = model.body("chassis").id, parameters.sprocket_radius
    part, hull, width = "track", np.array(_WHEELS), _BELT
    if parameters.axles:
        part, hull, width = (
            "wheels",
            np.array([(x, radius, radius) for x in parameters.axles]),
            _TYRE * radius,
        )
    sides = (("left", parameters.half_gauge), ("right", -parameters.half_gauge))
    tracks = [
        (f"{side}_{part}", body, TrackLook(hull, y, width, not parameters.axles))
        for side, y in sides
    ]
    return RobotLooks(model, body, tracks, np.arange(len(tracks)), model.qpos0.copy())


def _tracked_looks(spec: Any, source: str) -> RobotLooks:
    """The looks of the robot with this name or file, on the field's chassis, with its flippers off
    the ground.
    """
    robot = load_tracked(source)
    with engine_errors(robot.model):
        return _attached_looks(spec, robot)


def _attached_looks(spec: Any, robot: TrackedRobot) -> RobotLooks:
    """The looks of a robot, attached to the field's chassis in `spec`."""
    built, own = build_tracked(robot, looks=True), load_spec(robot, looks=True)
    body = chassis_of(own, robot)
    for joint in list(body.joints):
        own.delete(joint)
    own.compile()  # so that the model's keyframe is attached, too
    body.pos = [0.0, 0.0, 0.0]
    body.quat = [1.0, 0.0, 0.0, 0.0]
    body.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    for frame, track in zip(built.belts.bodies.tolist(), built.tracks, strict=True):
        if not track.gear.frame.is_bodys:
            carrier = own.body(track.gear.body)
            place = built.model.body_pos[frame]
            turn = built.model.body_quat[frame]
            carrier.add_body(name=built.model.body(frame).name, pos=place, quat=turn)
    for name in BODY_LOOKS:
        spec.delete(spec.geom(name))
    _agree(own, spec)
    middle = [-robot.middle, -robot.offset, -robot.lowest]
    frame = spec.body("chassis").add_frame(pos=middle)
    frame.attach_body(body, _ATTACHED, "")
    model = spec.compile()
    looks = RobotLooks.of(built)
    tracks = [
        (name, model.body(_ATTACHED + built.model.body(carrier).name).id, look)
        for name, carrier, look in looks.tracks
    ]
    rest = start(model).qpos.copy()
    rest[:7] = model.qpos0[:7]
    angles = built.flipper_control(clear_angles(built))
    joints = [name_at(built.model, place) for place in built.flipper_qpos]
    hinges = [model.joint(_ATTACHED + name).qposadr[0] for name in joints]
    rest[hinges] = angles
    return RobotLooks(model, model.body("chassis").id, tracks, looks.track_side, rest)


def name_at(model: mujoco.MjModel, place: int) -> str:
    """Name of the joint whose position is at a place in qpos."""
    return str(model.joint(int(np.flatnonzero(model.jnt_qposadr == place)[0])).name)


def _agree(spec: Any, field: Any) -> None:
    """Copy the field's options to a spec, so that the engine doesn't warn about differences."""
    kinds = ("global_", "quality", "headlight", "map", "scale", "rgba")
    pairs = [
        (spec.option, field.option),
        *((getattr(spec.visual, k), getattr(field.visual, k)) for k in kinds),
    ]
    for own, like in pairs:
        for name in (name for name in dir(own) if not name.startswith("_")):
            setattr(own, name, getattr(like, name))
