"""A model's own wheels, and the running gear that they tell: gauge, offset and hull.

Wheels are round links that collide and turn endlessly about the chassis' y axis. Wheels on the left
and on the right must be alike; each axle keeps its place.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, Final

import mujoco
import numpy as np
import scipy
from numpy.typing import NDArray

from sim.robot.gear import BOTH, SAME_HEIGHT, RunningGear
from sim.robot.parameters import WHEELS
from sim.robot.start_pose import start_pose
from sim.robot.tracked import TrackedRobot
from sim.robot.urdf import some
from sim.robot.wheels import carriers, endless, extent
from trackslip.errors import InvalidValueError, RobotWarning, TrackslipError
from trackslip.kinematics import Array

_AXIS: Final = 0.95  # least cosine between a wheel's axis and the chassis' y axis [-]
# largest difference between two widths of a wheel at right angles, relative to their mean [-]
_ROUND: Final = 0.1
# turns about a wheel's axis at which these widths are compared [rad]
_DIRECTIONS: Final = np.radians([0, 15, 30, 45, 60, 75])
# largest difference between wheels on the left and right, relative to the radius [-]
_MIRRORED: Final = 0.1
# smallest |y| of a wheel, relative to the largest of all; those nearer to the middle are casters
# [-]
_MIDDLE: Final = 0.25
# largest difference in place between axles of one gauge, relative to the half gauge [-]
_ALIKE: Final = 0.005
# offset of the sides below which a model's frame counts as being in its middle [m]
_CENTRED: Final = 1e-4
# largest angle about z between a wheel's axis and the lateral axis of its running gear [rad]
_STEERED: Final = 0.01
_EXACT: Final = 1e-9  # largest rounding error of an angle [rad]
_LIGHT: Final = 1e-9  # least mass and inertia of links, as locked links may weigh nothing
_HINGE: Final = mujoco.mjtJoint.mjJNT_HINGE
_X, _Y, _Z = 0, 1, 2


@dataclass(frozen=True)
class Wheel:
    """A wheel of the model, in the chassis' frame."""

    name: str
    unit: str  # the body that carries it and moves on its own, or the chassis
    x: float  # [m]
    y: float  # [m]
    z: float  # [m]
    radius: float  # [m]


@dataclass(frozen=True)
class Reading:
    """What a model's wheels tell."""

    links: tuple[str, ...]  # the links that turn as wheels do
    gear: tuple[RunningGear, ...]  # in the chassis' frame, for its body and for other units

    @property
    def wheels(self) -> str:
        """Names of the links that the gear was read from."""
        return "; ".join(gear.origin for gear in self.gear)


class Model:
    """A robot's model as it is before its joints are held, in the pose in which it starts."""

    def __init__(self, spec: Any, chassis: str, robot: TrackedRobot) -> None:
        """Compile a copy of the spec, in which links may weigh nothing."""
        copy = spec.copy()
        copy.compiler.boundmass = _LIGHT
        copy.compiler.boundinertia = _LIGHT
        self.spec = copy
        self.model = copy.compile()
        self.robot = robot
        self.chassis = chassis
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:] = start_pose(self.model, robot)
        mujoco.mj_kinematics(self.model, self.data)
        self.reference = mujoco.MjData(self.model)
        mujoco.mj_kinematics(self.model, self.reference)
        self.yaws = {name: self._yaw(name) for name in robot.gear_bodies if self._has(name)}
        """Angles by which joints turn the bodies that carry running gear about the chassis' z axis,
        from the model's reference to its start [rad].
        """

    def _has(self, name: str) -> bool:
        """Whether the model has a body of this name."""
        return mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, name) >= 0

    def _yaw(self, name: str) -> float:
        """Angle by which joints turn a body about the chassis' z axis, at its start [rad]."""
        turns = []
        for data in (self.reference, self.data):
            base = data.body(self.chassis).xmat.reshape(3, 3)
            turns.append(base.T @ data.body(name).xmat.reshape(3, 3))
        left = turns[1] @ turns[0].T[:, _Y]  # where the joints turn the chassis' y axis
        yaw = float(np.arctan2(-left[_X], left[_Y]))
        return yaw if abs(yaw) > _EXACT else 0.0

    def left_of(self, body: str) -> Array:
        """Direction (3,) to the left of tracks on a body, in the world."""
        base = self.data.body(self.chassis).xmat.reshape(3, 3)
        yaw = self.yaws.get(body, 0.0)
        if yaw == 0.0:
            return np.asarray(base[:, _Y])
        return np.asarray(np.cos(yaw) * base[:, _Y] - np.sin(yaw) * base[:, _X])

    def body(self, name: str) -> int:
        """Index of a body."""
        return int(self.model.body(name).id)

    def name(self, body: int) -> str:
        """Name of a body."""
        return str(self.model.body(body).name)

    def turning(self, axis: int) -> set[int]:
        """Bodies on the chassis that a hinge turns about an axis of it, at the start or, for
        steered wheels, in the model's reference.
        """
        own = self.model.body_rootid == self.body(self.chassis)
        along = np.zeros(self.model.njnt, bool)
        for data in (self.data, self.reference):
            base = data.body(self.chassis).xmat.reshape(3, 3)
            along |= np.abs(data.xaxis @ base[:, axis]) > _AXIS
        along &= (self.model.jnt_type == _HINGE) & own[self.model.jnt_bodyid]
        return set(self.model.jnt_bodyid[along].tolist())

    def spinning(self, axis: int) -> set[int]:
        """Bodies that turn endlessly about an axis of the chassis."""
        ending = self.model.jnt_bodyid[~endless(self.model)].tolist()
        return self.turning(axis) - set(ending)

    def size(self, body: int) -> Array:
        """Smallest and largest coordinates (2, 3) of a link in the chassis' frame [m]."""
        return extent(self.model, self.data, self.data.body(self.chassis), body)

    def has_shape(self, body: int) -> bool:
        """Whether a link has a shape from which its size can be read."""
        return bool(np.isfinite(self.size(body)).all())

    def is_round(self, body: int, axis: int = _Y) -> bool:
        """Whether a link is round about its own hinge, or about an axis of the chassis if it has no
        hinge: its widths in any two directions at right angles across the axis are alike.
        """
        base = self.data.body(self.chassis)
        about = base.xmat.reshape(3, 3)[:, axis]
        if self.model.body_jntnum[body] == 1:
            hinge = int(self.model.body_jntadr[body])
            if self.model.jnt_type[hinge] == _HINGE:
                about = self.data.xaxis[hinge]
        ahead = np.cross(about, [0.0, 0.0, 1.0])
        ahead = ahead / np.linalg.norm(ahead)
        up = np.cross(ahead, about)
        for angle in _DIRECTIONS:
            one = np.cos(angle) * ahead + np.sin(angle) * up
            other = np.cos(angle) * up - np.sin(angle) * ahead
            turned = np.column_stack([one, about, other])
            frame = SimpleNamespace(xmat=turned.ravel(), xpos=base.xpos)
            low, high = extent(self.model, self.data, frame, body)
            width, height = (high - low)[[_X, _Z]]
            if not abs(width - height) < _ROUND * (width + height) / 2:
                return False
        return True


def turning_links(model: Model, listed: Sequence[str]) -> list[str]:
    """The links that are wheels; `listed` ones may have limits or be fixed.

    Parts of wheels, and links that carry wheels, such as rockers and knuckles, don't count. Raises
    TrackslipError for `listed` links that turn endlessly about y but aren't round.
    """
    spinning, turning = model.spinning(_Y), model.turning(_Y)
    names = [model.name(body) for body in sorted(spinning)]
    chosen = list(listed) or [name for name in names if name not in model.robot.gear_bodies]
    bodies = {model.body(name): name for name in chosen}
    parts = {body for body in bodies if _is_part(model, body, spinning & bodies.keys())}
    whole = [model.spec.body(name) for body, name in bodies.items() if body not in parts]
    carrying = {carrier.name for link in whole for carrier in carriers(link)}
    wheels = []
    for body, name in bodies.items():
        hinged = bool(model.model.body_jntnum[body])
        if body in parts or name in carrying or (hinged and body not in turning):
            continue
        if model.is_round(body):
            wheels.append(name)
        elif listed and body in spinning:
            lacks = "" if model.has_shape(body) else " but has no shape,"
            raise TrackslipError(
                f"{model.robot.model}: wheels = {name!r}: turns endlessly,{lacks} must be round to "
                "be a wheel; give `hull` and `half_gauge`"
            )
    return wheels


def _is_part(model: Model, body: int, wheels: set[int]) -> bool:
    """Whether a body is fixed to one of the wheels."""
    root = int(model.model.body_weldid[body])
    return root != body and root in wheels


def rolling(model: Model, replaced: Sequence[str]) -> set[str]:
    """Names of the links that roll on their own: wheels that tracks don't replace, and what carries
    them on endless hinges, such as the forks of casters.
    """
    wheels = [name for name in turning_links(model, []) if name not in replaced]
    rolls = set(wheels)
    endless_joints = endless(model.model)
    for name in wheels:
        for carrier in carriers(model.spec.body(name)):
            body = model.body(carrier.name)
            first, count = model.model.body_jntadr[body], model.model.body_jntnum[body]
            if carrier.name != model.chassis and endless_joints[first : first + count].any():
                rolls.add(carrier.name)
    return rolls


def read_wheels(
    model: Model, listed: Sequence[str], moving: set[str], template: RunningGear
) -> Reading:
    """The running gear of a model's wheels: the `listed` links, or by default all links that turn
    endlessly. `moving` names the bodies that joints move; wheels on flippers don't count.

    Raises TrackslipError, which says why and what to write, if the wheels tell no running gear.
    """
    robot = model.robot
    links = turning_links(model, listed)
    require_ahead(model, links, listed)
    require_straight(model, links)
    found = [_wheel(model, name, moving) for name in links]
    wheels = [wheel for wheel in found if wheel.unit not in robot.flipper_bodies]
    units = dict.fromkeys(wheel.unit for wheel in wheels)
    if not wheels:
        raise TrackslipError(_none_found(model, listed))
    places = [wheel.y for wheel in wheels]
    middle = (max(places) + min(places)) / 2
    _require_two_axles(robot, wheels)
    gear = []
    try:
        for unit in units:
            own = [wheel for wheel in wheels if wheel.unit == unit]
            gear += _gear_of_unit(model, unit, own, middle, listed, template)
    except InvalidValueError as error:
        hint = "; give `hull`" if error.field == "hull" else ""
        raise TrackslipError(f"{robot.model}: of its wheels, {error}{hint}") from error
    return Reading(tuple(links), tuple(gear))


def _require_two_axles(robot: TrackedRobot, wheels: Sequence[Wheel]) -> None:
    """Raise TrackslipError for a machine all of whose wheels stand on one axle: neither a belt nor
    the robot's balance is known from them.
    """
    smallest = min(wheel.radius for wheel in wheels)
    places = [(wheel.x, wheel.z) for wheel in wheels]
    if np.ptp(places, axis=0).max() >= _MIRRORED * smallest:
        return
    names = some([wheel.name for wheel in wheels])
    raise TrackslipError(
        f"{robot.model}: of its wheels, {names} are on one axle: must be on two or more: give the "
        '`hull` of the tracks around them, or [[tracks]] with contact = "wheels" for this axle, '
        'and another, such as contact = "skid", for what else the robot stands on'
    )


def read_entry(model: Model, entry: RunningGear) -> RunningGear:
    """An entry of the list of tracks with what its `wheels` tell, in the chassis' frame.

    Raises TrackslipError, which says why and what to write, if the wheels tell no running gear.
    """
    links = turning_links(model, entry.wheels)
    require_ahead(model, links, entry.wheels)
    require_straight(model, links)
    if not links:
        raise TrackslipError(_none_found(model, entry.wheels))
    unit = entry.body or model.chassis
    wheels = [_wheel(model, name, {unit}) for name in links]
    if entry.sides != BOTH:
        return _single(entry, unit, wheels, entry.sides)
    middle = float(np.mean([wheel.y for wheel in wheels]))
    left = [wheel for wheel in wheels if wheel.y > middle]
    right = [wheel for wheel in wheels if wheel.y <= middle]
    return _pair_gear(entry, unit, _pairs(model, left, right, middle, entry.wheels))


def _wheel(model: Model, name: str, moving: set[str]) -> Wheel:
    """The place and size of a wheel."""
    low, high = model.size(model.body(name))
    x, y, z = ((low + high) / 2).tolist()
    radius = float((high - low)[[_X, _Z]].mean() / 2)
    return Wheel(name, _unit(model, name, moving), x, y, z, radius)


def require_ahead(model: Model, links: Sequence[str], listed: Sequence[str]) -> None:
    """Raise TrackslipError for a machine whose wheels turn about x, so that it drives along y."""
    if links:
        return
    candidates = sorted(model.spinning(_X))
    about_x = [model.name(body) for body in candidates if model.is_round(body, _X)]
    about_x = [name for name in about_x if not listed or name in listed]
    if not about_x:
        return
    raise TrackslipError(
        f"{model.robot.model}: wheels = {some(about_x)}: turn about x, so the machine drives along "
        "y, must turn about y, as tracks run along x: turn the model by -90 degrees about z, for "
        'example below a new root link by a fixed joint with rpy="0 0 -1.5708"'
    )


def require_straight(model: Model, links: Sequence[str], body: str = "") -> None:
    """Raise TrackslipError for a wheel that a joint steers: its axis is turned about z against the
    lateral axis of the body that carries its running gear, by default the chassis.
    """
    base = model.data.body(model.chassis).xmat.reshape(3, 3)
    left = base.T @ model.left_of(body)
    for name in links:
        link = model.model.body(name)
        if link.jntnum[0] != 1 or link.id not in model.turning(_Y):
            continue
        axis = base.T @ model.data.xaxis[link.jntadr[0]]
        axis = axis * np.sign(axis @ left)  # an axis may point to the right
        yaw = float(np.arctan2(axis[_Y], axis[_X]) - np.arctan2(left[_Y], left[_X]))
        if abs(yaw) <= _STEERED:
            continue
        carrier = model.spec.body(name).parent.name
        raise TrackslipError(
            f"{model.robot.model}: wheels = {name!r}: its axis is turned by {yaw:.3g} rad about z, "
            f"must be parallel to the y axis of {body or model.chassis!r}: hold {carrier!r} "
            f'straight, or give [[tracks]] with body = "{carrier}" its `y` and `hull`, to drive '
            "along that body's heading"
        )


def _none_found(model: Model, listed: Sequence[str]) -> str:
    """Why there are no wheels, and what to write."""
    reasons = _why_no_wheels(model, listed)
    found = "; ".join(reasons) if reasons else "found are none"
    allowed = f"round links that collide, on endless hinges about y; {found}"
    if not listed:
        way_on = "list the links of the wheels in `wheels`, or give `hull` and `half_gauge`"
        return f"{model.robot.model}: wheels = replace: must be {allowed}: {way_on}"
    way_on = "give `hull` and `half_gauge`"
    return f"{model.robot.model}: wheels = {', '.join(listed)}: must be {allowed}: {way_on}"


def _why_no_wheels(model: Model, listed: Sequence[str]) -> list[str]:
    """What keeps links that resemble wheels from being wheels, a phrase each: the `listed` links,
    or by default all that turn about y or are round about it.
    """
    spinning = model.spinning(_Y)
    turning = model.turning(_Y)
    bodies = [model.body(name) for name in listed]
    if not listed:
        chassis = model.body(model.chassis)
        bodies = [body for body in range(1, model.model.nbody) if body != chassis]
    endless_hinge = [body for body in bodies if body in spinning]
    limited_hinge = [body for body in bodies if body in turning and body not in spinning]
    other = [body for body in bodies if body not in turning]
    kinds = {
        "turn endlessly, but have no shape": [
            body for body in endless_hinge if not model.has_shape(body)
        ],
        "turn endlessly, but aren't round": [
            body for body in endless_hinge if model.has_shape(body) and not model.is_round(body)
        ],
        "are round, but their hinges have limits": [
            body for body in limited_hinge if model.is_round(body)
        ],
        "are round, but have no hinge about y": [body for body in other if model.is_round(body)],
    }
    return [
        f"{some([model.name(body) for body in found])} {reason}"
        for reason, found in kinds.items()
        if found
    ]


def _unit(model: Model, name: str, moving: set[str]) -> str:
    """The body that carries a wheel and moves on its own, or the chassis."""
    for carrier in carriers(model.spec.body(name)):
        if carrier.name in moving:
            return str(carrier.name)
    return model.chassis


def _gear_of_unit(
    model: Model,
    unit: str,
    wheels: Sequence[Wheel],
    middle: float,
    listed: Sequence[str],
    template: RunningGear,
) -> list[RunningGear]:
    """The running gear of the wheels on one body, in the chassis' frame, if `middle` is the middle
    of all wheels [m].
    """
    widest = max(abs(wheel.y - middle) for wheel in wheels)
    outer = [wheel for wheel in wheels if abs(wheel.y - middle) > _MIDDLE * widest]
    left = [wheel for wheel in outer if wheel.y > middle]
    right = [wheel for wheel in outer if wheel.y < middle]
    is_one_sided = bool(left) != bool(right)
    if is_one_sided:  # the other side is on another body
        return [_single(template, unit, outer, "left" if left else "right")]
    pairs = _pairs(model, left, right, middle, listed)
    return [_pair_gear(template, unit, pairs)]


def _pairs(
    model: Model,
    left: Sequence[Wheel],
    right: Sequence[Wheel],
    middle: float,
    listed: Sequence[str],
) -> list[tuple[Wheel, Wheel]]:
    """Left and right wheels that are alike, from rear to front."""
    wrong = _unlike(left, right, middle)
    if wrong:
        raise TrackslipError(
            f"{model.robot.model}: wheels = {', '.join(listed) or 'replace'}: must be alike on the "
            f"left and right: {wrong}; list those of one pair of tracks in `wheels`, give `hull` "
            "and `half_gauge`, or give each side its own [[tracks]]"
        )
    apart = _apart(left, right, middle)
    rows, columns = scipy.optimize.linear_sum_assignment(apart)
    pairs = [(left[row], right[column]) for row, column in zip(rows, columns, strict=True)]
    return sorted(pairs, key=lambda pair: _mean_wheel(*pair))


def _apart(left: Sequence[Wheel], right: Sequence[Wheel], middle: float) -> Array:
    """Largest difference (L, R) of each left from each right wheel, in place and radius [m]."""

    def shapes(wheels: Sequence[Wheel]) -> NDArray[np.float64]:
        rows = [(wheel.x, wheel.z, wheel.radius, abs(wheel.y - middle)) for wheel in wheels]
        return np.array(rows)

    return np.asarray(np.abs(shapes(left)[:, None] - shapes(right)).max(axis=-1))


def _unlike(left: Sequence[Wheel], right: Sequence[Wheel], middle: float) -> str:
    """How the wheels on the left and right differ, "" if they don't."""
    names = [some([wheel.name for wheel in side]) or "none" for side in (left, right)]
    if not left and not right:
        return "all are near the middle"
    if len(left) != len(right):
        return f"on the left are {names[0]}, on the right {names[1]}"
    apart = _apart(left, right, middle)
    rows, columns = scipy.optimize.linear_sum_assignment(apart)
    for row, column in zip(rows, columns, strict=True):
        one, other = left[row], right[column]
        if apart[row, column] >= _MIRRORED * one.radius:
            return f"{_described(one)}, {_described(other)}"
    return ""


def _described(wheel: Wheel) -> str:
    place = f"x = {wheel.x:.3g}, y = {wheel.y:.3g}, z = {wheel.z:.3g} m"
    return f"{wheel.name} is at {place} with a radius of {wheel.radius:.3g} m"


def _pair_gear(
    template: RunningGear, unit: str, pairs: Sequence[tuple[Wheel, Wheel]]
) -> RunningGear:
    """Running gear on both sides of a body; wheels without a belt keep the gauges of their axles.

    Raises InvalidValueError for a belt around axles of different gauges.
    """
    left = float(np.mean([pair[0].y for pair in pairs]))
    right = float(np.mean([pair[1].y for pair in pairs]))
    half = (left - right) / 2
    is_centred = abs(left + right) / 2 < _CENTRED
    y = round(half, 6) if is_centred else (round(left, 6), round(right, 6))
    halves = [(one.y - other.y) / 2 for one, other in pairs]
    is_even = max(abs(each - half) for each in halves) < _ALIKE * half
    aside = [] if is_even else [round(each - half, 6) for each in halves]
    if aside and template.contact != WHEELS:
        names = [f"{one.name} {each:.4g}" for (one, _), each in zip(pairs, halves, strict=True)]
        line = f"{', '.join(names)} m; the belt lies at their mean, {half:.4g} m"
        warnings.warn(f"axles of different half gauges: {line}", RobotWarning, stacklevel=2)
        aside = []
    hull = [_mean_wheel(one, other) for one, other in pairs]
    names = [wheel.name for pair in pairs for wheel in pair]
    return _changed(template, unit, BOTH, y, hull, names, aside)


def _mean_wheel(one: Wheel, other: Wheel) -> list[float]:
    """Mean x, z and radius of a left and a right wheel [m]."""
    mean = [(one.x + other.x) / 2, (one.z + other.z) / 2, (one.radius + other.radius) / 2]
    return [float(value) for value in np.round(mean, 6)]


def _single(template: RunningGear, unit: str, wheels: Sequence[Wheel], side: str) -> RunningGear:
    """Running gear on one side of a body."""
    y = round(float(np.mean([wheel.y for wheel in wheels])), 6)
    hull = sorted(np.round([wheel.x, wheel.z, wheel.radius], 6).tolist() for wheel in wheels)
    return _changed(template, unit, side, y, hull, [wheel.name for wheel in wheels])


def _changed(
    template: RunningGear,
    unit: str,
    side: str,
    y: float | tuple[float, float],
    hull: Sequence[Sequence[float]],
    names: Sequence[str],
    aside: Sequence[float] = (),
) -> RunningGear:
    """The template with what was read."""
    return RunningGear(
        body=unit,
        sides=side,
        y=y,
        wheels=tuple(names),
        hull=tuple((x, z, radius) for x, z, radius in hull),
        aside=tuple(aside),
        contact=template.contact,
        drive=template.drive,
        patch_length=template.patch_length,
        width=template.width,
        lines=template.lines,
        origin=f"from {', '.join(names)}",
    )


def contradictions(given: RunningGear, read: RunningGear) -> list[str]:
    """Where given values differ from what the model's wheels tell, with both values."""
    found = []
    half = (given.places[0] - given.places[-1]) / 2
    half_read = (read.places[0] - read.places[-1]) / 2
    if abs(half - half_read) > _MIRRORED * max(radius for _, _, radius in read.hull):
        found.append(f"half_gauge = {half:g}, but its wheels have {half_read:g} m ({read.origin})")
    middle = (given.places[0] + given.places[-1]) / 2
    middle_read = (read.places[0] + read.places[-1]) / 2
    if abs(middle - middle_read) > _MIRRORED * max(radius for _, _, radius in read.hull):
        found.append(f"offset = {middle:g}, but its wheels have {middle_read:g} m ({read.origin})")
    low = min(z - radius for _, z, radius in given.hull)
    low_read = min(z - radius for _, z, radius in read.hull)
    if abs(low - low_read) > SAME_HEIGHT:
        found.append(
            f"hull reaches down to {low:.4g}, but its wheels to {low_read:.4g} m ({read.origin})"
        )
    return found
