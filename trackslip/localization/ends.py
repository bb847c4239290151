"""The ends of the plate where beams are lost: a scan without an echo at its end may still have met the plate.

If a beam that meets the plate returns nothing with probability p, a pose under which k beams beyond the outermost
return meet the plate has the likelihood p^k, and one under which the outermost return itself misses it, none. Along the
plate this is a staircase with a wall at each end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.rows import Rows
from trackslip.localization.scan import Cluster, Scan
from trackslip.localization.view import View

_OUTSIDE = 7.0  # cost of a return from something else than the plate
_MARGIN = 0.1  # the scanner's reach may cut off returns this close to it [m]


@dataclass(frozen=True)
class Ends(Rows):
    """The outermost returns, right and left, in M scans, and the beams beyond them."""

    ahead: Array  # (M, 2) direction of the middle, half-way between them
    reach: Array  # (M,) angle between the middle and each [rad]
    hidden: Array  # (M, 2) angle that something closer hides beyond each [rad]
    room: Array  # (M, 2) number of beams farther out that would have met the plate if it were there
    step: float  # angle between beams [rad]
    dropout: float  # probability that a beam that meets the plate returns nothing [-]

    @classmethod
    def of(cls, scan: Scan, cluster: Cluster) -> Ends:
        """Of clusters with at least one return each."""
        low = cluster.bearing[:, 0]
        high = cluster.bearing[np.arange(len(low)), cluster.width - 1]
        middle = (low + high) / 2
        room = np.rint(np.stack([low - scan.bearings[0], scan.bearings[-1] - high], axis=1) / scan.beam_step)
        farthest = np.max(cluster.range, axis=1, where=cluster.hit, initial=0.0)
        told = np.isfinite(cluster.hidden) & (farthest < scan.max_range - _MARGIN)[:, None]
        ahead = np.stack([np.cos(middle), np.sin(middle)], axis=1)
        hidden = np.where(told, cluster.hidden, 0.0)
        return cls(ahead, (high - low) / 2, hidden, np.where(told, room, 0.0), scan.beam_step, scan.dropout)

    def cost(self, view: View, offset: Array) -> Array:
        """Negative log likelihoods (M, K) of the beams beyond the returns, for plates slid by `offset` (M, K) [m]."""
        every = np.repeat(np.arange(len(offset)), offset.shape[1])
        corner = view.slid(offset).silhouette(self.ahead[every])[0] * [-1.0, 1.0]
        beyond = (corner - self.reach[every, None]) / self.step
        lost = np.clip(np.floor(beyond - self.hidden[every] / self.step), 0.0, self.room[every])
        cost = -np.log(self.dropout) * lost + _OUTSIDE * np.ceil(np.maximum(-beyond, 0.0))
        return cost.sum(axis=1).reshape(offset.shape)

    def slack(self, view: View) -> Array:
        """How far plates can slide (M, 2) until an outermost return misses them [m], ascending."""
        corner = view.corners()  # (M, 2, 2)
        turn = np.array([-1.0, 1.0]) * self.reach[:, None]
        x, y = self.ahead[:, :1], self.ahead[:, 1:]
        u_x, u_y = x * np.cos(turn) - y * np.sin(turn), y * np.cos(turn) + x * np.sin(turn)
        u_e = u_x * view.cos[:, None] + u_y * view.sin[:, None]
        u_n = u_y * view.cos[:, None] - u_x * view.sin[:, None]
        across = corner[:, :, 1] + view.across[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.sort(across * u_e / u_n - corner[:, :, 0] - view.along[:, None], axis=1)
