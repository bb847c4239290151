"""Courses: pieces of terrain in a row along x, as geoms and as exact heights, by name or from a
file.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final, NamedTuple

import mujoco
import numpy as np

import models
from sim.common.seeds import generator
from sim.common.settings import build, read_named, read_toml
from sim.terrain.loose import Beams, Blocks, Pallets
from sim.terrain.pieces import (
    LENGTH,
    Flat,
    Gap,
    Piece,
    Placed,
    Ramp,
    Rough,
    SideSlope,
    Site,
    Stairs,
    Step,
)
from sim.terrain.solids import EDGE, LINES, Base, Level, Solid, look
from trackslip.errors import (
    Checked,
    InvalidValueError,
    SettingsFileError,
    checked,
    one_of,
    require,
    require_at_most,
    require_positive,
    require_whole,
)
from trackslip.kinematics import Array

_MAX_SOLIDS: Final = 2000  # number of solids of a course
_MAX_COURSE: Final = 1000.0  # length of a course [m]
_CLEARANCE: Final = 0.3  # distance from the floor to the lowest point of the course [m]
_CELL: Final = 0.02  # cell size of the table for `look_up` on courses of moderate size [m]
_MAX_CELLS: Final = 2_000_000
_MARGIN: Final = 2  # cells of the table beyond the course
_FLOOR: Final = (0.40, 0.43, 0.40, 1.0)
_FLOOR_SIZE: Final = 50.0  # half size of the floor when drawn; it is infinite [m]
_START_BEFORE: Final = 1.0  # distance from the start to the first piece [m]
_NAME: Final = "course/"  # prefix in the names of a course's geoms
_COURSES: Final = Path(models.__file__).parent / "courses"
_KINDS: Final[dict[str, type[Any]]] = {
    "flat": Flat,
    "ramp": Ramp,
    "step": Step,
    "stairs": Stairs,
    "gap": Gap,
    "side_slope": SideSlope,
    "beams": Beams,
    "blocks": Blocks,
    "pallets": Pallets,
    "rough": Rough,
}


@dataclass(frozen=True)
class Course(Checked):
    """Pieces in a row between a start and a goal platform; the first piece begins at x = 0 and
    height 0.

    The course stands on a level floor, 0.3 m below its lowest point.
    """

    pieces: tuple[Piece, ...]
    """Pieces of the course, in the order in which robots cross them."""
    width: float = checked(3.0, *LENGTH)
    """Width of the course [m]."""
    friction: float = checked(0.7, require_positive, 10.0)
    """Coefficient of friction of all surfaces; along the tracks, if it differs across them [-]."""
    seed: int = checked(0, require_whole, 0)
    """Root seed for random properties, such as rough ground."""
    start_length: float = checked(2.0, *LENGTH)
    """Length of the level platform before the first piece [m]."""
    goal_length: float = checked(2.0, *LENGTH)
    """Length of the level platform behind the last piece [m]."""
    friction_across: float | None = field(default=None, metadata={"stored_unless": None})
    """Coefficient of friction across the tracks, if it differs; only for courses of flat pieces,
    whose ground is then an infinite plane [-].
    """

    @classmethod
    def from_table(cls, table: Mapping[str, Any], where: str) -> Course:
        """A course from a table of its fields, with a table per piece; raises SettingsFileError,
        citing `where`.

        A piece without a `kind` is of the only kind that has exactly the given fields.
        """
        rows = table.get("pieces", [])
        if not isinstance(rows, list | tuple):
            raise SettingsFileError(f"{where}: pieces = {rows!r:.80}: must be a list of tables")
        pieces = tuple(_piece(row, f"{where}: pieces[{k}]") for k, row in enumerate(rows))
        others = {name: value for name, value in table.items() if name != "pieces"}
        course = build(Course, others, where, Course((Flat(),)))
        try:
            return dataclasses.replace(course, pieces=pieces)
        except InvalidValueError as error:
            raise SettingsFileError(f"{where}: {error}") from error

    def __post_init__(self) -> None:
        require(len(self.pieces) > 0, "pieces", self.pieces, "at least one piece")
        for piece in self.pieces:
            require(hasattr(piece, "place"), "pieces", piece, "pieces of terrain")
        super().__post_init__()
        length = self.placed[-1].x + self.start_length
        require_at_most("length of the course", length, _MAX_COURSE, "m")
        if self.friction_across is not None:
            require_positive("friction_across", self.friction_across, 10.0)
            # only on a plane, the frame of a contact turns with the robot
            is_even = len(self.solids) == 1 and isinstance(self.solids[0], Level)
            allowed = "left out, unless all pieces are flat"
            require(is_even, "friction_across", self.friction_across, allowed)

    @property
    def is_plane(self) -> bool:
        """Whether the ground is an infinite plane instead of blocks above a floor."""
        return self.friction_across is not None

    @property
    def frictions(self) -> tuple[float, float]:
        """Coefficients of friction along and across the tracks [-]."""
        across = self.friction if self.friction_across is None else self.friction_across
        return self.friction, across

    @cached_property
    def placed(self) -> tuple[Placed, ...]:
        """Start platform, pieces and goal platform, placed on the course."""
        x = -self.start_length
        z = 0.0
        placed: list[Placed] = []
        kinds: Counter[str] = Counter()
        count = 0
        for piece in (Flat(self.start_length), *self.pieces, Flat(self.goal_length)):
            kind = type(piece).__name__
            # independent of other pieces on the course
            rng = generator(self.seed, f"{kind} {kinds[kind]}")
            kinds[kind] += 1
            placed.append(piece.place(Site(x, z, self.width, rng)))
            x = placed[-1].x
            z = placed[-1].z
            count += len(placed[-1].solids)
            require_at_most("solids of the course", count, _MAX_SOLIDS)
        return tuple(placed)

    @cached_property
    def solids(self) -> tuple[Solid, ...]:
        """Solids of the course; adjacent blocks of equal height are merged, so that there is no
        edge between them.
        """
        solids: list[Solid] = []
        last = 0  # index of the last block with a level top
        for solid in (solid for placed in self.placed for solid in placed.solids):
            if isinstance(solid, Level):
                before = solids[last] if solids else None
                if isinstance(before, Level) and before.continues(solid):
                    solids[last] = replace(before, x1=solid.x1)
                    continue
                last = len(solids)
            solids.append(solid)
        return tuple(solids)

    @cached_property
    def bounds(self) -> Array:
        """Opposite corners (2, 3) of an upright box around the course's surface, without the floor
        [m].
        """
        every = np.stack([solid.bounds for solid in self.solids])  # (S, 2, 3)
        return np.stack([every[:, 0].min(axis=0), every[:, 1].max(axis=0)])

    @property
    def floor(self) -> float:
        """Height of the surrounding floor [m]."""
        if self.is_plane:
            return float(self.bounds[0, 2])
        return float(self.bounds[0, 2]) - _CLEARANCE

    @property
    def start(self) -> tuple[float, float, float, float]:
        """Start pose, up to 1 m before the first piece: x, y, height of the ground [m] and heading
        [rad].
        """
        return -min(_START_BEFORE, self.start_length / 2), 0.0, 0.0, 0.0

    @property
    def goal(self) -> float:
        """Position x beyond which the course is crossed, 1 m behind the last piece [m]."""
        return self.placed[-2].x + min(_START_BEFORE, self.goal_length / 2)

    def height(self, x: Array, y: Array) -> Array:
        """Exact heights (...) of the surface at points x, y, which are broadcast to (...) [m]."""
        x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        points = np.stack([x.ravel(), y.ravel()])
        height = np.full(x.size, self.floor)
        for solid in self.solids:
            low, high = solid.bounds[:, :2, None]
            is_near = (points >= low - EDGE) & (points <= high + EDGE)
            (near,) = np.nonzero(is_near.all(axis=0))
            height[near] = np.maximum(height[near], solid.height(*points[:, near]))
        return height.reshape(x.shape)

    @cached_property
    def model(self) -> mujoco.MjModel:
        """Compiled model of the course alone."""
        spec = mujoco.MjSpec()
        self.add_to(spec, looks=False)
        return spec.compile()

    @cached_property
    def table(self) -> Table:
        """Heights for `look_up` on a grid that extends beyond the course."""
        low, high = self.bounds[:, :2]
        area = float(np.prod(high - low))
        cell = max(_CELL, math.sqrt(area / _MAX_CELLS))
        x = np.arange(low[0] - _MARGIN * cell, high[0] + (_MARGIN + 1) * cell, cell)
        y = np.arange(low[1] - _MARGIN * cell, high[1] + (_MARGIN + 1) * cell, cell)
        heights = np.full((len(x), len(y)), self.floor)
        for solid in self.solids:
            # the part of the grid around the solid, a view of the heights
            x_ends, y_ends = (solid.bounds[:, :2] + [[-EDGE], [EDGE]]).T
            rows = slice(*np.searchsorted(x, x_ends))
            columns = slice(*np.searchsorted(y, y_ends))
            part = heights[rows, columns]
            x_part, y_part = np.broadcast_arrays(x[rows, None], y[columns])
            height = solid.height(x_part.ravel(), y_part.ravel())
            np.maximum(part, height.reshape(part.shape), out=part)
        return Table(np.array([x[0], y[0]]), 1 / cell, heights)

    def add_to(self, spec: mujoco.MjSpec, *, looks: bool = True) -> list[str]:
        """Add the course and its infinite floor to the world body in `spec`; return the names of
        their geoms.

        To add a second course, or to move one, attach a spec of its own: `spec.attach(other,
        prefix=..., frame=...)`. With `looks`, the supports of slopes are drawn as meshes, which
        don't collide.
        """
        is_taken = any(geom.name.startswith(_NAME) for geom in spec.geoms)
        require(not is_taken, "spec", spec.modelname, "one without a course")
        base = Base(self.floor, self.friction, looks)
        add_lines(spec)
        names = []
        solids = () if self.is_plane else self.solids
        for k, solid in enumerate(solids):
            names.append(f"{_NAME}{k}")
            solid.add_to(spec, names[-1], base)
        names.append(f"{_NAME}floor")
        spec.worldbody.add_geom(
            name=names[-1],
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            size=[_FLOOR_SIZE, _FLOOR_SIZE, 1.0],
            pos=[0.0, 0.0, self.floor],
            **look(_FLOOR, base),
        )
        return names


class Table(NamedTuple):
    """Heights of a course on a grid."""

    origin: Array  # position x, y of the first height [m]
    per_metre: float  # cells per metre [1/m]
    heights: Array  # heights (rows, columns) [m]: rows along x, columns along y


def look_up(courses: Sequence[Course], points: Array) -> Array:
    """Heights (N, P) of N courses, each at its own `points` (N, P, 2), bilinear within cells of 2
    cm [m].

    For courses larger than 800 m², the cells are larger. `Course.height` is exact.
    """
    tables = [course.table for course in courses]
    shape = np.array([table.heights.shape for table in tables])[:, None]  # (N, 1, 2)
    origin = np.array([table.origin for table in tables])[:, None]
    per_metre = np.array([table.per_metre for table in tables])[:, None, None]
    at = np.clip((points - origin) * per_metre, 0.0, shape - 1.001)  # [cells]
    cell = at.astype(int)
    u, v = np.moveaxis(at - cell, -1, 0)

    # indices (N, P, 4) of the cells' corners in the tables, which are stored row by row
    columns = shape[..., 1:]
    first = cell[..., :1] * columns + cell[..., 1:]
    corners = first + columns * [0, 0, 1, 1] + [0, 1, 0, 1]
    near = [table.heights.take(own) for table, own in zip(tables, corners, strict=True)]
    back_right, back_left, front_right, front_left = np.moveaxis(np.array(near), -1, 0)

    back = (1 - v) * back_right + v * back_left
    front = (1 - v) * front_right + v * front_left
    return np.asarray((1 - u) * back + u * front)


def add_lines(spec: mujoco.MjSpec) -> None:
    """Add the material LINES, which draws a line every metre."""
    spec.add_texture(
        name=LINES,
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        rgb1=[1.0, 1.0, 1.0],
        mark=mujoco.mjtMark.mjMARK_EDGE,
        markrgb=[0.6, 0.6, 0.6],
        width=256,
        height=256,
    )
    # MuJoCo counts repetitions over two metres
    material = spec.add_material(name=LINES, texuniform=True, texrepeat=[2.0, 2.0])
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = LINES


def course_names() -> list[str]:
    """Names of courses that `load_course` knows."""
    return sorted(path.stem for path in _COURSES.glob("*.toml"))


def load_course(source: str, seed: int | None = None, drawn: Sequence[str] = ()) -> Course:
    """Load a named course, or a TOML file with fields of `Course` and tables `[[pieces]]`, each
    with a `kind`.

    `seed` replaces the file's seed; `drawn` are further names that the caller accepts, for the
    error message. Raises InvalidValueError for any other source, SettingsFileError for an
    unreadable file and invalid fields.
    """
    if source in course_names():
        table = read_toml(_COURSES / f"{source}.toml")
    else:
        table = read_named("course", source, (*course_names(), *drawn))
    course = Course.from_table(table, source)
    return course if seed is None else dataclasses.replace(course, seed=seed)


def _piece(row: object, where: str) -> Piece:
    """A piece from a table of its fields and its `kind`; raises SettingsFileError, citing
    `where`.
    """
    if not isinstance(row, dict):
        raise SettingsFileError(f"{where}: {row!r:.80} is not a table")
    given = {name: value for name, value in row.items() if name != "kind"}
    kind = row.get("kind", _kind_with(set(given)))
    if not isinstance(kind, str) or kind not in _KINDS:
        raise SettingsFileError(f"{where}: kind = {kind!r:.80}: must be {one_of(_KINDS, kind)}")
    return build(_KINDS[kind], given, where)


def _kind_with(names: set[str]) -> str | None:
    """The first kind of pieces that has exactly these fields."""
    for kind, piece in _KINDS.items():
        if {field.name for field in dataclasses.fields(piece)} == names:
            return kind
    return None
