"""Tracked robots compiled with their terrain, and the indices of their bodies, joints, motors and
tracks.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.robot.robot import VISUAL_GROUP, warn_of_inertia
from sim.robot.tracked import Flipper, TrackedRobot
from sim.robot.urdf import Refuse, engine_errors, find_meshes, refuse, some, weightless
from sim.robot.wheels import (
    choose_start,
    colliding,
    endless,
    forget_geoms,
    link_of,
    lock,
    outline,
    switch_off,
)
from sim.tracks import Belts, add_tracks, connect
from trackslip.errors import RobotWarning, TrackslipError, counted
from trackslip.kinematics import Array

SIDES = ("left", "right")
_PLANE, _FRICTION, _GREY = "ground", 0.7, [0.6, 0.58, 0.54, 1]  # level ground, in place of terrain
_CLEAR = 1e-3  # least height of the rest of the chassis above the tracks' lowest point [m]
_ACROSS = 0.99  # least cosine between the chassis' y axis and a flipper's y axis or hinge [-]
_FREE, _HINGE = mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_HINGE
_Bit = mujoco.mjtDisableBit
_NEEDED = _Bit.mjDSBL_GRAVITY | _Bit.mjDSBL_CONTACT | _Bit.mjDSBL_CONSTRAINT
_STEPS = 61  # number of flipper angles that `clear_angles` tries


class Terrain(Protocol):
    """Terrain that a robot can be placed on."""

    @property
    def friction(self) -> float:
        """Coefficient of friction of the terrain [-]."""

    def add_to(self, spec: Any) -> list[str]:
        """Add the terrain to a `mujoco.MjSpec` and return the names of its geoms."""


@dataclass(frozen=True)
class FlipperGeometry:
    """The shape of F flippers."""

    hinge: Array  # (F, 3) in the chassis' frame [m]
    length: Array  # (F,) from the hinge to the wheel at the tip [m]
    radius: Array  # (F,) mean radius of a flipper's wheels [m]
    front: NDArray[np.bool_]  # (F,) whether the flipper points forwards
    rest: Array  # (F,) lift of the tip above the chassis' plane at angle 0 [rad]


@dataclass(frozen=True)
class TrackedModel:
    """A compiled model with T tracks: those of the chassis, then those of its F flippers in
    order.
    """

    model: mujoco.MjModel
    robot: TrackedRobot
    belts: Belts  # of the chassis' pair of tracks, then one per flipper
    body: int  # the chassis
    # indices at which the chassis' pose begins in qpos, and its velocity in qvel
    free: tuple[int, int]
    track_side: NDArray[np.int_]  # (T,) 0 left, 1 right: the side whose command a belt follows
    flipper_qpos: NDArray[np.int_]  # (F,) indices of the hinges in qpos
    flipper_motor: NDArray[np.int_]  # (F,) indices of the flippers' motors in ctrl
    # (F,) 1 where a positive angle of the hinge lifts the flipper's tip, otherwise -1
    flipper_sign: Array
    flipper_range: Array  # (F, 2) lowest and highest angle, positive upwards [rad]
    flippers: FlipperGeometry

    def flipper_angles(self, qpos: Array) -> Array:
        """Flipper angles (..., F) in states qpos (..., nq), positive upwards [rad]."""
        return np.asarray(self.flipper_sign * np.asarray(qpos)[..., self.flipper_qpos])

    def flipper_control(self, angles: Array) -> Array:
        """Control signals (..., F) for set points (..., F) of the flipper angles, clipped to their
        range [rad].
        """
        return np.asarray(self.flipper_sign * np.clip(angles, *self.flipper_range.T))


def build_tracked(
    robot: TrackedRobot,
    terrain: Terrain | None = None,
    *,
    preset: str = "accurate",
    friction: tuple[float, float] | None = None,
    looks: bool = False,
    refuse: Refuse = refuse,
) -> TrackedModel:
    """Compile a robot with tracks of a contact preset, on its terrain or on a plane.

    Friction along and across the tracks is by default the terrain's, or 0.7 on a plane. `looks`
    keeps purely visual geoms, which slow the physics down. `refuse` is called with a line on each
    part that is missing or wrong, and raises it by default. Raises TrackslipError for a model that
    can't be compiled or doesn't contain a part of `robot`.
    """
    with engine_errors(robot.model):
        spec = load_spec(robot, looks, refuse)
        chassis = chassis_of(spec, robot)
        if looks:
            _light(spec)
        if not chassis.joints:
            chassis.add_freejoint()
        hinges = [_motor_of(spec, robot, flipper) for flipper in robot.flippers]
        if terrain is None:
            spec.worldbody.add_geom(
                name=_PLANE, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[20, 20, 0.1], rgba=_GREY
            )
        names = [_PLANE] if terrain is None else terrain.add_to(spec)
        friction = friction or (_FRICTION if terrain is None else terrain.friction,) * 2
        add_tracks(spec, chassis, robot.track(preset, friction))
        for flipper in robot.flippers:
            add_tracks(spec, flipper.body, flipper.track(preset, friction))
        connect(spec, names)
        name, model = chassis.name, spec.compile()
        if (held := float(model.body_mass @ model.body_gravcomp)) > 0:
            what = f"its gravcomp holds up {held:.3g} kg, which don't weigh on the tracks"
            warnings.warn(f"{robot.model}: {what}", RobotWarning, stacklevel=2)
        if looks:  # only then are all shapes that show the body's reach in the model
            warn_of_inertia(model, model.body(name).id, robot.model)
        elif model.nu == len(robot.flippers):
            _warn_of_loose_joints(model, robot)
        return _read(model, robot, name, hinges, refuse)


def load_spec(robot: TrackedRobot, looks: bool = False, refuse: Refuse = refuse) -> Any:
    """Load the robot's model without its scene; the robot's keyframe is the only one that stays.

    Mesh files are located and the model's own wheels switched off; purely visual geoms stay only
    with `looks`.
    """
    spec = robot.spec()
    spec.compiler.fusestatic = False  # the base link of a URDF is to stay a body
    for kind, things in (("body", spec.bodies), ("key", spec.keys)):
        for k, thing in enumerate(things):
            thing.name = thing.name or f"unnamed_{kind}{k}"
    for k, joint in enumerate(spec.joints):
        joint.name = joint.name or f"{joint.parent.name}_joint{k}"
    new = spec.default.geom  # default for geoms that are added later
    new.pos, new.quat, new.alt.type = (
        [0.0] * 3,
        [1.0, 0.0, 0.0, 0.0],
        mujoco.mjtOrientation.mjORIENTATION_QUAT,
    )
    forget_geoms(spec, spec.worldbody.geoms)
    for thing in (*spec.worldbody.geoms, *spec.worldbody.lights):
        spec.delete(thing)
    for geom in [] if looks else [geom for geom in spec.geoms if geom.group == VISUAL_GROUP]:
        if weightless(spec, geom):
            spec.delete(geom)
    switch_off(spec, robot)
    find_meshes(spec, robot.model, robot.packages, refuse)
    choose_start(spec, robot)
    if spec.keys:
        spec.compile()  # from here on, keyframes follow changes in the joints
    lock(spec, robot)
    return spec


def _light(spec: Any) -> None:
    """Add light and a sky, and allow larger pictures than MuJoCo's default."""
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1920, 1080
    quality = spec.visual.quality  # low enough to draw without a GPU
    (
        quality.shadowsize,
        quality.offsamples,
        quality.numslices,
        quality.numstacks,
        quality.numquads,
    ) = 2048, 4, 16, 8, 1
    if not any(texture.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX for texture in spec.textures):
        colours = {"rgb1": [0.45, 0.63, 0.82], "rgb2": [0.86, 0.91, 0.95]}
        kind, gradient = mujoco.mjtTexture.mjTEXTURE_SKYBOX, mujoco.mjtBuiltin.mjBUILTIN_GRADIENT
        spec.add_texture(name="sky", type=kind, builtin=gradient, **colours, width=256, height=1536)
    headlight = spec.visual.headlight
    headlight.ambient, headlight.diffuse, headlight.specular = (
        [0.36, 0.37, 0.39],
        [0.3] * 3,
        [0.05] * 3,
    )
    sun = {
        "type": mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        "pos": [6, -8, 12],
        "dir": [-0.45, 0.6, -1],
    }
    spec.worldbody.add_light(**sun, diffuse=[0.62, 0.6, 0.55], castshadow=True)


def chassis_of(spec: Any, robot: TrackedRobot) -> Any:
    """The chassis in the robot's spec; raises TrackslipError if it is missing or has a joint that
    isn't free.
    """
    roots = [body.name for body in spec.worldbody.bodies]
    if not robot.body and len(roots) != 1:
        raise TrackslipError(
            f"{robot.model}: {some(roots)} lie in the world; `body` must name the chassis"
        )
    name = robot.body or roots[0]
    body = spec.body(name)
    if body is None or name not in roots:
        raise TrackslipError(
            f"{robot.model}: body = {name!r}: must be one that lies in the world: "
            f"{', '.join(roots)}"
        )
    if any(joint.type != _FREE for joint in body.joints):
        joints = ", ".join(joint.name for joint in body.joints)
        raise TrackslipError(
            f"{robot.model}: joints of body {name!r} = {joints}: must be a free joint or none"
        )
    return body


def _motor_of(spec: Any, robot: TrackedRobot, flipper: Flipper) -> tuple[str, str]:
    """Names of a flipper's hinge and motor; a hinge without a motor gets one."""
    body = link_of(spec, robot, flipper.body, "flippers: body")
    if [joint.type for joint in body.joints] != [_HINGE]:
        raise TrackslipError(
            f"{robot.model}: flippers: body = {flipper.body!r}: must have one joint, a hinge"
        )
    hinge = body.joints[0]
    motors = [each for each in spec.actuators if each.target == hinge.name]
    if not motors:
        motor = spec.add_actuator(
            name=f"{flipper.body}_motor", target=hinge.name, trntype=mujoco.mjtTrn.mjTRN_JOINT
        )
        motor.set_to_position(kp=flipper.stiffness)
        damping = np.array(hinge.damping)
        # the joint's damping is integrated implicitly; a motor's may be unstable
        damping[0] += flipper.damping
        hinge.damping = damping
        motor.forcerange, motor.forcelimited = [-flipper.torque, flipper.torque], True
        motors = [motor]
    motors[0].name = motors[0].name or f"{flipper.body}_motor"
    return hinge.name, motors[0].name


def _warn_of_loose_joints(model: mujoco.MjModel, robot: TrackedRobot) -> None:
    """Issue a RobotWarning for hinges that turn endlessly in a model without motors, such as a
    URDF.
    """
    flippers = [model.body(name).id for name in robot.flipper_bodies]
    swings = endless(model) & (model.jnt_type == _HINGE) & ~np.isin(model.jnt_bodyid, flippers)
    if loose := [model.joint(k).name for k in np.flatnonzero(swings)]:
        what = (
            f"nothing drives or holds {counted(len(loose), 'hinge')} without limits, {some(loose)}"
        )
        hint = "list the links of wheels in `wheels`, and make joints of sensors fixed"
        warnings.warn(f"{robot.model}: {what}; {hint}", RobotWarning, stacklevel=3)


def _read(
    model: mujoco.MjModel,
    robot: TrackedRobot,
    chassis: str,
    hinges: Sequence[tuple[str, str]],
    refuse: Refuse,
) -> TrackedModel:
    """Read the indices and numbers of a compiled robot; `hinges` names each flipper's hinge and
    motor.
    """
    body = model.body(chassis).id
    free = model.body_jntadr[body]
    place = slice(model.jnt_qposadr[free], model.jnt_qposadr[free] + 7)
    # runs place the chassis themselves, at rest
    model.key_qpos[:, place], model.key_qvel[:] = model.qpos0[place], 0.0
    joints = np.array([model.joint(hinge).id for hinge, _ in hinges], int)
    data = mujoco.MjData(model)
    data.qpos[model.jnt_qposadr[joints]] = 0.0
    mujoco.mj_forward(model, data)
    if not all(
        np.isfinite(values).all()
        for values in (data.geom_xpos, data.geom_xmat, data.xipos, data.qacc)
    ):
        raise TrackslipError(
            f"{robot.model}: a number in it is nan, inf or too large: its motion isn't finite"
        )
    if model.opt.gravity[2] >= 0 or model.opt.disableflags & _NEEDED:
        allowed = "must have gravity downwards, and no gravity, contact or constraint disabled"
        raise TrackslipError(f"{robot.model}: its <option> {allowed}")
    _check_across(model, data, robot, body, refuse)
    _check_clear(model, data, robot, body, refuse)
    axes, origin = data.xmat[body].reshape(3, 3), data.xpos[body]
    hinge, tip, radius = (
        np.zeros((len(joints), 3)),
        np.zeros((len(joints), 3)),
        np.zeros(len(joints)),
    )
    for k, (joint, flipper) in enumerate(zip(joints, robot.flippers, strict=True)):
        places, wheel_radius = _wheels_of(data, flipper)
        away = np.linalg.norm(places - data.xanchor[joint], axis=1)
        hinge[k] = (data.xanchor[joint] - origin) @ axes
        tip[k] = (places[away.argmax()] - origin) @ axes
        radius[k] = wheel_radius.mean()
    reach = tip - hinge
    length, rest = np.hypot(reach[:, 0], reach[:, 2]), np.arctan2(reach[:, 2], np.abs(reach[:, 0]))
    sign = np.where(np.cross(data.xaxis[joints] @ axes, reach)[:, 2] >= 0, 1.0, -1.0)
    limits = np.where(endless(model)[joints, None], [-np.pi, np.pi], model.jnt_range[joints])
    sides = [0, 1, *(SIDES.index(flipper.side) for flipper in robot.flippers)]
    return TrackedModel(
        model=model,
        robot=robot,
        belts=Belts(model),
        body=body,
        free=(int(model.jnt_qposadr[free]), int(model.jnt_dofadr[free])),
        track_side=np.array(sides),
        flipper_qpos=model.jnt_qposadr[joints],
        flipper_motor=np.array([model.actuator(motor).id for _, motor in hinges], int),
        flipper_sign=sign,
        flipper_range=np.sort(sign[:, None] * limits, axis=1),
        flippers=FlipperGeometry(hinge, length, radius, reach[:, 0] > 0, rest),
    )


def _check_across(
    model: mujoco.MjModel, data: mujoco.MjData, robot: TrackedRobot, body: int, refuse: Refuse
) -> None:
    """Call `refuse` for flippers whose hinge isn't lateral, whose y axis isn't to the left, or on
    the wrong side.
    """
    lateral = data.xmat[body].reshape(3, 3)[:, 1]
    for flipper in robot.flippers:
        name, own = flipper.body, data.body(flipper.body)
        y = (own.xpos - data.xpos[body]) @ lateral + flipper.y
        axis = data.xaxis[model.body_jntadr[own.id]]
        if min(own.xmat.reshape(3, 3)[:, 1] @ lateral, abs(axis @ lateral)) < _ACROSS:
            refuse(f"{robot.model}: body {name!r}: must have y to the left, and its hinge along y")
        elif (y if flipper.side == "left" else -y) < -_CLEAR:
            what = (
                f"flippers: side of {name!r} = {flipper.side!r}: lies at y = {y:.3g} m, on "
                "the other side"
            )
            refuse(f"{robot.model}: {what}")


def _check_clear(
    model: mujoco.MjModel, data: mujoco.MjData, robot: TrackedRobot, body: int, refuse: Refuse
) -> None:
    """Call `refuse` for geoms of the chassis that reach as low as its tracks, and so would touch
    level ground.
    """
    own = (model.body_weldid[model.geom_bodyid] == model.body_weldid[body]) & colliding(model)
    for geom in np.flatnonzero(own).tolist():
        low = outline(model, data, data.body(body), geom)[:, 2].min()
        if low < robot.lowest + _CLEAR:
            frame = model.body(body).name
            what = (
                f"{robot.model}: {_named(model, geom)} reaches down to {low:.3g} m in the "
                f"frame of {frame}"
            )
            allowed = f"must stay above the tracks' lowest point, at {robot.lowest:.3g} m"
            allowed += "; if tracks replace it, list its link in `wheels`"
            refuse(f"{what}; what touches {allowed}")


def _named(model: mujoco.MjModel, geom: int) -> str:
    """Describe a geom in its author's terms: by its link, and its own name or that of its mesh."""
    link, name, mesh = (
        model.body(model.geom_bodyid[geom]).name,
        model.geom(geom).name,
        int(model.geom_dataid[geom]),
    )
    if not name and model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
        return f"mesh {model.mesh(mesh).name} of link {link}"
    return f"geom {name} of link {link}" if name else f"a geom of link {link}"


def clear_angles(tracked: TrackedModel) -> Array:
    """Lowest angles (F,), from 0 upwards, at which no flipper reaches below the chassis' tracks
    [rad].

    A flipper that is below the tracks at every angle from 0 to its highest stays at 0, or at the
    nearest allowed angle.
    """
    model, flippers = tracked.model, tracked.robot.flippers
    data, low, high = mujoco.MjData(model), *tracked.flipper_range.T
    # level, whatever the file's pose
    data.qpos[tracked.free[0] + 3 : tracked.free[0] + 7] = [1.0, 0.0, 0.0, 0.0]
    tried = np.linspace(np.clip(0.0, low, high), high, _STEPS)  # (K, F) angles to try
    clear = np.zeros(tried.shape, bool)
    for angles, above in zip(tried, clear, strict=True):
        data.qpos[tracked.flipper_qpos] = tracked.flipper_control(angles)
        mujoco.mj_kinematics(model, data)
        for k, flipper in enumerate(flippers):
            places, radius = _wheels_of(data, flipper)
            above[k] = (places[:, 2] - radius).min() - data.xpos[
                tracked.body, 2
            ] >= tracked.robot.lowest
    return np.asarray(tried[clear.argmax(axis=0), np.arange(len(flippers))])


def _wheels_of(data: mujoco.MjData, flipper: Flipper) -> tuple[Array, Array]:
    """Positions (W, 3) in the world, and radii (W,), of a flipper's wheels [m]."""
    x, z, radius = np.array(flipper.hull).T
    body, own = data.body(flipper.body), np.column_stack([x, np.full_like(x, flipper.y), z])
    return own @ body.xmat.reshape(3, 3).T + body.xpos, radius
