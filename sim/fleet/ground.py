"""The grounds of a fleet, as the engine needs them: friction at every pad, shear, and gravity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from mujoco import batch
from numpy.typing import ArrayLike

from sim.common.settings import converted
from sim.ground.ground import Ground
from sim.ground.pull import Pull
from sim.ground.ruts import Ruts
from sim.ground.shear import Shear
from sim.robot.parameters import SINK
from sim.robot.robot import Robot
from trackslip import se2
from trackslip.errors import InvalidValueError, require
from trackslip.kinematics import Array
from trackslip.restorable import Restorable

Rows = np.ndarray | slice
"""Indices of robots, or a slice over robots."""
EVERYONE: Final = slice(None)
"""Slice over all robots."""
_LIGHTEST: Final = 0.05  # smallest load of a point at rest, relative to the mean [-]
# speed below which a robot is at rest; creep is a hundred times slower [m/s]
_AT_REST: Final = 0.005
_UPRIGHT: Final = 0.1  # roll and pitch below which a robot stands on its tracks [rad]
_ROUNDING: Final = 1e-9  # tolerance on the time of a change [s]
_TINY: Final = 1e-300


class PadFriction:
    """Friction and shear modulus under each of P pads on N robots.

    A surface is described by three numbers: friction along and across the tracks [-], and the shear
    modulus [m].
    """

    def __init__(self, grounds: Sequence[Ground], pads: Array) -> None:
        """Tabulate `grounds`, one per robot, for pads at positions `pads` (P, 2) on the robot
        [m].
        """
        self._pads = pads
        size = len(grounds)
        changes = max(len(ground.changes) for ground in grounds)
        patches = max(len(ground.patches) for ground in grounds)
        self.varies = changes > 0 or patches > 0
        """Whether any ground depends on place or time."""
        self._time = np.full((size, changes), np.inf)  # times of changes, in ascending order [s]
        self._base = np.zeros((size, changes + 1, 3))  # surfaces before and after each change
        self._corners = np.full((size, patches, 2, 2), np.nan)  # lowest and highest; x, y [m]
        self._patch = np.zeros((size, patches, 3))  # surfaces on the patches

        # robots often share a ground, whose patches are read only once
        read: dict[int, tuple[Array, Array]] = {}
        for robot, ground in enumerate(grounds):
            self._tabulate_changes(robot, ground)
            if id(ground) not in read:
                read[id(ground)] = _patches(ground)
            corners, surfaces = read[id(ground)]
            self._corners[robot, : len(corners)] = corners
            self._patch[robot, : len(surfaces)] = surfaces

    def _tabulate_changes(self, robot: int, ground: Ground) -> None:
        """Tabulate the times of a ground's changes, and its surfaces before and after them."""
        self._base[robot] = ground.along, ground.across, ground.shear
        for k, change in enumerate(ground.changes):
            shear = self._base[robot, k, 2] if change.shear is None else change.shear
            self._time[robot, k] = change.time
            self._base[robot, k + 1 :] = change.along, change.across, shear

    def surface(self, time: ArrayLike, position: Array, heading: Array) -> Array:
        """Friction along and across the tracks [-] and shear modulus [m] under the pads, (N, P, 3).

        `time` is counted from the start of the runs, a scalar or (N,) [s]. The robots are at
        positions (N, 2) [m] with headings (N,) [rad].
        """
        robots = np.arange(len(position))
        has_changed = self._time <= np.reshape(time, (-1, 1)) + _ROUNDING
        now = self._base[robots, has_changed.sum(axis=1)]
        off_patches = np.repeat(now[:, None], len(self._pads), axis=1)
        if self._patch.shape[1] == 0:
            return off_patches

        # which pads (N, P) are on which patches (M)
        place = position[:, None] + se2.rotate(heading[:, None], self._pads)
        place = place[:, :, None]
        lowest = self._corners[:, None, :, 0]
        highest = self._corners[:, None, :, 1]
        is_within = (place >= lowest) & (place < highest)
        is_on = np.logical_and.reduce(is_within, axis=-1)  # (N, P, M)

        # where patches overlap, the last counts
        last = is_on.shape[2] - 1 - np.argmax(is_on[..., ::-1], axis=-1)
        on_patch = np.take_along_axis(self._patch, last[..., None], axis=1)
        shear = on_patch[..., 2]
        on_patch[..., 2] = np.where(np.isnan(shear), off_patches[..., 2], shear)
        return np.where(is_on.any(axis=-1)[..., None], on_patch, off_patches)


def _patches(ground: Ground) -> tuple[Array, Array]:
    """Corners (K, 2, 2) [m] and surfaces (K, 3) of a ground's patches; a patch with NaN shear keeps
    the ground's.
    """
    count = len(ground.patches)
    corners = np.zeros((count, 2, 2))
    surfaces = np.zeros((count, 3))
    for k, patch in enumerate(ground.patches):
        shear = np.nan if patch.shear is None else patch.shear
        corners[k, :, 0] = patch.x
        corners[k, :, 1] = patch.y
        surfaces[k] = patch.along, patch.across, shear
    return corners, surfaces


def one_each(ground: Ground | Sequence[Ground], size: int) -> list[Ground]:
    """Return one ground for each of `size` robots; raises InvalidValueError for a wrong number of
    grounds.
    """
    grounds = [ground] * size if isinstance(ground, Ground) else list(ground)
    require(len(grounds) == size, "ground", f"{len(grounds)} grounds", f"one or {size}")
    return grounds


class FleetGround(Restorable):
    """The ground under each of N robots."""

    STATE = ("_surface", "_shear", "_ruts")

    def __init__(
        self,
        of: batch.Batch,
        robot: Robot,
        grounds: Sequence[Ground],
        shear: Shear | None,
        ruts: Ruts | None = None,
    ) -> None:
        """Put each robot in the batch `of` on one of `grounds`, which must be Coulomb grounds
        without `shear`, and must not be soft without `ruts`.
        """
        self._batch = of
        self._robot = robot
        self._shear = shear
        self._ruts = ruts
        self._everyone = np.arange(of.nsim)
        self._chassis = robot.model.body("chassis").id
        self._centre: Array = robot.model.body_ipos[self._chassis]  # (3,) of mass [m]
        if ruts is not None:
            # views of the batch: where contacts begin (N, P), and heights (N,) of the ground
            self._margins = of.expand("pair_margin")[:, robot.pad_pairs]
            self._heights = of.expand("geom_pos")[:, robot.model.geom("ground").id, 2]
        # (N, P, 2), a view of the batch
        self._pads = of.expand("pair_friction")[:, robot.pad_pairs, :2]
        # last result of PadFriction.surface
        self._surface: Array = np.zeros((of.nsim, len(robot.pad_side), 3))
        self.grounds = tuple(grounds)
        """Ground of each robot."""
        self.put(grounds)

    @property
    def friction(self) -> Array:
        """Full friction coefficients (N, P, 2) along and across the tracks, before shear reduces
        them [-].
        """
        return self._surface[..., :2]

    @property
    def varies(self) -> bool:
        """Whether any ground depends on place or time."""
        return self._ground.varies

    def get_state(self) -> dict[str, Any]:
        """Return a copy of the state, see Restorable."""
        return super().get_state() | {"grounds": self.grounds}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore a state from `get_state`, see Restorable."""
        super().set_state(state)
        self.put([converted("ground", ground, Ground) for ground in state["grounds"]])

    def put(self, grounds: Sequence[Ground], rows: np.ndarray | None = None) -> None:
        """Assign one of `grounds` to each robot, or to each of `rows` (R,); `lay` and `tilt` write
        them to the engine.

        Raises InvalidValueError for shearing ground under robots that were not built for it.
        """
        if self._ruts is None:
            reason = "this fleet began on firm ground: say Fleet(..., sinks=True)"
            for ground in grounds:
                ground.require_firm(reason)
        largest = max(ground.largest_shear for ground in grounds)
        allowed = (
            "0 for a fleet that began on ground that doesn't shear: say Fleet(..., shears=True)"
        )
        require(largest == 0 or self._shear is not None, "ground.shear", largest, allowed)

        everyone = range(len(self.grounds))
        changed = list(self.grounds)
        for robot, ground in zip(everyone if rows is None else rows, grounds, strict=True):
            changed[robot] = ground
        self.grounds = tuple(changed)
        self._ground = PadFriction(self.grounds, self._robot.pad_position)
        if self._ruts is not None:
            where = np.arange(len(self.grounds)) if rows is None else rows
            soils = [self.grounds[row].soil for row in where.tolist()]
            self._ruts.put(where, soils, self._give(where))
            self._write_ruts(where)
            self.share(where)
        self.slope = np.array([ground.slope for ground in self.grounds])
        """Slopes of the grounds (N,) [rad]."""
        self.uphill = np.array([ground.uphill for ground in self.grounds])
        """Headings (N,) at which robots drive straight up the slopes [rad]."""

    def tilt(self, rows: np.ndarray) -> None:
        """Tilt gravity for the robots `rows` (R,) by the slopes of their grounds."""
        has_slope = bool((self.slope[rows] != 0).any())
        was_tilted = self._batch.expanded("opt.gravity") is not None
        if has_slope or was_tilted:
            size = -float(self._robot.model.opt.gravity[2])
            tilted = [self.grounds[row].gravity(size) for row in rows]
            self._batch.expand("opt.gravity")[rows] = tilted

    def lay(self, rows: Rows, time: Array, position: Array, heading: Array) -> None:
        """Set the friction at every pad of the robots `rows` (R,).

        All N robots are at positions (N, 2) [m] with headings (N,) [rad], at times (N,) since their
        runs began [s].
        """
        self._surface[rows] = self._ground.surface(time, position, heading)[rows]
        if self._ruts is not None:
            self._soften(self._soft(rows))
        self.share(rows)

    def begin_ruts(self, rows: np.ndarray, pose: Array) -> None:
        """Begin without ruts around the robots `rows` (R,) at poses (R, 7), see `Ruts.press`."""
        if self._ruts is not None:
            self._ruts.forget(rows, pose[:, :2])
            self.press(rows, pose)

    def press(self, rows: Rows, pose: Array) -> None:
        """Press the soil under the robots `rows` (R,) at poses (R, 7), see `Ruts.press`."""
        if self._ruts is None:
            return
        soft = self._soft(rows)
        if soft.size:
            self._ruts.press(soft, pose[self._ruts.is_soft[rows]])
            self._write_ruts(soft)
            self.share(soft)

    def traction_moment(self, rows: Rows) -> Array:
        """Moments (R,) by which the tractions in ruts pitch the robots `rows` (R,) forwards, about
        their origins [N m].

        Soil acts along a track, whose line passes through the robot's origin, and so without a
        moment. The engine's tractions are horizontal at contact points of different heights. They
        are assumed proportional to load times friction.
        """
        assert self._ruts is not None
        by_pad = self._ruts.compression[rows] * self._pads[rows, :, 0]
        moment = by_pad * self._ruts.height[rows]
        of_track = len(by_pad), 2, -1
        total = np.add.reduce(by_pad.reshape(of_track), axis=-1)  # (R, 2)
        moments = np.add.reduce(moment.reshape(of_track), axis=-1)
        mean_height = moments / np.maximum(total, _TINY)
        left, right = (self._ruts.traction[rows] * mean_height).T
        return np.asarray(left + right)

    def sinkage(self, rows: np.ndarray) -> Array:
        """Sinkages (R,) of the robots `rows` (R,) at rest, under an even pressure [m]."""
        sinkage = np.zeros(len(rows))
        if self._ruts is None:
            return sinkage
        for k, row in enumerate(rows.tolist()):
            ground = self.grounds[row]
            if ground.soil is not None:
                pressure = SINK / self._give(rows[k : k + 1])[0] * np.cos(ground.slope)
                sinkage[k] = self._ruts.sinkage(ground.soil, pressure)
        return sinkage

    def _soft(self, rows: Rows) -> np.ndarray:
        """Those of the robots `rows` that are on soft soil."""
        assert self._ruts is not None
        return self._everyone[rows][self._ruts.is_soft[rows]]

    def _give(self, rows: np.ndarray) -> Array:
        """What the contacts of robots `rows` (R,) settle per pressure [m/Pa]: SINK under the weight
        on level ground.
        """
        shape = self._robot.parameters
        length = len(shape.axles) * shape.patch_length if shape.axles else shape.contact_length
        area = 2 * shape.track_width * length
        masses = self._batch.expanded("body_mass")
        mass = self._robot.mass if masses is None else masses[rows].sum(axis=1)
        gravity = float(np.linalg.norm(self._robot.model.opt.gravity))
        return np.broadcast_to(SINK * area / (mass * gravity), len(rows))

    def _write_ruts(self, rows: np.ndarray) -> None:
        """Write to the engine where contacts begin under the robots `rows` (R,), and give the pads
        of those on soft soil its friction.

        The ground lies at the mean of the depths at which contacts begin, because the engine puts
        contact points midway between pad and ground.
        """
        assert self._ruts is not None
        floor = self._ruts.floor[rows]
        self._heights[rows] = -floor
        self._margins[rows] = floor[:, None] - self._ruts.margin[rows]
        self._soften(self._soft(rows))

    def _soften(self, soft: np.ndarray) -> None:
        """Give the pads of the robots `soft` (R,) the friction and the shear of their soil."""
        assert self._ruts is not None
        self._surface[soft] = self._ruts.surface[soft]

    def share(self, rows: Rows) -> None:
        """Scale the pads' friction to the share that shear has mobilised under the robots `rows`
        (R,).
        """
        friction = self._surface[rows, ..., :2]
        if self._shear is not None:
            friction = friction * self._shear.share[rows][..., None]
        self._pads[rows] = friction

    def moved(
        self, rows: Rows, before: Array, after: Array, pose: Array | None, belt: Array
    ) -> None:
        """Shear and press the ground by the motion of the robots `rows` (R,) in a period; see
        `Ruts.advance` for arguments.
        """
        lifted = None
        if self._ruts is not None and pose is not None:
            soft = self._soft(rows)
            if soft.size:
                which = self._ruts.is_soft[rows]
                places = (before[:, which], after[:, which])
                in_air = self._ruts.advance(soft, *places, pose[which], belt[which])
                self._write_ruts(soft)
                if in_air is not None:
                    lifted = np.zeros_like(belt)
                    lifted[which] = in_air
        if self._shear is not None:
            modulus = self._surface[rows, ..., 2]
            self._shear.advance(rows, before, after, belt, modulus, lifted)
            self.share(rows)

    def hold(self, rows: np.ndarray, heading: Array, drawbar: Array, height: float) -> None:
        """Shear the ground by the smallest displacement that holds the robots `rows` (R,) at
        headings (R,) [rad].

        `drawbar` (R,) is the backward towing force at a `height` [m], relative to the normal force
        [-].

        All forces are relative to the robot's normal force. On a slope, the ground pushes the robot
        uphill by (a, c), along and across its tracks. With the centre of mass at (f, l, u), the
        robot stands if the normal forces of the ground act at the centre of pressure

            (f - u a - height drawbar, l - u c),

        and if the ground turns the robot by the moment f c - l a. The loads are assumed linear in
        the points' positions (x, y); the moment is spread as forces (-y, x) times a constant, as in
        the engine, which treats all points alike. Both assume that positions have the mean 0.
        """
        if self._shear is None:
            return
        steepness = np.tan(self.slope[rows])
        bearing = self.uphill[rows] - heading
        along = steepness * np.cos(bearing)
        across = steepness * np.sin(bearing)
        forwards, left, up = self.centre_of_mass(rows).T
        x, y = self._robot.pad_position.T

        pressure_x = forwards - up * along - height * drawbar
        pressure_y = left - up * across
        by_x = pressure_x[:, None] * x / np.mean(x**2)
        by_y = pressure_y[:, None] * y / np.mean(y**2)
        load = np.maximum(1 + by_x + by_y, _LIGHTEST)

        moment = forwards * across - left * along
        turn = moment[:, None] / np.mean(x**2 + y**2)
        push_along = (along + drawbar)[:, None] - turn * y
        push_across = across[:, None] + turn * x
        push = np.stack([push_along, push_across], axis=-1)
        self._shear.rest(rows, heading, load, push / load[..., None], self._surface[rows])
        self.share(rows)

    def centre_of_mass(self, rows: Rows) -> Array:
        """Centres of mass of the robots `rows` (R,) in the robots' frames [m]: (R, 3), or (3,) if
        all are equal.
        """
        moved = self._batch.expanded("body_ipos")
        return self._centre if moved is None else moved[rows, self._chassis]


def require_at_rest(
    grounds: Sequence[Ground], heading: Array, speed: Array, lean: Array, pull: Pull
) -> None:
    """Raise InvalidValueError if any of R robots slides or has tipped over at its start.

    The robots are on `grounds` (R,) with a `heading` [rad], `speed` [m/s] and `lean` [rad], each
    (R,).
    """
    rests = (speed < _AT_REST) & (lean < _UPRIGHT)  # False if the simulation diverged
    for robot in np.flatnonzero(~rests).tolist():
        what = "slides" if lean[robot] < _UPRIGHT else "tips over"
        rounded = round(float(heading[robot]), 3) + 0  # never -0
        allowed = f"less, to park with heading {rounded:g} rad: the robot {what}"
        if pull.force > 0:
            raise InvalidValueError("pull", pull.force, allowed)
        raise InvalidValueError("slope", grounds[robot].slope, allowed)
