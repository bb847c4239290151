"""Pure pursuit of a reference in time.

R. C. Coulter, "Implementation of the pure pursuit path tracking algorithm", CMU-RI-TR-92-01, 1992.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from trackslip.controllers.control_law import ControlLaw, OncePerReference, natural_frequency, speed_to_keep_up
from trackslip.kinematics import Array, advance
from trackslip.metrics import body_errors
from trackslip.trajectory.base import Reference

STEP = 0.01
"""Approximate time between samples of the speed of a reference [s]."""


@dataclass(frozen=True)
class PurePursuit(ControlLaw):
    """Drives the arc through a goal that is `look_ahead` further along the path than the reference.

    The curvature of the arc is 2 y / d^2 for a goal at (x, y) in the body frame, at distance d; without errors it
    equals that of the path. On a straight line the closed loop is that of Eq. 31 with g = 2 / look_ahead^2 and
    xi = 1 / sqrt(2). The robot never drives against the direction of the reference; it waits instead.
    """

    look_ahead: float = 0.3
    """Distance of the goal along the path [m]."""
    damping: float = 0.7
    """xi of the speed law, of gain 2 xi sqrt(w_d^2 + g v_d^2) [-]."""
    stiffness: float = 10.0
    """g of the speed law [1/m^2]."""
    _path: OncePerReference[PathAhead] = field(default_factory=OncePerReference, init=False, repr=False, compare=False)

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (..., 2) from measured poses (..., 3)."""
        desired = reference.twist(time)
        gain = 2 * self.damping * natural_frequency(desired, self.stiffness)
        here, goal = reference.pose(time), self._path(PathAhead, reference).point(time, self.look_ahead)
        e_x, e_y, e_phi = np.moveaxis(body_errors(pose, here), -1, 0)
        v = speed_to_keep_up(desired, (e_x, e_y, e_phi), gain)
        x, y, _ = np.moveaxis(body_errors(pose, goal), -1, 0)
        # A robot far ahead of the reference that has nearly reached the goal must not spin.
        distance_squared = np.maximum(x**2 + y**2, (self.look_ahead / 2) ** 2)
        return np.stack([v, v * 2 * y / distance_squared], axis=-1)


class PathAhead:
    """The path of a reference, divided where it changes direction or stops."""

    def __init__(self, reference: Reference) -> None:
        self._reference = reference
        cells = max(1, round(reference.duration / STEP))
        self._times = np.linspace(0.0, reference.duration, cells + 1)  # (C + 1,)
        speeds = reference.twist((self._times[1:] + self._times[:-1]) / 2)[:, 0]
        self._distance = np.concatenate([[0.0], np.cumsum(speeds * np.diff(self._times))])  # (C + 1,)
        self._direction = np.sign(speeds)  # (C,)
        cuts = np.concatenate([np.flatnonzero(np.diff(self._direction)) + 1, [cells]])
        self._cut = cuts[np.searchsorted(cuts, np.arange(cells), side="right")]  # (C,)

    def point(self, time: float, distance: float) -> Array:
        """The pose (3,) on the path `distance` [m] beyond that at `time` [s], in the direction of travel.

        Beyond a cusp, a stop or the end, the path continues along its tangent.
        """
        now = float(np.clip(time, 0.0, self._reference.duration))
        cell = min(int(np.searchsorted(self._times, now, side="right")) - 1, len(self._direction) - 1)
        direction, cut = self._direction[cell], self._cut[cell]
        way = direction * (self._distance[cell : cut + 1] - np.interp(now, self._times, self._distance))
        then = max(now, np.interp(distance, way, self._times[cell : cut + 1])) if direction else now
        missing = direction * max(0.0, distance - way[-1])
        return advance(self._reference.pose(then), [missing, 0.0], 1.0)
