"""The place of a plate along itself, or sideways, if beams may be lost at its ends: exact likelihood and posterior.

A beam that meets the plate returns nothing with probability p. The plate reaches at least as far as its outermost
returns; if k more beams beyond one of them meet it, that has the likelihood p^k. As the plate slides, each beam that
one end gains multiplies the likelihood by p, and each that the other end leaves divides it by p. The likelihood is a
staircase between two walls, which stand where the plate no longer reaches one of the outermost returns, and nothing
like a normal distribution:

- Seen broadside, the plate gains and leaves beams at the same rate. All places between the walls are equally probable,
  and their middle is the mean. Its error grows with the distance of the walls, the number of lost beams, which is
  known from the length of the plate.
- Seen from an end, the plate covers more beams per metre at its near end than at the far one. The more it reaches
  towards the scanner, the more beams would have to be lost.

Where beams are lost and no return is from the short face, this is all that is known along the plate. A return from the
short face adds a narrow peak to the staircase, unless it is so close to the corner that it may be from the long face.
The posterior is therefore summed over the places between the walls and, more finely, over those around the fit.

Nearly edge-on, the same holds sideways, where the short face ends: there it is the long face that adds the peak.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.beams import OUTWARDS, Beams
from trackslip.localization.likelihood import PlateLikelihood
from trackslip.localization.quadrature import moments, quadrature
from trackslip.localization.rows import Rows
from trackslip.localization.scan import Cluster, Scan
from trackslip.localization.view import Points, View

_OUTSIDE = 7.0  # cost of a return that a pose leaves nothing to hit: it may be from something else
_BETWEEN_WALLS = (np.arange(32) + 0.5) / 32  # places along the plate [their distance]
_ABOUT_FIT = np.linspace(-4.0, 4.0, 13)  # places along the plate [standard deviations of the fit]
_TINY = 1e-12  # keeps a beam along the plate from dividing by zero


@dataclass(frozen=True)
class Ends(Rows):
    """The outermost returns of M scans, right and left, and the beams beyond them."""

    ahead: Points  # (M,) direction of the middle, half-way between them
    reach: Array  # (M,) angle between the middle and each of them [rad]
    hidden: Array  # (M, 2) angle that something closer hides beyond each [rad]
    room: Array  # (M, 2) number of beams farther out that would tell whether they meet the plate
    step: float  # angle between beams [rad]
    dropout: float  # probability that a beam that meets the plate returns nothing, above 0 [-]

    @classmethod
    def of(cls, scan: Scan, cluster: Cluster, beams: Beams) -> Ends:
        """Of clusters of a scan with known dropout, and their beams."""
        low, high = cluster.bearing[:, 0], cluster.bearing[np.arange(len(cluster.count)), cluster.width - 1]
        hidden = 2 * beams.edges.slack
        room = (np.stack([low - scan.bearings[0], scan.bearings[-1] - high], axis=1) - hidden) / scan.beam_step
        room = np.where(beams.edges.weight > 0, np.rint(room), 0.0)
        return cls(beams.edges.ahead, (high - low) / 2, hidden, room, scan.beam_step, scan.dropout)

    def place(
        self, likelihood: PlateLikelihood, beams: Beams, pose: Array, sigma: Array, sideways: bool = False
    ) -> tuple[Array, Array, Array]:
        """How far off poses (M, 3) are along the plate or sideways: posterior mean, variance and cost, (M,) each.

        The rest of the pose is taken as known. `sigma` (M,) is the width of a peak that there may be at the poses [m].
        The cost is the negative logarithm of the integrated likelihood.
        """
        view = View.of(likelihood.plate, pose)
        walls = np.sort(self.walls(view, sideways), axis=0)[:, :, None]
        between = walls[0] + (walls[1] - walls[0]) * _BETWEEN_WALLS
        about = np.clip(sigma[:, None] * _ABOUT_FIT, np.minimum(walls[0], 0.0), np.maximum(walls[1], 0.0))
        offset = np.concatenate([between, about], axis=1)
        ranges = likelihood.ranges_sideways if sideways else likelihood.ranges_along
        cost = ranges(beams, view, offset) + self.cost(view.slid(offset, sideways))
        share, span = quadrature(offset, cost)
        mean, variance = moments(offset, share, span)
        least = cost.min(axis=1)
        return mean, variance, least - np.log(np.sum(np.exp(least[:, None] - cost) * span, axis=1))

    def cost(self, view: View) -> Array:
        """Negative log likelihoods (M, K) of what the ends tell about K plates in each scan."""
        hidden, room = self.hidden.T[..., None], self.room.T[..., None]
        corner = view.bearings(self.ahead)
        beyond = (corner * OUTWARDS[..., None] - self.reach[:, None]) / self.step  # beams beyond the outermost return
        lost = np.minimum(np.maximum(np.floor(beyond - hidden / self.step), 0.0), room)
        cost = _OUTSIDE * np.ceil(np.maximum(-beyond, 0.0)) - np.log(self.dropout) * lost
        return cost[0] + cost[1]

    def walls(self, view: View, sideways: bool) -> Array:
        """How far plates slide along themselves or sideways until they miss a return, right and left (2, M) [m].

        That is at most their length.
        """
        corner = view.place + view.corners()
        outermost = self.ahead * np.exp(1j * OUTWARDS * self.reach) * view.axis.conj()  # directions of these returns
        along, across, u_along, u_across = corner.real, corner.imag, outermost.real, outermost.imag
        if sideways:
            along, across, u_along, u_across = across, along, u_across, u_along
        wall = across * u_along / np.where(u_across == 0, _TINY, u_across) - along
        return np.clip(wall, -view.plate.length, view.plate.length)
