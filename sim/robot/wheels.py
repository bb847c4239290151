"""A model's own wheels, which the robot's tracks replace, and the keyframe from which runs
start.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Collection, Iterable, Sequence
from typing import Any

import mujoco
import numpy as np
import scipy
from numpy.typing import NDArray

from sim.robot.tracked import TrackedRobot
from sim.robot.urdf import some
from trackslip.errors import RobotWarning, TrackslipError
from trackslip.kinematics import Array

_AXIS = 0.95  # least cosine between a wheel's axis and the chassis' y axis [-]
# largest difference between a wheel's extents along x and z, relative to their mean [-]
_ROUND = 0.1
# largest difference between wheels on the left and right, relative to the radius [-]
_MIRRORED = 0.1
# smallest |y| of a wheel, relative to the largest of all; those nearer to the middle are casters
# [-]
_MIDDLE = 0.25
_TREAD = 0.1  # height of a wheel's tread from below, relative to the wheel's height [-]
_LIGHT = 1e-9  # least mass and inertia of links, as locked links may weigh nothing [kg, kg m^2]
_FREE, _HINGE, _GEOM = (
    mujoco.mjtJoint.mjJNT_FREE,
    mujoco.mjtJoint.mjJNT_HINGE,
    mujoco.mjtObj.mjOBJ_GEOM,
)


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


def lock(spec: Any, robot: TrackedRobot) -> None:
    """Lock the joints of links in `robot.wheels`, except flippers; raises TrackslipError if moving
    parts carry any.
    """
    for name in robot.wheels:
        for joint in [joint for joint in spec.body(name).joints if joint.type != _FREE]:
            if name not in robot.flipper_bodies:
                _delete_joint(spec, joint)
    carriers = {
        name: moving
        for name in robot.wheels
        if (moving := _moving_carriers(spec.body(name), robot))
    }
    if carriers:
        name, first = next((name, moving[0]) for name, moving in carriers.items())
        every = dict.fromkeys(
            (*robot.wheels, *(each for moving in carriers.values() for each in moving))
        )
        allowed = f"fixed to the chassis; list it to lock it, wheels = {json.dumps(list(every))}"
        raise TrackslipError(
            f"{robot.model}: wheels = {name!r}: hangs on {first!r}, must be {allowed}"
        )


def _moving_carriers(link: Any, robot: TrackedRobot) -> list[str]:
    """Names of the bodies with joints, from a link up to, but without, the chassis or the flipper
    that carries it.
    """
    moving = []
    for each in (link, *_carriers(link)):
        if each.parent.name == "world" or each.name in robot.flipper_bodies:
            break
        if each.joints:
            moving.append(each.name)
    return moving


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


def _delete_joint(spec: Any, joint: Any) -> None:
    tendons = [each for each in spec.tendons if any(wrap.target == joint for wrap in each.path)]
    names = {joint.name, *(tendon.name for tendon in tendons)}
    motors = [motor for motor in spec.actuators if motor.target in names]
    names = {*names, *(motor.name for motor in motors)} - {""}
    sensors = [sensor for sensor in spec.sensors if sensor.objname in names]
    equalities = [each for each in spec.equalities if names & {each.name1, each.name2}]
    for each in (*sensors, *equalities, *motors, *tendons, joint):
        spec.delete(each)


def own_wheels(
    spec: Any, chassis: str, robot: TrackedRobot, given: Collection[str]
) -> dict[str, Any]:
    """The fields `wheels`, `half_gauge` [m] and `hull` [m] of a robot, read from the model's own
    wheels.

    The wheels are the links in `robot.wheels`, or by default all links that turn endlessly, and the
    flippers; wheels on flippers don't count. Raises TrackslipError if the left and right wheels
    differ, unless gauge and hull are `given`.
    """
    listed = [
        link_of(spec, robot, name).name for name in robot.wheels if name not in robot.flipper_bodies
    ]
    found = _wheels(spec, chassis, robot, listed)
    replaced = {"wheels": robot.wheels or (*found, *robot.flipper_bodies)}
    if {"half_gauge", "hull"} <= set(given):
        return replaced
    flippers = [link_of(spec, robot, name, "flippers: body") for name in robot.flipper_bodies]
    carried = {
        link.name for flipper in flippers for link in flipper.find_all(mujoco.mjtObj.mjOBJ_BODY)
    }
    wheels = {name: extent for name, extent in found.items() if name not in carried}
    low, high = np.reshape(list(wheels.values()), (-1, 2, 3)).transpose(1, 0, 2)
    (x, y, z), half = ((low + high) / 2).T, (high - low) / 2
    shapes = np.column_stack([x, z, half[:, [0, 2]].mean(axis=1), np.abs(y)])
    outer = np.abs(y) > _MIDDLE * np.abs(y).max(initial=0.0)
    pairs = _mirrored(shapes[outer & (y > 0)], shapes[outer & (y < 0)])
    if not len(pairs):
        allowed = "round links that collide, on endless hinges about y, alike on the left and right"
        seen = f"found are {', '.join(wheels) or 'none'}; give `hull` and `half_gauge`"
        raise TrackslipError(
            f"{robot.model}: wheels = {', '.join(listed) or 'replace'}: must be {allowed}; {seen}"
        )
    return replaced | {
        "half_gauge": round(float(shapes[outer, 3].mean()), 6),
        "hull": tuple(map(tuple, sorted(pairs.mean(axis=1)[:, :3].round(6).tolist()))),
    }


def _wheels(
    spec: Any, chassis: str, robot: TrackedRobot, listed: Sequence[str]
) -> dict[str, Array]:
    """Extents (2, 3) of the wheels in the chassis' frame, by name [m].

    Wheels are round and turn endlessly about the chassis' y; `listed` wheels may have limits or be
    fixed. Parts of wheels, and links that carry wheels, such as rockers and knuckles, don't count.
    Raises TrackslipError for `listed` links that turn endlessly about y but aren't round.
    """
    spec.compiler.boundmass = spec.compiler.boundinertia = _LIGHT
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    base = data.body(chassis)
    about_y = (model.jnt_type == _HINGE) & (
        np.abs(data.xaxis @ base.xmat.reshape(3, 3)[:, 1]) > _AXIS
    )
    turning, spinning = (
        set(model.jnt_bodyid[which].tolist()) for which in (about_y, about_y & endless(model))
    )
    own = [model.body(body).name for body in sorted(spinning)]
    names = listed or [name for name in own if name not in robot.flipper_bodies]
    bodies = {int(model.body(name).id): name for name in names}
    fixed_to = {body: int(model.body_weldid[body]) for body in bodies}
    parts = {
        body for body, root in fixed_to.items() if root != body and root in spinning & bodies.keys()
    }
    whole = [spec.body(name) for body, name in bodies.items() if body not in parts]
    carriers = {carrier.name for link in whole for carrier in _carriers(link)}
    wheels = {}
    for body, name in bodies.items():
        if body in parts or name in carriers or (model.body_jntnum[body] and body not in turning):
            continue
        extent = _extent(model, data, base, body)
        along, _, up = extent[1] - extent[0]
        if abs(along - up) < _ROUND * (along + up) / 2:
            wheels[name] = extent
        elif listed and body in spinning:
            allowed = "round to be a wheel; give `hull` and `half_gauge`"
            raise TrackslipError(
                f"{robot.model}: wheels = {name!r}: turns endlessly, must be {allowed}"
            )
    return wheels


def _carriers(link: Any) -> list[Any]:
    return [] if link.parent.name == "world" else [link.parent, *_carriers(link.parent)]


def _mirrored(left: Array, right: Array) -> Array:
    """Pairs (P, 2, 4) of left and right wheels, each x, z, radius and |y| [m]; none if the sides
    (P, 4) differ.
    """
    if left.shape != right.shape:
        return np.empty((0, 2, 4))
    apart = np.abs(left[:, None] - right).max(axis=-1)
    rows, columns = scipy.optimize.linear_sum_assignment(apart)
    if (apart[rows, columns] >= _MIRRORED * left[rows, 2]).any():
        return np.empty((0, 2, 4))
    return np.stack([left[rows], right[columns]], axis=1)


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


def _extent(model: mujoco.MjModel, data: mujoco.MjData, chassis: Any, body: int) -> Array:
    """Smallest and largest coordinates (2, 3) of a link's geoms in the chassis' frame [m].

    If some geoms collide, only these count; along y, only the tread counts, because a hub reaches
    further inwards.
    """
    own = (model.geom_bodyid == body) | (model.body_weldid[model.geom_bodyid] == body)
    collide = own & colliding(model)
    shapes = np.flatnonzero(collide if collide.any() else own).tolist()
    stacked = np.vstack(
        [np.full((1, 3), np.nan), *(outline(model, data, chassis, shape) for shape in shapes)]
    )
    extent = np.array([np.fmin.reduce(stacked), np.fmax.reduce(stacked)])
    tread = stacked[~(stacked[:, 2] > extent[0, 2] + _TREAD * np.ptp(extent[:, 2]))]
    extent[:, 1] = np.fmin.reduce(tread[:, 1]), np.fmax.reduce(tread[:, 1])
    return extent


def outline(model: mujoco.MjModel, data: mujoco.MjData, chassis: Any, geom: int) -> Array:
    """Points (P, 3) in the chassis' frame that reach as far along each axis as a geom does [m]."""
    turn = chassis.xmat.reshape(3, 3).T @ data.geom_xmat[geom].reshape(3, 3)
    centre = chassis.xmat.reshape(3, 3).T @ (data.geom_xpos[geom] - chassis.xpos)
    kind = mujoco.mjtGeom(int(model.geom_type[geom]))
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.mesh(model.geom_dataid[geom])
        return np.asarray(model.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]] @ turn.T + centre)
    middle, half = model.geom_aabb[geom].reshape(2, 3)
    along, across = np.abs(turn[:, 2]), np.linalg.norm(turn[:, :2] * half[:2], axis=1)
    reach = np.abs(turn) @ half
    if kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        reach = np.linalg.norm(turn * half, axis=1)
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        reach = across + along * half[2]
    elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        reach = half[0] + along * (half[2] - half[0])
    return turn @ middle + centre + reach * [[-1, -1, -1], [1, 1, 1], [-1, 1, -1]]


def choose_start(spec: Any, robot: TrackedRobot) -> None:
    """Delete all keyframes except the robot's; issue a RobotWarning if none is chosen but they
    would move joints.

    Raises TrackslipError for a keyframe that the model doesn't have.
    """
    held = {*robot.flipper_bodies, *robot.wheels}
    moving = [
        joint for joint in spec.joints if joint.type != _FREE and joint.parent.name not in held
    ]
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
