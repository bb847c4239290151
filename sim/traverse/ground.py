"""A compiled model with a different course for each robot and episode, and the ground that a robot
covers.

The model has slots: boxes, height fields and a floor without fixed positions. A course uses as many
slots as it needs; unused slots lie far below. Slot positions are expanded fields of the batch,
which the engine uses as if they had been compiled. MuJoCo's tree of bounding boxes can't be
expanded, so the model doesn't use it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.robot.tracked import TrackedRobot
from sim.robot.tracked_model import FlipperGeometry, build_tracked
from sim.terrain.course import Course, add_lines
from sim.terrain.solids import LINES
from trackslip.errors import require

# fields of a model that place a geom
_FIELDS: Final = (
    "geom_pos",
    "geom_quat",
    "geom_size",
    "geom_rbound",
    "geom_aabb",
    "geom_sameframe",
    "geom_dataid",
    "geom_friction",
)
_BOX: Final = mujoco.mjtGeom.mjGEOM_BOX
_FIELD: Final = mujoco.mjtGeom.mjGEOM_HFIELD
_PLANE: Final = mujoco.mjtGeom.mjGEOM_PLANE
_AWAY: Final = -1000.0  # height of unused slots [m]
_TINY: Final = 0.01  # half size of unused slots [m]
# distance of a robot from the first piece; heights are looked up in cells of 2 cm [m]
_BEFORE: Final = 0.05
_BESIDE: Final = 1.5  # least ratio of a course's width to the robot's [-]


class Slots:
    """Slots for courses, added to a model as its terrain: boxes, height fields and a floor."""

    def __init__(self, courses: Sequence[Course], boxes: int = 0) -> None:
        """Provide slots for each of `courses`, and for any course of at most `boxes` boxes without
        height fields.
        """
        self._listed = list(courses)
        self._boxes = max([boxes, *(_count(course.model, _BOX) for course in courses)])
        self._fields = max((_count(course.model, _FIELD) for course in courses), default=0)
        self._first_field = np.cumsum([0, *(course.model.nhfield for course in courses)])
        self._names = [f"slot{k}" for k in range(self._boxes + self._fields + 1)]
        self._ids: NDArray[np.int_] = np.zeros(0, int)
        self._batch: dict[str, Any] = {}

    @property
    def friction(self) -> float:
        """Coefficient of friction of the first course [-]."""
        return self._listed[0].friction

    @property
    def frictions(self) -> tuple[float, float]:
        """Coefficients of friction of the first course along and across the tracks [-]."""
        return self._listed[0].frictions

    def add_to(self, spec: mujoco.MjSpec) -> list[str]:
        """Add the slots to the world body in `spec`; return the names of their geoms."""
        for course, first in zip(self._listed, self._first_field, strict=False):
            _add_fields(spec, course.model, first)
        add_lines(spec)
        kinds: list[dict[str, Any]] = []
        kinds += [{"type": _BOX, "size": [_TINY] * 3}] * self._boxes
        kinds += [{"type": _FIELD, "hfieldname": "field0"}] * self._fields
        kinds += [{"type": _PLANE, "size": [1.0, 1.0, 1.0]}]
        for name, kind in zip(self._names, kinds, strict=True):
            spec.worldbody.add_geom(
                name=name,
                pos=[0.0, 0.0, _AWAY],
                condim=3,
                contype=1,
                conaffinity=1,
                material=LINES,
                **kind,
            )
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_MIDPHASE
        return list(self._names)

    def pairs(self, model: mujoco.MjModel) -> NDArray[np.int_]:
        """Indices of a model's contact pairs with slots."""
        ids = [model.geom(name).id for name in self._names]
        return np.flatnonzero(np.isin(model.pair_geom1, ids) | np.isin(model.pair_geom2, ids))

    def bind_batch(self, batch: Any) -> None:
        """Let the slots move the geoms in `batch`, a batch of the model."""
        self._ids = np.array([batch.model.geom(name).id for name in self._names])
        # (N, ngeom, ...) each, views of the batch
        self._batch = {name: batch.expand(name) for name in _FIELDS}
        self._empty = {name: getattr(batch.model, name)[self._ids].copy() for name in _FIELDS}

    def lay(self, row: int, course: Course) -> None:
        """Move slots so that they form a course for the robot `row` in the batch.

        Raises InvalidValueError for a course with more boxes than slots, and for other height
        fields than the slots'.
        """
        listed = next((k for k, each in enumerate(self._listed) if each is course), None)
        model = course.model
        boxes = _count(model, _BOX)
        fields = _count(model, _FIELD)
        require(boxes <= self._boxes, "course", f"{boxes} boxes", f"of at most {self._boxes}")
        is_known = listed is not None or not fields
        require(is_known, "course", f"{fields} height fields", "without, unless it is listed")
        slots = self._slots_of(model)
        for name in _FIELDS:
            values = self._empty[name].copy()
            values[slots] = getattr(model, name)
            if name == "geom_dataid" and listed is not None:
                # the model has the height fields of all listed courses
                values[slots] += np.where(model.geom_type == _FIELD, self._first_field[listed], 0)
            self._batch[name][row, self._ids] = values

    def show(self, row: int, course: Course, model: mujoco.MjModel) -> None:
        """Show the `course` of the robot `row` in another model with these slots, in the course's
        own colours.
        """
        ids = np.array([model.geom(name).id for name in self._names])
        for name in _FIELDS:
            getattr(model, name)[ids] = self._batch[name][row, self._ids]
        model.geom_rgba[ids[self._slots_of(course.model)]] = course.model.geom_rgba

    def _slots_of(self, course: mujoco.MjModel) -> NDArray[np.int_]:
        """Indices of the slots for the geoms of a course."""
        first = {_BOX: 0, _FIELD: self._boxes, _PLANE: self._boxes + self._fields}
        slots = np.full(course.ngeom, -1)
        for kind, begin in first.items():
            own = np.flatnonzero(course.geom_type == kind)
            slots[own] = begin + np.arange(len(own))
        return slots


def _count(model: mujoco.MjModel, kind: int) -> int:
    return int((model.geom_type == kind).sum())


def _add_fields(spec: mujoco.MjSpec, course: mujoco.MjModel, first: int) -> None:
    """Add the height fields of a course to `spec`; their numbers begin with `first`."""
    for k in range(course.nhfield):
        begin = course.hfield_adr[k]
        rows = course.hfield_nrow[k]
        columns = course.hfield_ncol[k]
        spec.add_hfield(
            name=f"field{first + k}",
            nrow=rows,
            ncol=columns,
            size=list(course.hfield_size[k]),
            userdata=course.hfield_data[begin : begin + rows * columns],
        )


@dataclass(frozen=True)
class Footprint:
    """Rectangle around a robot's tracks with level flippers, in the robot's frame."""

    ahead: float  # distance to the front end [m]
    behind: float  # distance to the rear end [m]
    aside: float  # half of the width [m]

    @classmethod
    def of(cls, robot: TrackedRobot, flippers: FlipperGeometry | None = None) -> Footprint:
        """The footprint of a robot; the robot is compiled to obtain its `flippers` unless these are
        given.
        """
        if not robot.hull:
            robot = build_tracked(robot).robot
        x, _, radius = np.array(robot.hull).T
        ahead = [(x + radius).max()]
        behind = [(radius - x).max()]
        aside = [robot.half_gauge + abs(robot.offset) + robot.width / 2]
        for gear in robot.tracks:
            if gear.body in ("", robot.body):
                aside += [abs(y) + gear.width / 2 for y in gear.places]
        if robot.gear_bodies:
            flippers = flippers or build_tracked(robot).flippers
            hinge = flippers.hinge[:, 0]
            reach = flippers.length + flippers.radius
            ahead += list(hinge + np.where(flippers.front, reach, 0.0))
            behind += list(np.where(flippers.front, 0.0, reach) - hinge)
            aside += list(flippers.aside)
        return cls(float(max(ahead)), float(max(behind)), float(max(aside)))

    @property
    def turning(self) -> float:
        """Length of a platform that is large enough for the robot at any heading [m]."""
        front = math.hypot(self.ahead, self.aside)
        rear = math.hypot(self.behind, self.aside)
        return front + rear + _BEFORE

    def start(self, course: Course, heading: float = 0.0) -> float:
        """Start position x of a robot on a course: `Course.start`, or further back if the robot is
        long [m].

        Raises InvalidValueError for a course whose start platform is too small for the robot.
        """
        looks_ahead = math.cos(heading) >= 0
        towards = self.ahead if looks_ahead else self.behind
        away = self.behind if looks_ahead else self.ahead
        cos = abs(math.cos(heading))
        corner = self.aside * abs(math.sin(heading))
        front = towards * cos + corner + _BEFORE
        rear = away * cos + corner
        for name, least in (("start_length", front + rear), ("width", 2 * self.aside)):
            allowed = f"at least {least:.3g} m for this robot to stand before the first piece"
            require(getattr(course, name) >= least, name, getattr(course, name), allowed)
        return max(min(course.start[0], -front), rear - course.start_length)

    def goal(self, course: Course) -> float:
        """Position x at which a robot has crossed a course: `Course.goal`, or further on if the
        robot is long [m].
        """
        return max(course.goal, course.placed[-2].x + self.behind)

    def fit(self, course: Course) -> Course:
        """The course, or a wider copy with longer ends if the robot needs it."""
        start = max(course.start_length, self.turning)
        goal = max(course.goal_length, self.ahead + self.behind)
        width = max(course.width, 2 * _BESIDE * self.aside)
        if (start, goal, width) == (course.start_length, course.goal_length, course.width):
            return course
        return replace(course, start_length=start, goal_length=goal, width=width)
