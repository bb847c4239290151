"""Tracked robots compiled with their terrain, and the indices of their bodies, joints, motors and
tracks.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.robot.gear import BOTH, MOTORS, OWN
from sim.robot.joint_rules import rule_for
from sim.robot.joints import ROLLS, Joints, angle_unit, hinge_body, hold
from sim.robot.places import PlacedGear, model_at_rest, placed, with_gear
from sim.robot.robot import VISUAL_GROUP, warn_of_inertia
from sim.robot.tracked import TrackedRobot
from sim.robot.urdf import Refuse, engine_errors, find_meshes, refuse, some, weightless
from sim.robot.wheel_reading import Model
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
from sim.tracks.recipe import Preset, load_preset, track_points
from sim.tracks.track import Track
from trackslip.arguments import checks_arguments
from trackslip.errors import RobotWarning, TrackslipError, counted
from trackslip.kinematics import Array

SIDES = ("left", "right")
_PLANE: Final = "ground"  # level ground, in place of terrain
_FRICTION: Final = 0.7
_GREY: Final = (0.6, 0.58, 0.54, 1)
_CLEAR: Final = 1e-3  # least height of the rest of the chassis above the tracks' lowest point [m]
_ACROSS: Final = 0.99  # least cosine between the chassis' y axis and a flipper's hinge [-]
_ROUNDING: Final = 1e-9  # largest rounding error of a height [m]
_FREE, _HINGE = mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_HINGE
_SLIDE: Final = mujoco.mjtJoint.mjJNT_SLIDE
_Bit = mujoco.mjtDisableBit
_NEEDED: Final = _Bit.mjDSBL_GRAVITY | _Bit.mjDSBL_CONTACT | _Bit.mjDSBL_CONSTRAINT
# largest pressure over the mean at which contacts don't reach their hard cores, at 2.4 times the
# sinkage of a standing robot [-]
_DEEPEST: Final = 1.5
# factor by which contacts of several entries are softer, so that less load shifts to those that
# slide fast: with it, turns are within 0.3 % of theory instead of 0.6 % [-]
_SOFTER: Final = 4.0
_SPACING: Final = 0.02  # of points at which the pressure is computed [m]
_STEPS: Final = 61  # number of flipper angles that `clear_angles` tries


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
    aside: Array  # (F,) largest distance of its belts' edges from y = 0 [m]


@dataclass(frozen=True)
class PlacedTrack:
    """A single track in a compiled model."""

    gear: PlacedGear  # the entry of the list of tracks to which it belongs
    y: float  # to the left of the frame of its body's tracks [m]
    motor: int  # 0 left, 1 right, 2 its own, which runs at the mean speed of both, -1 none


@dataclass(frozen=True)
class TrackedModel:
    """A compiled model with T tracks, in the order of the robot's list of tracks, left before
    right.
    """

    model: mujoco.MjModel
    robot: TrackedRobot
    belts: Belts
    body: int  # the chassis
    # indices at which the chassis' pose begins in qpos, and its velocity in qvel
    free: tuple[int, int]
    tracks: tuple[PlacedTrack, ...]  # (T,)
    # (T,) motor whose speed a belt follows: 0 left, 1 right, 2 the mean of both, -1 none
    track_side: NDArray[np.int_]
    flipper_names: tuple[str, ...]  # (F,) names of the bodies on the hinges
    flipper_qpos: NDArray[np.int_]  # (F,) indices of the hinges in qpos
    flipper_motor: NDArray[np.int_]  # (F,) indices of the flippers' motors in ctrl
    # (F,) 1 where a positive angle of the hinge lifts the flipper's tip, otherwise -1
    flipper_sign: Array
    flipper_range: Array  # (F, 2) lowest and highest angle, positive upwards [rad]
    flippers: FlipperGeometry
    joints: Joints  # what holds or moves them

    def motor_speeds(self, speeds: Array) -> Array:
        """Speeds (..., M) of the belts' motors at commanded speeds (..., 2), left and right [m/s].

        M is 3 if a belt has a motor of its own, which runs at the mean of both speeds.
        """
        count = int(self.track_side.max()) + 1
        if count <= len(SIDES):
            return speeds[..., :count]
        own = speeds.mean(axis=-1, keepdims=True)
        return np.concatenate([speeds, own], axis=-1)

    @property
    def side_tracks(self) -> tuple[int, int]:
        """Indices of a track that turns with the left motor, and of one with the right; of a belt
        with its own motor on a robot without such tracks.
        """

        def first(motor: int) -> int:
            turning = np.flatnonzero(self.track_side == motor)
            own = np.flatnonzero(self.track_side == MOTORS[OWN])
            return int(np.concatenate([turning, own, [0]])[0])

        return first(0), first(1)

    def belt_speeds(self, speeds: Array) -> Array:
        """Speeds (..., T) of the belts at commanded speeds (..., 2), left and right [m/s]."""
        motors = self.motor_speeds(np.asarray(speeds, float))
        return np.where(self.track_side < 0, 0.0, motors[..., self.track_side])

    def flipper_angles(self, qpos: Array) -> Array:
        """Flipper angles (..., F) in states qpos (..., nq), positive upwards [rad]."""
        return np.asarray(self.flipper_sign * np.asarray(qpos)[..., self.flipper_qpos])

    def flipper_control(self, angles: Array) -> Array:
        """Control signals (..., F) for set points (..., F) of the flipper angles, clipped to their
        range [rad].
        """
        return np.asarray(self.flipper_sign * np.clip(angles, *self.flipper_range.T))


@checks_arguments
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
    if not robot.hull:
        robot = complete(robot)
    with engine_errors(robot.model):
        spec, joints, yaws = _load(robot, looks, refuse)
        chassis = chassis_of(spec, robot)
        if looks:
            _light(spec)
        if not chassis.joints:
            chassis.add_freejoint()
        if terrain is None:
            spec.worldbody.add_geom(
                name=_PLANE, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[20, 20, 0.1], rgba=_GREY
            )
        names = [_PLANE] if terrain is None else terrain.add_to(spec)
        friction = friction or (_FRICTION if terrain is None else terrain.friction,) * 2

        gear = gear_of(spec, robot, chassis.name, yaws)
        hinges = [_motor_of(spec, robot, each) for each in gear if each.gear.flipper is not None]
        for each, track in zip(gear, _tracks(spec, robot, gear, preset, friction), strict=True):
            axes = None if each.frame.is_bodys else each.frame.axes
            add_tracks(spec, each.body, track, axes=axes)
        connect(spec, names)
        name, model = chassis.name, spec.compile()
        if (light := float(model.body_mass @ model.body_gravcomp)) > 0:
            what = f"its gravcomp holds up {light:.3g} kg, which don't weigh on the tracks"
            warnings.warn(f"{robot.model}: {what}", RobotWarning, stacklevel=2)
        if looks:  # only then are all shapes that show the body's reach in the model
            warn_of_inertia(model, model.body(name).id, robot.model)
        elif model.nu == len(set(hinges)):
            _warn_of_rolling_links(robot, joints)
        return _read(model, robot, name, gear, list(dict.fromkeys(hinges)), joints, refuse)


def complete(
    robot: TrackedRobot,
    given: Sequence[str] = (),
    replaces_all: bool = False,
    refuse: Refuse = refuse,
) -> TrackedRobot:
    """The robot with a complete list of tracks, read from the wheels of its model where the robot
    leaves it open; see `with_gear`.
    """
    with engine_errors(robot.model):
        with warnings.catch_warnings(action="ignore", category=RobotWarning):
            # wheels collide until tracks replace them
            spec = open_spec(replace(robot, wheels=()), refuse=refuse)
            if spec.keys:
                spec.compile()
        return with_gear(robot, spec, chassis_of(spec, robot).name, given, replaces_all)


def gear_of(
    spec: Any, robot: TrackedRobot, chassis: str, yaws: dict[str, float]
) -> list[PlacedGear]:
    """The robot's running gear with its places in a spec from `load_spec`; `yaws` are those of the
    model as it was before its reference was moved to its start.
    """
    model = None
    if robot.gear_bodies:
        model = model_at_rest(spec, chassis, robot)
        model.yaws = yaws
    return placed(robot, chassis, model)


def _tracks(
    spec: Any,
    robot: TrackedRobot,
    gear: Sequence[PlacedGear],
    preset: str,
    friction: tuple[float, float],
) -> list[Track]:
    """The tracks of each entry of the list, with its share of the robot's weight.

    Entries that bear the robot share its weight in proportion to the lengths of their contacts, so
    that each length yields alike. Flippers, which may lift the robot, are as stiff as if each bore
    all of it, unless nothing else does.
    """
    bearing = [each for each in gear if each.gear.flipper is None] or list(gear)
    lengths = [len(each.gear.places) * each.gear.contact_length for each in bearing]
    recipe: str | Preset = preset
    if len(bearing) > 1 or bearing[0].gear.aside:
        recipe = load_preset(preset).softer(_SOFTER)
        stiffer = max(1.0, _peak(spec, robot, bearing) / _DEEPEST)
        recipe = replace(recipe, sink=recipe.sink / stiffer)
    half_gauge = max(abs(wheel[1]) for each in bearing for wheel in each.wheels(0))
    longest = max(each.gear.contact_length for each in bearing)
    taken: set[str] = set()
    tracks = []
    for each in gear:
        load = 1.0
        segments = None
        if any(each is other for other in bearing):
            load = len(each.gear.places) * each.gear.contact_length / sum(lengths)
            is_one_pair = len(bearing) == 1 and each.gear.sides == BOTH
            if not is_one_pair and not each.gear.has_patches:
                width = max(half_gauge, each.gear.width)
                points = track_points(width, longest, load_preset(preset))
                share = each.gear.contact_length / longest
                segments = 2 * math.ceil(share * points / 4)
        name = _free_name(each, taken)
        tracks.append(each.gear.track(each.hull, recipe, friction, name, load, segments))
    return tracks


def _peak(spec: Any, robot: TrackedRobot, bearing: Sequence[PlacedGear]) -> float:
    """Largest pressure under a robot that stands on even ground, over the mean pressure [-].

    The robot is rigid and its contacts yield alike, so the pressure is a + b x + c y at the point
    (x, y); its sum and its moments are those of the weight.
    """
    chassis = chassis_of(spec, robot).name
    model = model_at_rest(spec, chassis, robot)
    mujoco.mj_comPos(model.model, model.data)
    body = model.model.body(chassis).id
    axes = model.data.xmat[body].reshape(3, 3)
    away = model.data.subtree_com[body] - model.data.xpos[body]
    centre = (away @ axes)[:2]
    points = np.concatenate([_contact_points(each) for each in bearing])  # (K, 2)
    terms = np.column_stack([np.ones(len(points)), points])
    balance = terms.T @ terms
    moments = len(points) * np.array([1.0, *centre])
    pressure = terms @ np.linalg.lstsq(balance, moments, rcond=None)[0]
    return float(pressure.max())


def _contact_points(each: PlacedGear) -> Array:
    """Points (K, 2) of the contact of an entry in the chassis' frame, evenly spaced [m]."""
    gear = each.gear
    rows = []
    for k in range(len(gear.places)):
        wheels = np.array(each.wheels(k))
        if gear.has_patches:
            count = max(1, round(gear.patch_length / _SPACING))
            rows.append(np.repeat(wheels[:, :2], count, axis=0))
            continue
        middle = (wheels[:, :2].min(axis=0) + wheels[:, :2].max(axis=0)) / 2
        count = max(2, round(gear.contact_length / _SPACING))
        along = gear.contact_length * np.linspace(-0.5, 0.5, count)
        rows.append(middle + np.outer(along, each.frame.turn[:2, 0]))
    return np.concatenate(rows)


def _free_name(each: PlacedGear, taken: set[str]) -> str:
    """A name for the tracks of an entry that no other entry has; `taken` grows by it."""
    gear, body = each.gear, each.body
    names = [body, *(f"{body}_{k}" for k in range(2, 1000))]
    if gear.sides != BOTH:
        single = f"{body}_track" if gear.flipper is not None else f"{body}_{gear.sides}"
        names = [single, f"{body}_{gear.sides}_track", *(f"{single}{k}" for k in range(2, 1000))]
    name = next(each for each in names if each not in taken)
    taken.add(name)
    return name


def load_spec(robot: TrackedRobot, looks: bool = False, refuse: Refuse = refuse) -> Any:
    """Load the robot's model without its scene, with its joints held or locked; the robot's
    keyframe is the only one that stays.

    Mesh files are located and the model's own wheels switched off; purely visual geoms stay only
    with `looks`.
    """
    return _load(robot, looks, refuse)[0]


def _load(robot: TrackedRobot, looks: bool, refuse: Refuse) -> tuple[Any, Joints, dict[str, float]]:
    """The spec of `load_spec`, what holds its joints, and the angles about z by which joints turn
    the bodies that carry running gear [rad].
    """
    spec = open_spec(robot, looks, refuse)
    if spec.keys:
        spec.compile()  # from here on, keyframes follow changes in the joints
    chassis = chassis_of(spec, robot).name
    for body in robot.gear_bodies:
        link_of(spec, robot, body, "tracks: body" if robot.tracks else "flippers: body")
    yaws = Model(spec, chassis, robot).yaws if robot.gear_bodies else {}
    joints = hold(spec, robot, chassis)
    lock(spec, robot, joints.held)
    return spec, joints, yaws


def open_spec(robot: TrackedRobot, looks: bool = False, refuse: Refuse = refuse) -> Any:
    """Load the robot's model as `load_spec` does, with all of its joints."""
    spec = robot.spec()
    spec.compiler.fusestatic = False  # the base link of a URDF is to stay a body
    for kind, things in (("body", spec.bodies), ("key", spec.keys)):
        for k, thing in enumerate(things):
            thing.name = thing.name or f"unnamed_{kind}{k}"
    for k, joint in enumerate(spec.joints):
        joint.name = joint.name or f"{joint.parent.name}_joint{k}"
    new = spec.default.geom  # default for geoms that are added later
    new.pos = [0.0, 0.0, 0.0]
    new.quat = [1.0, 0.0, 0.0, 0.0]
    new.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    forget_geoms(spec, spec.worldbody.geoms)
    for thing in (*spec.worldbody.geoms, *spec.worldbody.lights):
        spec.delete(thing)
    for geom in [] if looks else [geom for geom in spec.geoms if geom.group == VISUAL_GROUP]:
        if weightless(spec, geom):
            spec.delete(geom)
    switch_off(spec, robot)
    find_meshes(spec, robot.model, robot.packages, refuse)
    choose_start(spec, robot)
    return spec


def _light(spec: Any) -> None:
    """Add light and a sky, and allow larger pictures than MuJoCo's default."""
    spec.visual.global_.offwidth = 1920
    spec.visual.global_.offheight = 1080

    # low enough to draw without a GPU
    quality = spec.visual.quality
    quality.shadowsize = 2048
    quality.offsamples = 4
    quality.numslices = 16
    quality.numstacks = 8
    quality.numquads = 1

    if not any(texture.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX for texture in spec.textures):
        spec.add_texture(
            name="sky",
            type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
            builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
            rgb1=[0.45, 0.63, 0.82],
            rgb2=[0.86, 0.91, 0.95],
            width=256,
            height=1536,
        )
    headlight = spec.visual.headlight
    headlight.ambient = [0.36, 0.37, 0.39]
    headlight.diffuse = [0.3, 0.3, 0.3]
    headlight.specular = [0.05, 0.05, 0.05]
    spec.worldbody.add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=[6, -8, 12],
        dir=[-0.45, 0.6, -1],
        diffuse=[0.62, 0.6, 0.55],
        castshadow=True,
    )


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


def _motor_of(spec: Any, robot: TrackedRobot, placed: PlacedGear) -> tuple[str, str]:
    """Names of a flipper's hinge and motor; a hinge without a motor gets one."""
    settings = placed.gear.flipper
    assert settings is not None
    body = hinge_body(spec, placed.body)
    if [joint.type for joint in body.joints] != [_HINGE]:
        raise TrackslipError(
            f"{robot.model}: flippers: body = {placed.body!r}: must have one joint, a hinge, or be "
            "fixed to a body that has"
        )
    hinge = body.joints[0]
    rule = rule_for(robot.joints, hinge.name)
    if rule is not None and rule.motor is not None:
        settings = rule.motor
    if settings.limits is not None:
        unit = angle_unit(spec, hinge)
        hinge.range = [limit / unit for limit in settings.limits]
        hinge.limited = True
    motors = [each for each in spec.actuators if each.target == hinge.name]
    if not motors:
        motor = spec.add_actuator(
            name=f"{body.name}_motor", target=hinge.name, trntype=mujoco.mjtTrn.mjTRN_JOINT
        )
        motor.set_to_position(kp=settings.stiffness)
        damping = np.array(hinge.damping)
        # the joint's damping is integrated implicitly; a motor's may be unstable
        damping[0] += settings.damping
        hinge.damping = damping
        motor.forcerange = [-settings.torque, settings.torque]
        motor.forcelimited = True
        motors = [motor]
    motors[0].name = motors[0].name or f"{body.name}_motor"
    return hinge.name, motors[0].name


def _warn_of_rolling_links(robot: TrackedRobot, joints: Joints) -> None:
    """Issue a RobotWarning for wheels that nothing drives or holds."""
    if loose := joints.named(ROLLS):
        what = f"nothing drives or holds {counted(len(loose), 'hinge')} of wheels, {some(loose)}"
        hint = "list the links of wheels in `wheels`, or hold or free the hinges in [joints]"
        warnings.warn(f"{robot.model}: {what}; {hint}", RobotWarning, stacklevel=3)


def _read(
    model: mujoco.MjModel,
    robot: TrackedRobot,
    chassis: str,
    gear: Sequence[PlacedGear],
    hinges: Sequence[tuple[str, str]],
    states: Joints,
    refuse: Refuse,
) -> TrackedModel:
    """Read the indices and numbers of a compiled robot; `hinges` names each flipper's hinge and
    motor.
    """
    body = model.body(chassis).id
    free = model.body_jntadr[body]
    place = slice(model.jnt_qposadr[free], model.jnt_qposadr[free] + 7)
    # runs place the chassis themselves, at rest
    model.key_qpos[:, place] = model.qpos0[place]
    model.key_qvel[:] = 0.0
    # rules and couplings of joints go before the keyframe
    for name, angle in states.starts.items():
        joint = model.joint(name)
        if mujoco.mjtJoint(int(joint.type[0])) in (_HINGE, _SLIDE):
            model.key_qpos[:, joint.qposadr[0]] = angle
    joints = np.array([model.joint(hinge).id for hinge, _ in hinges], int)
    data = mujoco.MjData(model)
    data.qpos[model.jnt_qposadr[joints]] = 0.0
    mujoco.mj_forward(model, data)
    moving = (data.geom_xpos, data.geom_xmat, data.xipos, data.qacc)
    if not all(np.isfinite(values).all() for values in moving):
        raise TrackslipError(
            f"{robot.model}: a number in it is nan, inf or too large: its motion isn't finite"
        )
    if model.opt.gravity[2] >= 0 or model.opt.disableflags & _NEEDED:
        allowed = "must have gravity downwards, and no gravity, contact or constraint disabled"
        raise TrackslipError(f"{robot.model}: its <option> {allowed}")

    tracks = []
    for each in gear:
        for y, drive in zip(each.gear.places, each.gear.drives, strict=True):
            tracks.append(PlacedTrack(each, y, MOTORS[drive]))
    _check_across(model, data, robot, body, gear, refuse)
    _check_clear(model, data, robot, body, states.held, refuse)
    return TrackedModel(
        model=model,
        robot=robot,
        belts=Belts(model),
        body=body,
        free=(int(model.jnt_qposadr[free]), int(model.jnt_dofadr[free])),
        tracks=tuple(tracks),
        track_side=np.array([track.motor for track in tracks]),
        joints=states,
        **_flippers(model, data, body, tracks, hinges),
    )


def _flippers(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    body: int,
    tracks: Sequence[PlacedTrack],
    hinges: Sequence[tuple[str, str]],
) -> dict[str, Any]:
    """The fields of a TrackedModel about its F flippers, at their angles in `data`."""
    joints = np.array([model.joint(hinge).id for hinge, _ in hinges], int)
    count = len(joints)
    axes = data.xmat[body].reshape(3, 3)
    origin = data.xpos[body]
    names = []
    hinge = np.zeros((count, 3))
    tip = np.zeros((count, 3))
    radius = np.zeros(count)
    aside = np.zeros(count)
    for k, joint in enumerate(joints):
        own = on_hinge(model, tracks, joint)
        wheels = [_wheels_of(data, track) for track in own]
        places = np.concatenate([place for place, _ in wheels])
        away = np.linalg.norm(places - data.xanchor[joint], axis=1)
        hinge[k] = (data.xanchor[joint] - origin) @ axes
        tip[k] = (places[away.argmax()] - origin) @ axes
        radius[k] = np.concatenate([size for _, size in wheels]).mean()
        for track, (place, _) in zip(own, wheels, strict=True):
            lateral = float(((place[0] - origin) @ axes)[1])
            aside[k] = max(aside[k], abs(lateral) + track.gear.gear.width / 2)
        names.append(own[0].gear.body)
    reach = tip - hinge
    length = np.hypot(reach[:, 0], reach[:, 2])
    rest = np.arctan2(reach[:, 2], np.abs(reach[:, 0]))
    lifts = np.cross(data.xaxis[joints] @ axes, reach)[:, 2] >= 0
    sign = np.where(lifts, 1.0, -1.0)
    limits = np.where(endless(model)[joints, None], [-np.pi, np.pi], model.jnt_range[joints])
    return {
        "flipper_names": tuple(names),
        "flipper_qpos": model.jnt_qposadr[joints],
        "flipper_motor": np.array([model.actuator(motor).id for _, motor in hinges], int),
        "flipper_sign": sign,
        "flipper_range": np.sort(sign[:, None] * limits, axis=1),
        "flippers": FlipperGeometry(hinge, length, radius, reach[:, 0] > 0, rest, aside),
    }


def on_hinge(model: mujoco.MjModel, tracks: Sequence[PlacedTrack], joint: int) -> list[PlacedTrack]:
    """The tracks of flippers on a hinge."""
    moved = model.body_weldid[model.jnt_bodyid[joint]]
    flippers = [track for track in tracks if track.gear.gear.flipper is not None]
    return [t for t in flippers if model.body_weldid[model.body(t.gear.body).id] == moved]


def _check_across(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    robot: TrackedRobot,
    body: int,
    gear: Sequence[PlacedGear],
    refuse: Refuse,
) -> None:
    """Call `refuse` for flippers whose hinge isn't lateral, and for tracks on the wrong side."""
    lateral = data.xmat[body].reshape(3, 3)[:, 1]
    for each in gear:
        name = each.body
        field = "tracks" if robot.tracks else "flippers"
        root = model.body_weldid[model.body(name).id]
        if each.gear.flipper is not None:
            axis = data.xaxis[model.body_jntadr[root]]
            if abs(axis @ lateral) < _ACROSS:
                refuse(f"{robot.model}: body {name!r}: must have its hinge along the chassis' y")
                continue
        side = each.gear.sides
        if side not in SIDES:
            continue
        place = each.wheels(0)[0][1]
        beyond = place - robot.offset if side == "left" else robot.offset - place
        if beyond < -_CLEAR:
            what = f"{field}: side of {name!r} = {side!r}: lies at y = {place:.3g} m"
            refuse(f"{robot.model}: {what}, on the other side")


def _check_clear(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    robot: TrackedRobot,
    body: int,
    held: dict[str, float],
    refuse: Refuse,
) -> None:
    """Call `refuse` for geoms of the chassis, or held to it, that reach as low as its tracks, and
    so would touch level ground.
    """
    chassis = model.body_weldid[body]
    for geom in np.flatnonzero(colliding(model)).tolist():
        link = int(model.geom_bodyid[geom])
        joints = _held_between(model, link, body, held)
        if joints is None:
            continue
        low = outline(model, data, data.body(body), geom)[:, 2].min()
        if low >= robot.lowest + _CLEAR:
            continue
        what = (
            f"{robot.model}: {_named(model, geom)} reaches down to {low:.3g} m in the "
            f"frame of {model.body(body).name}"
        )
        allowed = f"must stay above the tracks' lowest point, at {robot.lowest:.3g} m"
        way_on = "if tracks replace it, list its link in `wheels`"
        if model.body_weldid[link] != chassis:
            way_on = f"hold it at another angle, or free it, in [joints]: {some(joints)}"
        refuse(f"{what}; what touches {allowed}; {way_on}")


def _held_between(
    model: mujoco.MjModel, link: int, chassis: int, held: dict[str, float]
) -> list[str] | None:
    """The held joints between a link and the chassis, or None for a link that other joints move, or
    that isn't the robot's.
    """
    joints = []
    while link != chassis:
        if link == 0:
            return None
        first = model.body_jntadr[link]
        own = [model.joint(k).name for k in range(first, first + model.body_jntnum[link])]
        if any(name not in held for name in own):
            return None
        joints += own
        link = int(model.body_parentid[link])
    return joints


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
    model = tracked.model
    data = mujoco.MjData(model)
    low, high = tracked.flipper_range.T
    # level, whatever the file's pose
    data.qpos[tracked.free[0] + 3 : tracked.free[0] + 7] = [1.0, 0.0, 0.0, 0.0]
    tried = np.linspace(np.clip(0.0, low, high), high, _STEPS)  # (K, F) angles to try
    clear = np.zeros(tried.shape, bool)
    for angles, above in zip(tried, clear, strict=True):
        data.qpos[tracked.flipper_qpos] = tracked.flipper_control(angles)
        mujoco.mj_kinematics(model, data)
        above[:] = lowest_of_flippers(tracked, data) >= tracked.robot.lowest - _ROUNDING
    return np.asarray(tried[clear.argmax(axis=0), np.arange(len(tracked.flipper_names))])


def lowest_of_flippers(tracked: TrackedModel, data: mujoco.MjData) -> Array:
    """Heights (F,) of the lowest point of each flipper above the chassis' frame, of a level robot
    in the pose of `data` [m].
    """
    model = tracked.model
    heights = []
    for place in tracked.flipper_qpos:
        joint = int(np.flatnonzero(model.jnt_qposadr == place)[0])
        wheels = [_wheels_of(data, track) for track in on_hinge(model, tracked.tracks, joint)]
        heights.append(min(float((at[:, 2] - radius).min()) for at, radius in wheels))
    return np.array(heights) - data.xpos[tracked.body, 2]


def _wheels_of(data: mujoco.MjData, track: PlacedTrack) -> tuple[Array, Array]:
    """Positions (W, 3) in the world, and radii (W,), of the wheels of a track [m]."""
    x, z, radius = np.array(track.gear.hull).T
    body = data.body(track.gear.body)
    inside = np.column_stack([x, np.full_like(x, track.y), z]) @ track.gear.frame.axes.T
    return inside @ body.xmat.reshape(3, 3).T + body.xpos, radius
