"""What the predictive controllers have in common: horizon, weights, limits, and plans to go on from."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trackslip.controllers.base import Remembering
from trackslip.errors import require_whole
from trackslip.kinematics import Array, track_speeds, twist_of_tracks
from trackslip.trajectory.base import Reference


@dataclass(frozen=True)
class Horizon(Remembering, ABC):
    """Base of the laws that minimise predicted errors by track speeds within their limits, held for an interval each.

    Each call improves the plan of the previous one, shifted, and drives its first twist. A robot whose pose is not
    finite keeps its shifted plan.
    """

    intervals: int = 15
    """K, number of intervals in the horizon [-]."""
    interval: float = 0.2
    """Duration of an interval [s]."""
    position_scale: float = 0.1
    """Error in x or y that costs as much as the other quantities at their scales [m]."""
    heading_scale: float = 0.6
    """Error of the heading that costs as much [rad]."""
    final_weight: float = 10.0
    """Factor on the cost of the errors at the end of the horizon [-]."""
    track_speed: float = 0.295
    """Speed limit of each track, slightly below the 0.3 m/s of the sprockets [m/s]."""
    half_gauge: float = 0.213
    """b + D, the effective half gauge with slip compensation; half the gauge without it [m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_whole("intervals", self.intervals, 1, 100)

    @property
    def weights(self) -> Array:
        """Weights (K, 3) of the squared errors (x, y, phi) after each interval [1/m^2, 1/m^2, 1/rad^2]."""
        weights = np.tile(
            [self.position_scale**-2, self.position_scale**-2, self.heading_scale**-2], (self.intervals, 1)
        )
        weights[-1] *= self.final_weight
        return weights

    def twist(self, time: float, pose: ArrayLike, reference: Reference) -> Array:
        """Twists (..., 2) from measured poses (..., 3), of the same shape as in the first call since `reset`."""
        pose = np.asarray(pose, float)
        nodes = time + self.interval * np.arange(self.intervals + 1)
        twists = reference.twist((nodes[1:] + nodes[:-1]) / 2)  # (K, 2), means
        wanted = track_speeds(twists, self.half_gauge)
        shape = (*pose.shape[:-1], self.intervals, 2)
        elapsed = self._elapsed(time, pose.shape[:-1])
        if elapsed is None:
            plans = np.broadcast_to(np.clip(wanted, -self.track_speed, self.track_speed), shape)
        else:
            plans = self._shifted(self._kept["plans"], elapsed)
        (seen,) = np.isfinite(pose).all(axis=-1).ravel().nonzero()
        robots, better = pose.reshape(-1, 3)[seen], plans.reshape(-1, *shape[-2:]).copy()
        if seen.size:
            better[seen] = self._improved(time, better[seen], robots, reference.pose(nodes), twists)
        self._kept["plans"] = better.reshape(shape)
        return twist_of_tracks(self._kept["plans"][..., 0, :], self.half_gauge)

    @abstractmethod
    def _improved(self, time: float, plans: Array, pose: Array, poses: Array, twists: Array) -> Array:
        """Better plans (R, K, 2) of plans (R, K, 2) at `time` [s], of robots at poses (R, 3).

        The reference has poses (K + 1, 3) at the ends of the intervals, and mean twists (K, 2).
        """

    def _shifted(self, plans: Array, elapsed: float) -> Array:
        """Plans (..., K, 2), shifted by `elapsed` [s]; their last speeds are held."""
        last = self.intervals - 1
        later = np.minimum(np.arange(last + 1) + elapsed / self.interval, last)
        k = np.minimum(later.astype(int), max(last - 1, 0))
        share = (later - k)[:, None]
        return (1 - share) * plans[..., k, :] + share * plans[..., np.minimum(k + 1, last), :]
