"""Ruts in soft soil under a fleet's tracks: how deep its pads stand, and what their ruts resist.

Soft soil is a rigid-plastic layer in series with the engine's contacts, which are springs of a
constant stiffness. A pad at the depth z below the undisturbed ground presses the soil down to the
depth T at which spring and soil bear the same pressure,

    (z - T) / give = p(T)                                                                        (1)

with Bekker's pressure p of `trackslip.skid_theory.soil`, and soil that was pressed stays where it
is. In every servo period, for each of the cells under a pad, whose ruts have the depth s,

    s <- max(s, T(z)),                                                                           (2)

and the pad's contact begins at the depth at which the springs over these cells together bear the
same load: the mean of max(z - s, 0) below the pad. Only where contacts begin changes, never their
stiffness.

To press a rut from the depth s to the depth t takes the work w(t) - w(s) per area. Contacts push
along the normal only, so that the engine can't know this work. It is taken by a force on each
track against its motion (Bekker's resistance),

    b (w(deepest cell under the track) - w(cell ahead of the track's end))                       (3)

as the mean over lines along the track. It grows over the first 2 mm of travel, as friction in
Dahl's model does, so that nothing pushes a robot at rest. Ahead means in the direction in which the
track's end moves, which is to the side if a robot turns on the spot, in a rut that it has already
pressed.

A track that tilts lifts its front. Its elements are sheared from where they touch the soil, which
`advance` finds. Soil acts along a track, so that its thrust passes through the middle of the track;
`FleetGround.traction_moment` undoes the moment of the engine's, which acts at the pads' heights.

Each robot's cells are in a window that moves with it, in steps of whole cells. Ruts that leave the
window are forgotten.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackslip.kinematics import Array
from trackslip.restorable import Restorable
from trackslip.skid_theory import Soil

LEAST_LINES: Final = 4
"""Least number of lines along a track, with a cell's width between them."""
CELL: Final = 0.7
"""Largest width of a cell over the distance between pads: no two pads of a track are in one cell,
in whatever direction the track points.
"""
WINDOW: Final = 256
"""Number of cells along the side of the window in which ruts are remembered."""
GROWTH: Final = 0.002
"""Travel over which the resistance grows: the settlement of the engine's contacts [m]."""
_STRAY: Final = 32  # distance of a robot from the middle of its window that moves it [cells]
AHEAD: Final = 1.5  # distance ahead of a track's end at which soil is undisturbed by it [cells]
_ROUNDS: Final = 3  # of Newton's method for (1), to a millionth
MOST_FRICTION: Final = 10.0  # that pads with hardly any load have, because of cohesion [-]
_LEAST_RISE: Final = 1e-9  # of a track that rises from the soil, over its length [-]
_TINY: Final = 1e-300
_MOVES: Final = 1e-9  # shortest motion with a direction [m]
_Ints = NDArray[np.int_]


@dataclass(frozen=True)
class _Pressed:
    """Cells that were pressed, and their depths before."""

    cells: _Ints  # (K,) indices of the cells
    depth: NDArray[np.float32]  # (K,) [m]


@dataclass(frozen=True)
class _Moved:
    """A window that was moved, as it was before."""

    robot: int
    corner: _Ints  # (2,)
    depth: NDArray[np.float32]  # (WINDOW, WINDOW) [m]


class Soils(NamedTuple):
    """The numbers of R robots' soils, each (R, 1)."""

    modulus: Array
    exponent: Array
    growth: Array
    cohesion: Array
    friction: Array  # tangent of the angle of friction
    by_depth: Array  # lateral force per length and depth, of cohesion
    by_square: Array  # lateral force per length and squared depth, of weight
    shear: Array  # shear modulus

    @classmethod
    def of(cls, soil: Soil, width: float) -> Soils:
        """One soil under tracks of this width [m]."""
        by_depth, by_square = soil.bulldozing_terms
        friction = math.tan(soil.friction_angle)
        sinkage = (soil.modulus(width), soil.n, soil.n1)
        strength = (soil.cohesion, friction, by_depth, by_square, soil.shear)
        return cls(*(np.asarray(number) for number in (*sinkage, *strength)))


class Ruts(Restorable):
    """Ruts of N robots on two tracks each, whose P pads touch the ground at one point each."""

    STATE: ClassVar[tuple[str, ...]] = (
        "_depth",
        "_corner",
        "_slip",
        "_travel",
        "margin",
        "floor",
        "compression",
        "height",
        "traction",
        "surface",
        "resistance",
        "deepest",
    )

    def __init__(
        self, place: Array, length: float, width: float, size: int, period: float, radius: float
    ) -> None:
        """Start without ruts, on firm ground.

        Args:
            place: points (P, 2) on the robot, left side first, from rear to front on each side [m].
            length: length of a track's contact [m].
            width: width of a track [m].
            size: number of robots.
            period: period of the servos [s].
            radius: radius of the pads' lower ends [m].
        """
        self.lever = 0.0
        """Height above the ground at which the resistance acts [m]."""
        self._length = length
        self._width = width
        self._period = period
        self._radius = radius
        pads = len(place)
        self._pads = pads
        lines = self._line_count()
        self._cell = width / lines
        self._side = place[:, 1].reshape(2, -1)[:, 0]  # lateral places (2,) of the tracks [m]
        # the pads, and the rear and front ends of both tracks, which lie beyond the last pads
        ends = np.array([-1.0, 1.0]) * (length / 2)
        self._x = np.concatenate([place[:, 0], ends, ends])
        self._y = np.concatenate([place[:, 1], self._side.repeat(2)])
        self._track = (self._y < self._side.mean()).astype(int)  # 0 left, 1 right
        self._lines = self._cell * (np.arange(lines) - (lines - 1) / 2)  # (L,) [m]
        # places of the cells under the pads (L, P), and across the tracks' ends [m]
        self._under_x = np.tile(place[:, 0], (lines, 1))
        self._under_y = np.add.outer(self._lines, place[:, 1])
        self._side_lines = np.add.outer(self._lines, self._side)  # (L, 2) [m]

        # the robots' soils
        self.is_soft = np.zeros(size, bool)
        """Whether each robot (N,) is on soft soil."""
        self._soil = np.ones((len(Soils._fields), size, 1))
        self._give = np.ones(size)  # of the springs [m/Pa]

        # one cell more, for all places outside of the windows
        self._depth = np.zeros(size * WINDOW**2 + 1, np.float32)
        self._corner = np.full((size, 2), -WINDOW // 2)  # first cell of each window
        self._slip = np.zeros((size, 2))
        self._travel = np.zeros((size, 2))  # from -GROWTH to GROWTH [m]
        self._written: list[_Pressed | _Moved] = []

        self.margin = np.zeros((size, pads))
        """Depths (N, P) at which the pads' contacts begin [m]."""
        self.floor = np.zeros(size)
        """Means (N,) of these depths [m]."""
        self.compression = np.zeros((size, pads))
        """Compressions (N, P) of the springs, proportional to the pads' loads, 0 in the air [m]."""
        self.height = np.zeros((size, pads))
        """Heights (N, P) of the contact points above the robots' origins [m]."""
        self.traction = np.zeros((size, 2))
        """Forces (N, 2) of the ground on the tracks in the last period, forwards, which the fleet
        sets [N].
        """
        self.surface = np.ones((size, pads, 3))
        """Friction along and across the tracks [-], and shear moduli [m], (N, P, 3) under the
        pads.
        """
        self.resistance = np.zeros((size, 2))
        """Forces (N, 2) of compaction on the tracks, positive forwards [N]."""
        self.deepest = np.zeros((size, 2))
        """Depths (N, 2) of the ruts under the tracks, means over their lines [m]."""

    def _line_count(self) -> int:
        """Number of lines along a track, so that no two pads are in one cell."""
        spacing = 2 * self._length / self._pads
        return max(LEAST_LINES, math.ceil(self._width / (CELL * spacing)))

    @property
    def slip(self) -> Array:
        """Slips (N, 2) of the tracks, means over about the last length of contact [-]."""
        return self._slip.copy()

    @property
    def by_robot(self) -> tuple[Array, ...]:
        """Views of the arrays that a period changes, with the robots on the first axis; `undo`
        restores the ruts themselves, and `press` what follows from them.
        """
        return self._slip, self._travel, self.resistance, self.traction

    def put(self, rows: _Ints, soils: Sequence[Soil | None], give: Array) -> None:
        """Put the robots `rows` (R,) on soils, or with None on firm ground; their springs `give`
        (R,) [m/Pa].
        """
        self._give[rows] = give
        for row, soil in zip(rows.tolist(), soils, strict=True):
            self.is_soft[row] = soil is not None
            if soil is not None:
                self._soil[:, row, 0] = Soils.of(soil, self._width)
                self.surface[row, :, 2] = soil.shear
            else:
                self.margin[row] = 0.0
                self.floor[row] = 0.0
                self.compression[row] = 0.0
                self.resistance[row] = 0.0
                self.deepest[row] = 0.0

    def forget(self, rows: _Ints, position: Array) -> None:
        """Begin without ruts around the robots `rows` (R,), which stand at positions (R, 2) [m]."""
        windows = self._windows()
        windows[rows] = 0.0
        self._corner[rows] = self._cell_of(position) - WINDOW // 2
        self._slip[rows] = 0.0
        self._travel[rows] = 0.0
        self.resistance[rows] = 0.0
        self.traction[rows] = 0.0

    def sinkage(self, soil: Soil, pressure: float) -> float:
        """Sinkage of a robot at rest under a pressure on the area of its contacts [Pa], in m."""
        return float(soil.sinkage(pressure, self._width))

    def mark(self) -> None:
        """Forget how to undo what was pressed so far."""
        self._written.clear()

    def undo(self, rows: _Ints) -> None:
        """Undo what the robots `rows` (R,) pressed since the last `mark`."""
        windows = self._windows()
        kept: list[_Pressed | _Moved] = []
        for change in reversed(self._written):
            if isinstance(change, _Moved):
                if change.robot in rows:
                    windows[change.robot] = change.depth
                    self._corner[change.robot] = change.corner
                else:
                    kept.append(change)
                continue
            is_undone = np.isin(change.cells // WINDOW**2, rows)
            self._depth[change.cells[is_undone]] = change.depth[is_undone]
            if not is_undone.all():
                others = ~is_undone
                kept.append(_Pressed(change.cells[others], change.depth[others]))
        self._written = kept[::-1]

    def press(self, rows: _Ints, pose: Array) -> Array:
        """Press the soil under the robots `rows` (R,), by (1) and (2), find where contacts begin
        and their friction, and return the depths (R, L, 2) of the tracks' lines [m].

        `pose` (R, 7) has the chassis' position, the vertical components of its three axes, and its
        heading [m, -, rad]. A second press in the same place changes nothing.
        """
        cells = self._cells(rows, pose, self._under_x[None], self._under_y[None])
        soil = self._of(rows)
        exponent = self._exponents(rows, soil)
        return self._press(rows, pose, self._depths(pose), cells, soil, exponent)

    def _press(
        self,
        rows: _Ints,
        pose: Array,
        at_all: Array,
        under: _Ints,
        soil: Soils,
        exponent: Array,
    ) -> Array:
        """Do as `press` does, with the depths (R, P + 4) of pads and ends [m], the indices (R, L,
        P) of the cells under the pads, and the exponents (R, 2) of sinkage.
        """
        pressed_at_all = self._soil_depth(rows, at_all, soil, exponent)
        depth = at_all[:, : self._pads]
        pressed = pressed_at_all[:, : self._pads]

        self._deepen(under, pressed[:, None])
        rut = self._depth[under].astype(float)

        # the contact of springs that bear on all cells that they reach
        compression = _mean(np.maximum(depth[:, None] - rut, 0.0), axis=1)  # (R, P) [m]
        reaches = compression > 0
        margin = np.where(reaches, depth - compression, np.minimum.reduce(rut, axis=1))
        floor = _mean(margin, axis=1)
        self.compression[rows] = compression
        self.margin[rows] = margin
        self.floor[rows] = floor

        # the engine puts contact points midway between the pads and the ground
        self.height[rows] = -pose[:, 2:3] - (depth + floor[:, None]) / 2

        # the strength of the soil over the pressure
        per_pressure = self._give[rows, None] / np.where(reaches, compression, np.inf)
        along = soil.friction + soil.cohesion * per_pressure
        bulldozed = (soil.by_square * margin + soil.by_depth) * margin  # force per length
        across = along + bulldozed * (per_pressure / self._width)
        surface = np.empty((*along.shape, 3))
        surface[..., 0] = np.minimum(along, MOST_FRICTION)
        surface[..., 1] = np.minimum(across, MOST_FRICTION)
        surface[..., 2] = soil.shear
        self.surface[rows] = surface

        # the depth of each line, also at the ends of the tracks, which write no cells, so that soil
        # ahead of them stays untouched
        by_end = pressed_at_all[:, self._pads :].reshape(-1, 2, 2)
        deepest_end = np.maximum.reduce(by_end, axis=-1)
        by_pad = rut.reshape(len(rows), len(self._lines), 2, -1)
        by_track = np.maximum.reduce(by_pad, axis=3)  # (R, L, 2)
        deepest = np.maximum(by_track, deepest_end[:, None])
        self.deepest[rows] = _mean(deepest, axis=1)
        return deepest

    def _deepen(self, cells: _Ints, depth: Array) -> None:
        """Press cells (R, ...) down to depths that broadcast to their shape [m], unless they are
        deeper.
        """
        before = self._depth[cells]
        after = np.maximum(before, depth.astype(np.float32))
        is_deeper = after > before
        if is_deeper.any():
            deeper = cells[is_deeper]
            self._written.append(_Pressed(deeper, before[is_deeper]))
            np.maximum.at(self._depth, deeper, after[is_deeper])
            self._depth[-1] = 0.0

    def advance(
        self, rows: _Ints, before: Array, after: Array, pose: Array, belt: Array
    ) -> Array | None:
        """Update ruts and resistances after a period in which the robots `rows` (R,) moved, and
        return the lengths (R, 2) of the tracks that are in the air where their belts enter, None if
        no track is [m].

        Args:
            rows: indices of the robots.
            before, after: places of the robots (4, R): position x, y [m], cosine and sine of the
                heading.
            pose: as in `press`, after the period.
            belt: belt speeds (R, 2), positive forwards [m/s].
        """
        self._follow(rows, after[:2].T)
        motion, aside, turn = self._motion(before, after)
        self._slide(rows, motion, belt * self._period)
        soil = self._of(rows)
        exponent = self._exponents(rows, soil)

        # where the ends of the tracks will meet soil, in the direction in which they move
        travel = self._travel[rows]
        front = np.where(travel >= 0, 1.0, -1.0)  # (R, 2)
        end = front * (self._length / 2)
        sideways = aside + turn * end
        distance = np.sqrt(motion * motion + sideways * sideways)
        moves = distance > _MOVES
        reach = AHEAD * self._cell / np.where(moves, distance, 1.0)
        meets_x = end + reach * np.where(moves, motion, front)
        meets_y = (reach * np.where(moves, sideways, 0.0))[:, None] + self._side_lines

        # the cells under the pads, and those that the ends meet
        pads = self._pads
        x = np.empty((len(rows), len(self._lines), pads + 2))
        y = np.empty_like(x)
        x[..., :pads] = self._under_x
        y[..., :pads] = self._under_y
        x[..., pads:] = meets_x[:, None]
        y[..., pads:] = meets_y
        cells = self._cells(rows, pose, x, y)
        depth = self._depths(pose)
        deepest = self._press(rows, pose, depth, cells[..., :pads], soil, exponent)
        untouched = self._depth[cells[..., pads:]].astype(float)

        # the resistance, by (3)
        power = exponent + 1
        by_line = power[:, None]
        pressed = _mean(np.maximum(deepest**by_line - untouched**by_line, 0.0), axis=1)
        work = soil.modulus / power * pressed
        self.resistance[rows] = -self._width * work * (travel / GROWTH)

        ends = depth[:, pads:].reshape(-1, 2, 2)  # (R, 2, rear and front)
        depth_ahead = np.where(travel >= 0, ends[..., 1], ends[..., 0])
        lifted = self._lifted(rows, pose, front, _mean(untouched, axis=1) - depth_ahead)
        return None if lifted is None else np.where(front * belt > 0, lifted, 0.0)

    def _lifted(self, rows: _Ints, pose: Array, front: Array, gap: Array) -> Array | None:
        """Lengths (R, 2) in the air at the tracks' ends in the direction `front` (R, 2), 1 or -1,
        which are above the soil ahead of them by a `gap` (R, 2); None if no end is in the air [m].

        The contact begins where a straight track is as deep as the soil ahead, between the first
        pad that touches and the pad, or the track's end, ahead of it.
        """
        if np.maximum.reduce(gap, axis=None) <= 0:
            return None
        rise = front * pose[:, 3:4]
        distance = np.maximum(gap, 0.0) / np.maximum(rise, _LEAST_RISE)

        # from the rear to the end at the front
        is_free = (self.compression[rows] == 0).reshape(len(rows), 2, -1)
        is_free = np.where(front[..., None] > 0, is_free[..., ::-1], is_free)
        pads = np.logical_and.accumulate(is_free, axis=-1).sum(axis=-1)
        spacing = self._length / is_free.shape[-1]
        return np.clip(distance, np.maximum(pads - 0.5, 0.0) * spacing, (pads + 0.5) * spacing)

    def _motion(self, before: Array, after: Array) -> tuple[Array, Array, Array]:
        """Motion in the robots' frames between places (4, R), see `advance`: forwards of both sides
        (R, 2), to the left (R, 1) [m], and turn (R, 1) [rad].
        """
        x_change, y_change = (after - before)[:2]
        # in `before`, they are the horizontal components of an axis that a pitch shortens
        cos, sin = before[2:] / np.hypot(before[2], before[3])
        ahead = cos * x_change + sin * y_change
        aside = cos * y_change - sin * x_change
        turn = (cos * after[3] - sin * after[2])[:, None]
        return ahead[:, None] - turn * self._side, aside[:, None], turn

    def _slide(self, rows: _Ints, motion: Array, run: Array) -> None:
        """Update slips and travels after tracks moved by `motion` and their belts ran by `run` (R,
        2) [m].

        The slip is a mean over the length of contact that the belt runs through.
        """
        slip = 1 - motion / np.where(run != 0, run, 1.0)
        weight = -np.expm1(-np.abs(run) / self._length)  # 0 for belts at rest
        before = self._slip[rows]
        mean = before + weight * (slip - before)
        self._slip[rows] = _within(mean, 1.0)
        self._travel[rows] = _within(self._travel[rows] + motion, GROWTH)

    def _of(self, rows: _Ints) -> Soils:
        return Soils(*self._soil[:, rows])

    def _windows(self) -> NDArray[np.float32]:
        """The cells (N, WINDOW, WINDOW), a view."""
        return self._depth[:-1].reshape(-1, WINDOW, WINDOW)

    def _cell_of(self, place: Array) -> _Ints:
        """Cells in the world at places with coordinates of any shape [m]."""
        return np.floor(place / self._cell).astype(int)

    def _cells(self, rows: _Ints, pose: Array, x: Array, y: Array) -> _Ints:
        """Indices (R, ...) of the cells at places `x` and `y` (R or 1, ...) on the robots [m]."""
        shape = len(rows), *x.shape[1:]
        x = x.reshape(len(x), -1)
        y = y.reshape(len(y), -1)
        heading = pose[:, 6]
        forwards = np.array([np.cos(heading), np.sin(heading)])[..., None]  # (2, R, 1)
        leftwards = np.array([-forwards[1], forwards[0]])
        place = pose[:, :2].T[..., None] + forwards * x + leftwards * y  # (2, R, K) [m]
        i, j = self._cell_of(place) - self._corner[rows].T[..., None]
        is_inside = (np.minimum(i, j) >= 0) & (np.maximum(i, j) < WINDOW)
        index = (rows[:, None] * WINDOW + i) * WINDOW + j
        return np.where(is_inside, index, len(self._depth) - 1).reshape(shape)

    def _depths(self, pose: Array) -> Array:
        """Depths (R, P + 4) of the lower ends of the pads, and of the ends of the tracks [m]."""
        _, _, z, by_x, by_y, by_z, _ = pose.T[..., None]
        return -(z + by_x * self._x + by_y * self._y + (by_z - 1) * self._radius)

    def _exponents(self, rows: _Ints, soil: Soils) -> Array:
        """Exponents (R, 2) of sinkage under the tracks [-]."""
        return soil.exponent + soil.growth * np.abs(self._slip[rows])

    def _soil_depth(self, rows: _Ints, depth: Array, soil: Soils, by_track: Array) -> Array:
        """Depths T (R, P + 4) of the soil under these places at depths (R, P + 4) [m], by (1),
        with exponents (R, 2) of sinkage; next to nothing under those in the air.

        The depth T solves T + give k T^m = z. With u = log T, the logarithm of the left side has a
        slope between 1 and m everywhere, so that Newton's method converges from the smaller of both
        limits.
        """
        exponent = by_track[:, self._track]
        of_spring = self._give[rows, None] * soil.modulus
        log_depth = np.log(np.maximum(depth, _TINY))
        u = np.minimum(log_depth, (log_depth - np.log(of_spring)) / exponent)
        for _ in range(_ROUNDS):
            soft = np.exp(u)
            firm = of_spring * np.exp(exponent * u)
            total = soft + firm
            u -= (np.log(total) - log_depth) * total / (soft + exponent * firm)
        return np.asarray(np.exp(u))

    def _follow(self, rows: _Ints, position: Array) -> None:
        """Move the windows of robots `rows` (R,) at positions (R, 2) [m] that are off their
        middles.
        """
        distance = np.abs(position / self._cell - (self._corner[rows] + WINDOW // 2))
        if np.maximum.reduce(distance, axis=None) <= _STRAY:
            return
        stray = self._cell_of(position) - self._corner[rows] - WINDOW // 2
        for k in np.flatnonzero(distance.max(axis=1) > _STRAY).tolist():
            self._move(int(rows[k]), stray[k])

    def _move(self, robot: int, by: _Ints) -> None:
        """Move a robot's window by some cells `by` (2,)."""
        window = self._windows()[robot]
        before = window.copy()
        self._written.append(_Moved(robot, self._corner[robot].copy(), before))
        window[:] = 0.0
        to = []
        origin = []
        for step in np.clip(by, -WINDOW, WINDOW).tolist():
            to.append(slice(max(-step, 0), WINDOW - max(step, 0)))
            origin.append(slice(max(step, 0), WINDOW - max(-step, 0)))
        window[tuple(to)] = before[tuple(origin)]
        self._corner[robot] += by


def _mean(values: Array, axis: int) -> Array:
    """Means over an axis; the method `mean` is slow."""
    return np.asarray(np.add.reduce(values, axis=axis) / values.shape[axis])


def _within(values: Array, largest: float) -> Array:
    """Values clipped to at most `largest` in size; `np.clip` is slow."""
    return np.minimum(np.maximum(values, -largest), largest)
