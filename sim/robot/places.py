"""Places of a robot's running gear in its model, and the robot whose list of tracks is complete.

Tracks lie in frames that are parallel to the chassis while the hinges of flippers are at 0, however
the frames of their bodies are turned. Where joints turn a body about the chassis' z axis, the frame
of its tracks turns with it. The wheels of a hull are given in the body's own frame: by
their coordinates along the two of its axes that aren't lateral. In a frame without a lateral axis,
they are given along the chassis' x and z axes.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import mujoco
import numpy as np

from sim.robot.gear import BOTH, LEFT, RIGHT, RunningGear, Wheels, levelled
from sim.robot.joint_rules import FLIPPER, HOLD, rule_for
from sim.robot.joints import hinge_body, joint_states
from sim.robot.parameters import WHEELS
from sim.robot.tracked import TrackedRobot
from sim.robot.wheel_reading import (
    Model,
    contradictions,
    read_entry,
    read_wheels,
    require_ahead,
    require_straight,
    turning_links,
)
from sim.robot.wheels import colliding, link_of
from trackslip.errors import InvalidValueError, RobotWarning, TrackslipError
from trackslip.kinematics import Array

_LATERAL: Final = 0.99  # least cosine between a lateral axis and the chassis' y axis [-]
_EXACT: Final = 1e-9  # largest rounding error of a direction [-]
_X, _Y, _Z = 0, 1, 2


@dataclass(frozen=True)
class Frame:
    """The frame of the tracks on a body."""

    axes: Array  # (3, 3) columns point forwards, left and up, in the body's frame
    turn: Array  # (3, 3) the same in the chassis' frame
    origin: Array  # (3,) the body's origin in the chassis' frame [m]

    @classmethod
    def of_chassis(cls) -> Frame:
        """The frame of tracks on the chassis."""
        return cls(np.eye(3), np.eye(3), np.zeros(3))

    @classmethod
    def of_body(cls, model: Model, body: str) -> Frame:
        """The frame of tracks on a body of a model in the pose of its data."""
        if body == model.chassis:
            return cls.of_chassis()
        base, own = model.data.body(model.chassis), model.data.body(body)
        to_world = base.xmat.reshape(3, 3)
        left = _lateral(model, body)
        ahead = to_world[:, _X] - (to_world[:, _X] @ left) * left
        ahead = ahead / np.linalg.norm(ahead)
        world = np.column_stack([ahead, left, np.cross(ahead, left)])
        axes = own.xmat.reshape(3, 3).T @ world
        origin = to_world.T @ (own.xpos - base.xpos)
        return cls(_tidy(axes), _tidy(to_world.T @ world), origin)

    @property
    def is_bodys(self) -> bool:
        """Whether it is the body's own frame."""
        return bool((self.axes == np.eye(3)).all())

    @cached_property
    def plane(self) -> tuple[int, int] | None:
        """The body's axes along which hulls are given, or None for those of the chassis."""
        lateral = np.flatnonzero(np.abs(self.axes[:, _Y]) >= _LATERAL).tolist()
        if not lateral:
            return None
        first, second = (axis for axis in (_X, _Y, _Z) if axis != lateral[0])
        return first, second

    def to_track(self, hull: Wheels) -> Wheels:
        """The wheels, given in the body's frame, in the frame of the tracks."""
        if self.plane is None or self.is_bodys:
            return hull
        first, second = self.axes[list(self.plane)][:, [_X, _Z]]
        return tuple((*(a * first + b * second).tolist(), radius) for a, b, radius in hull)

    def to_body(self, hull: Wheels) -> Wheels:
        """The wheels, in the frame of the tracks, as they are given in the body's frame."""
        if self.plane is None or self.is_bodys:
            return hull
        first, second = self.axes[list(self.plane)][:, [_X, _Z]]
        given = []
        for x, z, radius in hull:
            place = np.array([x, z])
            a, b = float(place @ first), float(place @ second)
            given.append((round(a, 6), round(b, 6), radius))
        return tuple(given)

    def to_chassis(self, y: float, hull: Wheels) -> list[list[float]]:
        """Places (x, y, z) and radii of the wheels of a track at `y`, in the chassis' frame [m]."""
        rows = []
        for x, z, radius in hull:
            place = self.origin + self.turn @ np.array([x, y, z])
            rows.append([*place.tolist(), radius])
        return rows

    def from_chassis(self, gear: RunningGear) -> RunningGear:
        """Running gear in the chassis' frame, as it is given in the body's frame."""
        if (self.axes == np.eye(3)).all() and not self.origin.any():
            return gear
        places = [float((self._inside(0.0, y, 0.0))[_Y]) for y in gear.places]
        rounded = [round(place, 6) for place in places]
        y: float | tuple[float, float] = rounded[0]
        if gear.sides == BOTH and rounded[0] != -rounded[1]:
            y = (rounded[0], rounded[1])
        hull = []
        for x, z, radius in gear.hull:
            inside = self._inside(x, gear.places[0], z)
            hull.append((round(float(inside[_X]), 6), round(float(inside[_Z]), 6), radius))
        return replace(gear, y=y, hull=self.to_body(tuple(hull)))

    def _inside(self, x: float, y: float, z: float) -> Array:
        """A point of the chassis' frame in the frame of the tracks [m]."""
        return np.asarray(self.turn.T @ (np.array([x, y, z]) - self.origin))


def _lateral(model: Model, body: str) -> Array:
    """Direction (3,) to the left of the tracks on a body, in the world: along its hinge if that is
    lateral, otherwise the chassis' y axis, turned with the body about the chassis' z axis.
    """
    left = model.left_of(body)
    link = hinge_body(model.spec, body)
    joints = model.model.body(link.name)
    if joints.jntnum[0] == 1:
        axis = model.data.xaxis[int(joints.jntadr[0])]
        if abs(axis @ left) >= _LATERAL:
            return np.asarray(axis * np.sign(axis @ left))
    return np.asarray(left)


def _tidy(matrix: Array) -> Array:
    """A rotation without rounding errors in components that are 0 or 1."""
    whole = np.rint(matrix)
    return np.where(np.abs(matrix - whole) < _EXACT, whole + 0.0, matrix)


@dataclass(frozen=True)
class PlacedGear:
    """Running gear with its place in a model."""

    gear: RunningGear
    body: str  # the body that carries it
    frame: Frame
    hull: Wheels  # in the frame of the tracks

    def wheels(self, k: int) -> list[list[float]]:
        """Places (x, y, z) and radii of the wheels of its track `k`, in the chassis' frame [m]."""
        return self.frame.to_chassis(self.gear.places[k], self.hull)


def placed(robot: TrackedRobot, chassis: str, model: Model | None) -> list[PlacedGear]:
    """The running gear of a robot with its places; only robots with running gear on other bodies
    than the chassis need a model.
    """
    found = []
    for gear in robot.gear:
        body = gear.body or chassis
        frame = Frame.of_chassis()
        if body != chassis and model is not None:
            frame = Frame.of_body(model, body)
        hull = frame.to_track(gear.hull)
        if gear.flipper is None:
            hull = levelled(hull)
        found.append(PlacedGear(gear, body, frame, hull))
    return found


def model_at_rest(spec: Any, chassis: str, robot: TrackedRobot) -> Model:
    """The robot's model at its start, with the hinges of its flippers at their reference."""
    model = Model(spec, chassis, robot)
    for gear in robot.gear:
        if gear.flipper is None:
            continue
        for joint in hinge_body(model.spec, gear.body or chassis).joints:
            if joint.type != mujoco.mjtJoint.mjJNT_HINGE:
                continue
            place = int(model.model.joint(joint.name).qposadr[0])
            model.data.qpos[place] = model.model.qpos0[place]
    mujoco.mj_kinematics(model.model, model.data)
    return model


def with_gear(
    robot: TrackedRobot, spec: Any, chassis: str, given: Sequence[str], replaces_all: bool
) -> TrackedRobot:
    """The robot with a complete list of tracks, read from the wheels of its model where the robot
    file leaves it open.

    `given` are the fields of the robot file, and `replaces_all` whether tracks replace all wheels.
    Raises TrackslipError, which says why and what to write, for wheels that tell no running gear.
    """
    for name in robot.gear_bodies:
        link_of(spec, robot, name, "tracks: body" if robot.tracks else "flippers: body")
    robot = _with_flippers_by_rule(robot, spec)
    model = model_at_rest(spec, chassis, robot)
    if robot.tracks and replaces_all:
        raise TrackslipError(
            f'{robot.model}: wheels = "replace": must be left out, or a list of links, beside '
            "[[tracks]]: each of these lists its own `wheels`"
        )
    if robot.tracks:
        robot = _with_entries(robot, model)
    elif replaces_all or robot.wheels:
        robot = _with_own_wheels(robot, model, given, replaces_all)
    if robot.tracks or not robot.hull:
        if not robot.tracks:
            flippers = tuple(flipper.gear for flipper in robot.flippers)
            robot = replace(robot, tracks=flippers, flippers=())
        return summarised(robot, chassis, model)
    return robot


def _with_flippers_by_rule(robot: TrackedRobot, spec: Any) -> TrackedRobot:
    """The robot, in which tracks on hinges with the motor of a flipper are flippers."""
    entries = []
    for gear in robot.tracks:
        joints = hinge_body(spec, gear.body).joints if gear.body else []
        rules = [rule_for(robot.joints, joint.name) for joint in joints]
        motors = [rule.motor for rule in rules if rule is not None and rule.state == FLIPPER]
        entries.append(replace(gear, flipper=motors[0]) if motors and motors[0] else gear)
    return replace(robot, tracks=tuple(entries)) if robot.tracks else robot


def _with_entries(robot: TrackedRobot, model: Model) -> TrackedRobot:
    """The robot with complete entries in its list of tracks."""
    entries = []
    taken: dict[str, int] = {}  # index of the entry that has a wheel
    for k, gear in enumerate(robot.tracks):
        for name in gear.wheels:
            if taken.setdefault(name, k) != k:
                raise TrackslipError(
                    f"{robot.model}: tracks[{k}]: wheels = {name!r}: must be in one entry only, "
                    f"but is in tracks[{taken[name]}] too"
                )
        if not gear.wheels and not gear.is_complete:
            missing = "y" if gear.hull else "hull"
            raise TrackslipError(
                f"{robot.model}: tracks[{k}]: {missing} is missing: give `y` and `hull`, or the "
                "links of its `wheels`, from which they are read"
            )
        entries.append(_complete(gear, model) if gear.wheels else gear)
    links = [name for gear in entries for name in gear.wheels]
    wheels = tuple(dict.fromkeys([*robot.wheels, *links]))
    return replace(robot, tracks=tuple(entries), wheels=wheels)


def _complete(gear: RunningGear, model: Model) -> RunningGear:
    """An entry whose open values are read from its wheels."""
    for name in gear.wheels:
        link_of(model.spec, model.robot, name, "tracks: wheels")
    if gear.is_complete:
        require_straight(model, gear.wheels, gear.body)
        return gear
    frame = Frame.of_body(model, gear.body or model.chassis)
    read = frame.from_chassis(read_entry(model, gear))
    y = read.y if gear.y is None else gear.y
    return replace(gear, y=y, hull=gear.hull or read.hull, origin=read.origin)


def _with_own_wheels(
    robot: TrackedRobot, model: Model, given: Sequence[str], replaces_all: bool
) -> TrackedRobot:
    """The robot with the running gear of the model's wheels: `robot.wheels`, or all of them."""
    listed = [name for name in robot.wheels if name not in robot.gear_bodies]
    for name in listed:
        link_of(model.spec, robot, name)
    is_given = {"half_gauge", "hull"} <= set(given)
    template = RunningGear(
        contact=robot.contact,
        patch_length=robot.patch_length,
        width=robot.width,
        lines=robot.lines,
    )
    try:
        turning = turning_links(model, [] if replaces_all else listed)
    except TrackslipError:
        if not is_given:
            raise
        return robot
    require_ahead(model, turning, listed)
    require_straight(model, turning)
    if replaces_all:
        links = (*turning, *robot.flipper_bodies)
        robot = replace(robot, wheels=tuple(dict.fromkeys(links)))
    _require_no_ghosts(robot, model)
    if not turning and robot.flippers and not given:
        return replace(robot, half_gauge=0.0, hull=())  # it stands on its flippers
    moving = moving_bodies(model, [] if replaces_all else robot.wheels, replaces_all)
    try:
        reading = read_wheels(model, [] if replaces_all else listed, moving, template)
    except TrackslipError:
        if not is_given:
            raise
        return robot
    (first, *others) = reading.gear
    if others or first.body != model.chassis or first.aside:
        if is_given:
            return robot
        return replace(robot, tracks=_in_their_bodies(model, reading.gear))
    return _with_pair(robot, first, given)


def _require_no_ghosts(robot: TrackedRobot, model: Model) -> None:
    """Raise TrackslipError for a link that collides, is fixed to a flipper on the other side of the
    chassis, and is no flipper itself: tracks would replace it, but nothing would drive there.
    """
    for flipper in robot.flippers:
        if flipper.body not in robot.wheels:
            continue
        own = model.body(flipper.body)
        y = _lateral_place(model, own)
        rigid = model.model.body_weldid == model.model.body_weldid[own]
        sides = {each.side for each in robot.flippers if rigid[model.body(each.body)]}
        if len(sides) > 1:
            continue
        for body in np.flatnonzero(rigid).tolist():
            name = model.name(body)
            if name not in robot.wheels and _lateral_place(model, body) * y < 0:
                raise TrackslipError(
                    f"{robot.model}: flippers: {name!r} is fixed to {flipper.body!r}, but lies on "
                    "the other side: must be a flipper of its own, or nothing would drive there: "
                    f'[[flippers]] with body = "{name}"'
                )


def _lateral_place(model: Model, body: int) -> float:
    """Mean place of a link's own shapes that collide, left of the chassis' frame [m]; 0 without."""
    shapes = colliding(model.model) & (model.model.geom_bodyid == body)
    if not shapes.any():
        return 0.0
    base = model.data.body(model.chassis)
    left = base.xmat.reshape(3, 3)[:, _Y]
    return float(((model.data.geom_xpos[shapes] - base.xpos) @ left).mean())


def _in_their_bodies(model: Model, gear: Sequence[RunningGear]) -> tuple[RunningGear, ...]:
    """Running gear in the chassis' frame, as it is given in the frames of its bodies."""
    found = []
    for each in gear:
        frame = Frame.of_body(model, each.body)
        inside = frame.from_chassis(each)
        found.append(replace(inside, body="" if each.body == model.chassis else each.body))
    return tuple(found)


def _with_pair(robot: TrackedRobot, read: RunningGear, given: Sequence[str]) -> TrackedRobot:
    """The robot with the pair of tracks that its wheels tell, unless its file gives the values."""
    left, right = read.places
    values: dict[str, Any] = {"half_gauge": (left - right) / 2, "hull": read.hull}
    if isinstance(read.y, tuple):
        values["offset"] = round((left + right) / 2, 6)
        values["half_gauge"] = round((left - right) / 2, 6)
    open_values = {name: value for name, value in values.items() if name not in given}
    names = ("half_gauge", "offset", "hull")
    stated = " and ".join(name.replace("_", " ") for name in names if name in given)
    origin = f"({stated} given, the rest {read.origin})" if stated else read.origin
    if not {"half_gauge", "hull"} & open_values.keys():
        origin = f"given, middle {read.origin}" if "offset" in open_values else "given"
    try:
        found = replace(robot, **open_values, origin=origin)
    except InvalidValueError as error:
        hint = ""
        if error.field == "hull":
            hint = "; give `hull`, or [[tracks]], in which a side may have one wheel"
        raise TrackslipError(f"{robot.model}: of its wheels, {error}{hint}") from error
    for line in contradictions(found.gear[0], read):
        warnings.warn(f"{robot.model}: {line}", RobotWarning, stacklevel=2)
    return found


def moving_bodies(model: Model, replaced: Sequence[str], replaces_all: bool) -> set[str]:
    """Names of the bodies with joints that aren't held or locked; if all wheels are replaced, none
    of them rolls on its own.
    """
    states = joint_states(model.spec, model.robot, None if replaces_all else model, replaced)
    moving = set()
    for name, state in states.items():
        if state != HOLD:
            moving.add(model.spec.joint(name).parent.name)
    return moving


def summarised(robot: TrackedRobot, chassis: str, model: Model) -> TrackedRobot:
    """The robot with the half gauge, the offset and the hull of its whole running gear, in the
    chassis' frame: what drivers, courses and pictures need.

    The tracks that bear the robot's weight count: all but flippers, or all of a robot that has no
    others. The gauge is that of the belts that the left and right motors drive, weighted by the
    length of their contact.
    """
    gear = [each for each in placed(robot, chassis, model) if each.gear.flipper is None]
    gear = gear or placed(robot, chassis, model)
    hull = []
    by_side: dict[str, list[tuple[float, float]]] = {LEFT: [], RIGHT: []}
    edges = []
    for each in gear:
        for k, drive in enumerate(each.gear.drives):
            wheels = each.wheels(k)
            hull += [(round(x, 6), round(z, 6), radius) for x, _, z, radius in wheels]
            y = float(np.mean([wheel[_Y] for wheel in wheels]))
            edges.append(y)
            if drive in by_side:
                by_side[drive].append((y, each.gear.contact_length))
    left = _weighted(by_side[LEFT]) if by_side[LEFT] else max(edges)
    right = _weighted(by_side[RIGHT]) if by_side[RIGHT] else min(edges)
    driven = next((each.gear for each in gear if each.gear.contact != "skid"), gear[0].gear)
    half = (left - right) / 2
    middle = round((left + right) / 2, 6)
    return replace(
        robot,
        half_gauge=round(half, 6) if half > 0 else driven.width / 2,
        offset=middle if abs(middle) > _EXACT else 0.0,
        hull=tuple(sorted(set(hull))),
        contact=driven.contact if driven.contact == WHEELS else "tracks",
        patch_length=driven.patch_length,
        width=driven.width,
        lines=driven.lines,
    )


def _weighted(places: Sequence[tuple[float, float]]) -> float:
    """Mean of places, weighted by the lengths beside them."""
    total = sum(length for _, length in places)
    return sum(y * length for y, length in places) / total
