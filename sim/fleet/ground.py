"""The grounds of a fleet, as the engine needs them: friction at every pad, shear, and gravity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from mujoco import batch
from numpy.typing import ArrayLike

from sim.common.settings import converted
from sim.ground.ground import Ground
from sim.ground.pull import Pull
from sim.ground.shear import Shear
from sim.robot.robot import Robot
from trackslip import se2
from trackslip.errors import require
from trackslip.kinematics import Array
from trackslip.restorable import Restorable

Rows = np.ndarray | slice
"""Indices of robots, or a slice over robots."""
EVERYONE = slice(None)
"""Slice over all robots."""
_LIGHTEST = 0.05  # load, relative to the mean, below which a point is neglected [-]
_AT_REST = 0.005  # speed below which a robot is at rest; creep is a hundred times slower [m/s]
_UPRIGHT = 0.1  # roll and pitch below which a robot stands on its tracks [rad]


class PadFriction:
    """Friction and shear modulus under each of P pads on N robots."""

    def __init__(self, grounds: Sequence[Ground], pads: Array) -> None:
        """Tabulate `grounds`, one per robot, for pads at positions `pads` (P, 2) on the robot
        [m].
        """
        self._pads = pads
        n, changes, patches = (
            len(grounds),
            max(len(g.changes) for g in grounds),
            max(len(g.patches) for g in grounds),
        )
        self.varies = changes > 0 or patches > 0  # whether the ground depends on place or time
        self._time = np.full((n, changes), np.inf)  # times of changes, in ascending order [s]
        # along, across, shear; before and after each change
        self._base = np.zeros((n, changes + 1, 3))
        self._corners = np.full((n, patches, 2, 2), np.nan)  # minimum and maximum; x, y [m]
        self._patch = np.zeros((n, patches, 3))
        # only once per ground
        patched = {key: _patches(ground) for key, ground in {id(g): g for g in grounds}.items()}
        for i, ground in enumerate(grounds):
            self._base[i] = ground.along, ground.across, ground.shear
            for j, change in enumerate(ground.changes):
                self._time[i, j] = change.time
                shear = self._base[i, j, 2] if change.shear is None else change.shear
                self._base[i, j + 1 :] = change.along, change.across, shear
            self._corners[i, : len(ground.patches)], self._patch[i, : len(ground.patches)] = (
                patched[id(ground)]
            )

    def surface(self, time: ArrayLike, position: Array, heading: Array) -> Array:
        """Friction along and across the tracks [-] and shear modulus [m] under the pads, (N, P, 3).

        `time` is counted from the start of the runs, a scalar or (N,) [s]. The robots are at
        positions (N, 2) [m] with headings (N,) [rad].
        """
        n = len(position)
        passed = (self._time <= np.reshape(time, (-1, 1)) + 1e-9).sum(axis=1)
        friction = np.repeat(self._base[np.arange(n), passed][:, None], len(self._pads), axis=1)
        if self._patch.shape[1] == 0:
            return friction
        place = position[:, None] + se2.rotate(heading[:, None], self._pads)  # (N, P, 2)
        low, high = np.moveaxis(self._corners[:, None], 3, 0)  # (N, 1, M, 2) each
        inside = ((place[:, :, None] >= low) & (place[:, :, None] < high)).all(axis=-1)  # (N, P, M)
        # where patches overlap, the last counts
        last = inside.shape[2] - 1 - np.argmax(inside[..., ::-1], axis=-1)
        on_patch = np.take_along_axis(self._patch, last[..., None], axis=1)
        on_patch[..., 2] = np.where(np.isnan(on_patch[..., 2]), friction[..., 2], on_patch[..., 2])
        return np.where(inside.any(axis=-1)[..., None], on_patch, friction)


def _patches(ground: Ground) -> tuple[Array, Array]:
    """Corners (K, 2, 2) [m] and surfaces (K, 3) of a ground's patches; a patch with NaN shear keeps
    the ground's.
    """
    corners = np.array([(patch.x, patch.y) for patch in ground.patches]).reshape(-1, 2, 2)
    surface = [(p.along, p.across, np.nan if p.shear is None else p.shear) for p in ground.patches]
    return corners.swapaxes(1, 2), np.array(surface).reshape(-1, 3)


def one_each(ground: Ground | Sequence[Ground], size: int) -> list[Ground]:
    """Return one ground for each of `size` robots; raises InvalidValueError for a wrong number of
    grounds.
    """
    grounds = [ground] * size if isinstance(ground, Ground) else list(ground)
    require(len(grounds) == size, "ground", f"{len(grounds)} grounds", f"one or {size}")
    return grounds


class FleetGround(Restorable):
    """The ground under each of N robots."""

    STATE = ("_surface", "_shear")

    def __init__(
        self, of: batch.Batch, robot: Robot, grounds: Sequence[Ground], shear: Shear | None
    ) -> None:
        """Put each robot in the batch `of` on one of `grounds`, which must be Coulomb grounds
        without `shear`.
        """
        self._batch, self._robot, self._shear = of, robot, shear
        # (N, P, 2), a view of the batch
        self._pads = of.expand("pair_friction")[:, robot.pad_pairs, :2]
        # last result of PadFriction.surface
        self._surface: Array = np.zeros((of.nsim, len(robot.pad_side), 3))
        self.grounds = tuple(grounds)  # ground of each robot
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
        largest = max(ground.largest_shear for ground in grounds)
        allowed = (
            "0 for a fleet that began on ground that doesn't shear: say Fleet(..., shears=True)"
        )
        require(largest == 0 or self._shear is not None, "ground.shear", largest, allowed)
        changed = dict(
            enumerate(grounds) if rows is None else zip(rows.tolist(), grounds, strict=True)
        )
        self.grounds = tuple(changed.get(k, ground) for k, ground in enumerate(self.grounds))
        self._ground = PadFriction(self.grounds, self._robot.pad_position)
        # slopes of the grounds (N,) [rad]
        self.slope = np.array([ground.slope for ground in self.grounds])
        self.uphill = np.array([ground.uphill for ground in self.grounds])
        """Headings (N,) at which robots drive straight up the slopes [rad]."""

    def tilt(self, rows: np.ndarray) -> None:
        """Tilt gravity for the robots `rows` (R,) by the slopes of their grounds."""
        if (
            any(self.grounds[k].slope != 0 for k in rows)
            or self._batch.expanded("opt.gravity") is not None
        ):
            size = -float(self._robot.model.opt.gravity[2])
            self._batch.expand("opt.gravity")[rows] = [self.grounds[k].gravity(size) for k in rows]

    def lay(self, rows: Rows, time: Array, position: Array, heading: Array) -> None:
        """Set the friction at every pad of the robots `rows` (R,).

        All N robots are at positions (N, 2) [m] with headings (N,) [rad], at times (N,) since their
        runs began [s].
        """
        self._surface[rows] = self._ground.surface(time, position, heading)[rows]
        self.share(rows)

    def share(self, rows: Rows) -> None:
        """Scale the pads' friction to the share that shear has mobilised under the robots `rows`
        (R,).
        """
        friction = self._surface[rows, ..., :2]
        self._pads[rows] = (
            friction if self._shear is None else friction * self._shear.share[rows][..., None]
        )

    def moved(self, rows: Rows, before: Array, after: Array, belt: Array) -> None:
        """Shear the ground by the motion of the robots `rows` (R,) in a period; see `Shear.advance`
        for arguments.
        """
        if self._shear is not None:
            self._shear.advance(rows, before, after, belt, self._surface[rows, ..., 2])
            self.share(rows)

    def hold(self, rows: np.ndarray, heading: Array, drawbar: Array, height: float) -> None:
        """Shear the ground by the smallest displacement that holds the robots `rows` (R,) at
        headings (R,) [rad].

        `drawbar` (R,) is the backward towing force at a `height` [m], relative to the normal force
        [-].
        """
        if self._shear is None:
            return
        slope, uphill = np.tan(self.slope[rows]), self.uphill[rows] - heading
        along, across = slope * np.cos(uphill), slope * np.sin(uphill)
        forwards, left, up = self.centre_of_mass(rows).T
        x, y = self._robot.pad_position.T
        # loads are linear in position; forces are spread as in the engine, where all points are
        # treated alike
        lean_x, lean_y = forwards - up * along - height * drawbar, left - up * across
        load = 1 + lean_x[:, None] * x / np.mean(x**2) + lean_y[:, None] * y / np.mean(y**2)
        turn = (forwards * across - left * along)[:, None] / np.mean(x**2 + y**2)
        push = np.stack(
            [(along + drawbar)[:, None] - turn * y, across[:, None] + turn * x], axis=-1
        )
        load = np.maximum(load, _LIGHTEST)
        self._shear.rest(rows, heading, load, push / load[..., None], self._surface[rows])
        self.share(rows)

    def centre_of_mass(self, rows: Rows) -> Array:
        """Centres of mass of the robots `rows` (R,) in the robots' frames [m]: (R, 3), or (3,) if
        all are equal.
        """
        chassis, moved = self._robot.model.body("chassis").id, self._batch.expanded("body_ipos")
        return self._robot.model.body_ipos[chassis] if moved is None else moved[rows, chassis]


def require_at_rest(
    grounds: Sequence[Ground], heading: Array, speed: Array, lean: Array, pull: Pull
) -> None:
    """Raise InvalidValueError if any of R robots slides or has tipped over at its start.

    The robots are on `grounds` (R,) with a `heading` [rad], `speed` [m/s] and `lean` [rad], each
    (R,).
    """
    for k in map(int, np.flatnonzero(~(speed < _AT_REST) | ~(lean < _UPRIGHT))):
        what = "slides" if lean[k] < _UPRIGHT else "tips over"
        field, value = ("pull", pull.force) if pull.force > 0 else ("slope", grounds[k].slope)
        allowed = (
            f"less, to park with heading {round(float(heading[k]), 3) + 0:g} rad: the robot {what}"
        )
        require(False, field, value, allowed)
