"""Links that a robot's tracks replace, the outlines of links, and the keyframe from which runs
start.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Collection, Iterable
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.robot.tracked import TrackedRobot
from sim.robot.urdf import some
from trackslip.errors import RobotWarning, TrackslipError
from trackslip.kinematics import Array

_TREAD = 0.1  # height of a wheel's tread from below, relative to the wheel's height [-]
# corners of a box that show its extent in each direction, and its tread below on both sides
_CORNERS: Final = [[-1, -1, -1], [1, 1, 1], [-1, 1, -1]]
_FREE, _GEOM = mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtObj.mjOBJ_GEOM


def switch_off(spec: Any, robot: TrackedRobot) -> None:
    """Keep links in `robot.wheels` from colliding; raises TrackslipError for links that are missing
    in the model.
    """
    for name in robot.wheels:
        rigid = [link_of(spec, robot, name)]
        for body in rigid:  # the list grows during the loop
            rigid += [child for child in body.bodies if not child.joints]
            forget_geoms(spec, body.geoms)
            for geom in (geom for geom in body.geoms if geom.contype or geom.conaffinity):
                geom.contype, geom.conaffinity, geom.group = 0, 0, 3


def lock(spec: Any, robot: TrackedRobot, held: Collection[str]) -> None:
    """Lock the joints of links in `robot.wheels`, except those of flippers and other carriers of
    running gear; raises TrackslipError if moving parts carry any. `held` names the joints that hold
    their angle.
    """
    for name in robot.wheels:
        if name in robot.gear_bodies:
            continue
        for joint in list(spec.body(name).joints):
            if joint.type != _FREE:
                delete_joint(spec, joint)

    carriers_of = {name: _moving_carriers(spec.body(name), robot, held) for name in robot.wheels}
    hanging = {name: moving for name, moving in carriers_of.items() if moving}
    if not hanging:
        return
    name, moving = next(iter(hanging.items()))
    every = list(dict.fromkeys([*robot.wheels, *(each for m in hanging.values() for each in m)]))
    allowed = f"fixed to the chassis; list it to lock it, wheels = {json.dumps(every)}"
    way_on = f'or give it running gear of its own, [[tracks]] with body = "{moving[0]}"'
    raise TrackslipError(
        f"{robot.model}: wheels = {name!r}: hangs on {moving[0]!r}, which moves, must be "
        f"{allowed}, {way_on}"
    )


def _moving_carriers(link: Any, robot: TrackedRobot, held: Collection[str]) -> list[str]:
    """Names of the bodies with joints, from a link up to, but without, the chassis or the body with
    running gear that carries it.
    """
    moving = []
    for each in (link, *carriers(link)):
        if each.parent.name == "world" or each.name in robot.gear_bodies:
            break
        if any(joint.name not in held for joint in each.joints):
            moving.append(each.name)
    return moving


def carriers(link: Any) -> list[Any]:
    """The bodies that carry a link, from its parent to the chassis."""
    return [] if link.parent.name == "world" else [link.parent, *carriers(link.parent)]


def link_of(spec: Any, robot: TrackedRobot, name: str, field: str = "wheels") -> Any:
    """The link that a field of the robot file names; raises TrackslipError if the model doesn't
    have it.
    """
    if spec.body(name) in (None, spec.worldbody):
        known = some([body.name for body in spec.bodies if body.name != "world"])
        raise TrackslipError(
            f"{robot.model}: {field} = {name!r}: must be links of the model, such as {known}"
        )
    return spec.body(name)


def forget_geoms(spec: Any, geoms: Iterable[Any]) -> None:
    """Delete the contact pairs and sensors that refer to these geoms."""
    named = {(_GEOM, geom.name) for geom in geoms if geom.name}
    sensors = [
        each
        for each in spec.sensors
        if named & {(each.objtype, each.objname), (each.reftype, each.refname)}
    ]
    pairs = [
        each for each in spec.pairs if named & {(_GEOM, each.geomname1), (_GEOM, each.geomname2)}
    ]
    for each in (*sensors, *pairs):
        spec.delete(each)


def delete_joint(spec: Any, joint: Any) -> None:
    """Delete a joint with the motors, sensors, tendons and constraints that refer to it."""
    tendons = [each for each in spec.tendons if any(wrap.target == joint for wrap in each.path)]
    names = {joint.name, *(tendon.name for tendon in tendons)}
    motors = [motor for motor in spec.actuators if motor.target in names]
    names = {*names, *(motor.name for motor in motors)} - {""}
    sensors = [sensor for sensor in spec.sensors if sensor.objname in names]
    equalities = [each for each in spec.equalities if names & {each.name1, each.name2}]
    for each in (*sensors, *equalities, *motors, *tendons, joint):
        spec.delete(each)


def endless(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """For each joint, whether it can turn by more than a full turn."""
    # in halves, as limits may be the largest numbers that there are
    half = model.jnt_range[:, 1] / 2 - model.jnt_range[:, 0] / 2
    return np.asarray((model.jnt_limited == 0) | (half > np.pi))


def colliding(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """For each geom, whether it collides with other geoms, for which one of its two masks is
    enough.
    """
    return np.asarray((model.geom_contype | model.geom_conaffinity) > 0)


def extent(model: mujoco.MjModel, data: mujoco.MjData, chassis: Any, body: int) -> Array:
    """Smallest and largest coordinates (2, 3) of a link's geoms in the chassis' frame [m].

    If some geoms collide, only these count; along y, only the tread counts, because a hub reaches
    further inwards. A link without geoms has no extent: NaN.
    """
    own = (model.geom_bodyid == body) | (model.body_weldid[model.geom_bodyid] == body)
    collide = own & colliding(model)
    shapes = np.flatnonzero(collide if collide.any() else own).tolist()
    if not shapes:
        return np.full((2, 3), np.nan)
    points = np.vstack([outline(model, data, chassis, shape) for shape in shapes])
    low = points.min(axis=0)
    high = points.max(axis=0)
    tread = points[points[:, 2] <= low[2] + _TREAD * (high[2] - low[2])]
    low[1] = tread[:, 1].min()
    high[1] = tread[:, 1].max()
    return np.array([low, high])


def outline(model: mujoco.MjModel, data: mujoco.MjData, chassis: Any, geom: int) -> Array:
    """Points (P, 3) in the chassis' frame that reach as far along each axis as a geom does [m]."""
    to_chassis = chassis.xmat.reshape(3, 3).T
    turn = to_chassis @ data.geom_xmat[geom].reshape(3, 3)
    centre = to_chassis @ (data.geom_xpos[geom] - chassis.xpos)
    kind = mujoco.mjtGeom(int(model.geom_type[geom]))
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.mesh(model.geom_dataid[geom])
        vertices = model.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]]
        return np.asarray(vertices @ turn.T + centre)

    middle, half = model.geom_aabb[geom].reshape(2, 3)
    along = np.abs(turn[:, 2])  # how far the geom's own z axis points along each axis
    match kind:
        case mujoco.mjtGeom.mjGEOM_SPHERE | mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            reach = np.linalg.norm(turn * half, axis=1)
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            reach = np.linalg.norm(turn[:, :2] * half[:2], axis=1) + along * half[2]
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            reach = half[0] + along * (half[2] - half[0])
        case _:
            reach = np.abs(turn) @ half
    return turn @ middle + centre + reach * _CORNERS


def choose_start(spec: Any, robot: TrackedRobot) -> None:
    """Delete all keyframes except the robot's; issue a RobotWarning if none is chosen but they
    would move joints.

    Raises TrackslipError for a keyframe that the model doesn't have.
    """
    held = {*robot.gear_bodies, *robot.wheels}
    joints = [joint for joint in spec.joints if joint.type != _FREE]
    moving = [joint for joint in joints if joint.parent.name not in held]
    names = [key.name for key in spec.keys]
    if robot.key and robot.key not in names:
        known = f"one of its keyframes, {some(names)}" if names else "left out: it has no keyframes"
        raise TrackslipError(f"{robot.model}: key = {robot.key!r}: must be {known}")
    if names and moving and not robot.key:
        hint = f'key = "{names[0]}" in the robot file begins there'
        what = f"its keyframes, {some(names)}, are not used: joints and motors begin at 0"
        warnings.warn(f"{robot.model}: {what}; {hint}", RobotWarning, stacklevel=4)
    for key in [key for key in spec.keys if not robot.key or key.name != robot.key]:
        spec.delete(key)


def start(model: mujoco.MjModel) -> mujoco.MjData:
    """Data of a model at its keyframe or, if it has none, in its reference position."""
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    return data
