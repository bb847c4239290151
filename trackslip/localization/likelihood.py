"""Likelihood of the known rectangle, given the ranges of a scan, and its maximisation for many scans at once.

A beam with direction u meets a face whose plane is m.p = h at range h / (m.u). At most two faces point towards the LRF,
one long and one short; together they form a wedge, which a beam meets where it enters the second of the two
half-planes. The likelihood has two parts:

- the range of every return, with the scanner's noise, under a Huber loss;
- the two edges of the silhouette: the outermost corners of the plate are uniformly distributed between the last beam
  that missed it and the first that hit it, so the middle of that gap measures the bearing of the corner with variance
  step^2 / 12. Without the edges, a plate seen broadside could slide freely along itself. An edge of the field of view
  or of the scanner's reach is not an edge of the plate and measures nothing. If beams inside the cluster are missing
  at a rate p, beams beyond its last return may be missing too: p / (1 - p) of them, with variance p / (1 - p)^2. An
  edge made by an object in front of the plate is not the plate's either: the corner may be anywhere behind the object,
  and only a pose whose corner sticks out beyond it, or does not reach the last return, adds to the cost.

Thus a beam that passes through the supposed plate adds to the cost by way of the edges, and a return where the pose
leaves nothing to hit costs as much as if it had been measured at the near or far end of the plate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.rows import Rows
from trackslip.localization.scan import MIN_NOISE, Cluster, Plate, Scan

UNKNOWN = 1e6
"""Variance of what a scan does not determine."""
_CONVERGED = 1e-5  # a climb ends when the predicted or actual decrease of the cost is smaller
_MARGIN = 0.1  # the scanner's reach may cut off returns this close to it [m]


@dataclass(frozen=True)
class PlateLikelihood:
    """Negative log likelihood of poses, with its derivatives and minima."""

    plate: Plate
    huber: float
    """Residual above which the loss of a range is linear [standard deviations]."""

    def evaluate(self, beams: Beams, pose: Array, turn: bool = True) -> Evaluation:
        """Cost, gradient and Gauss-Newton Hessian at poses (M, 3); without `turn`, the heading is fixed."""
        residual, jacobian = self._ranges(beams, pose)
        edge_residual, edge_jacobian = self._edges(beams, pose)
        weight, cost = self._loss(residual, edge_residual)
        weighted = jacobian * weight[:, None, :]
        gradient = (weighted @ residual[..., None])[..., 0] + np.einsum("mei,me->mi", edge_jacobian, edge_residual)
        hessian = weighted @ jacobian.swapaxes(1, 2) + edge_jacobian.swapaxes(1, 2) @ edge_jacobian
        misfit = np.sqrt(_squares(residual) / np.maximum(beams.hit.sum(axis=1), 1))
        if not turn:
            gradient[:, 2] = 0.0
            hessian[:, 2, :] = hessian[:, :, 2] = 0.0
            hessian[:, 2, 2] = 1.0
        return Evaluation(pose, cost, gradient, hessian, misfit)

    def cost(self, beams: Beams, pose: Array) -> Array:
        """Only the cost (M,) at poses (M, 3)."""
        return self._loss(self._ranges(beams, pose, derive=False)[0], self._edges(beams, pose)[0])[1]

    def climb(self, beams: Beams, pose: Array, iterations: int, turn: bool = True) -> Evaluation:
        """Levenberg-Marquardt from poses (M, 3) in the LRF's frame; without `turn` the heading is fixed.

        A row that has converged no longer changes, so that rows are bitwise independent of each other.
        """
        fit = self.evaluate(beams, pose.copy(), turn)
        damping = np.full(len(pose), 1e-3)
        climbing = np.arange(len(pose))
        for _ in range(iterations):
            here = fit if climbing.size == len(pose) else fit.take(climbing)
            damped = here.hessian + damping[:, None, None] * here.hessian * np.eye(3)
            inverse, regular = inverses(damped)
            step = -np.einsum("mij,mj->mi", inverse, here.gradient)
            on = ~regular | (np.einsum("mi,mi->m", step, here.gradient) < -2 * _CONVERGED)
            if not on.all():
                climbing, beams, damping = climbing[on], beams.take(on), damping[on]
                here, step, regular = here.take(on), step[on], regular[on]
            if not climbing.size:
                break
            trial = self.evaluate(beams, here.pose + np.where(regular[:, None], step, 0.0), turn)
            fall = here.cost - trial.cost
            better = fall > 0
            fit.put(climbing[better], trial.take(better))
            on = ~better | (fall > _CONVERGED)
            if not on.any():
                break
            damping = np.where(better, damping / 10, damping * 10)[on]
            if not on.all():
                climbing, beams = climbing[on], beams.take(on)
        return fit

    def _loss(self, residual: Array, edge_residual: Array) -> tuple[Array, Array]:
        """Weights (M, W) of the ranges under a Huber loss, and costs (M,) of all residuals."""
        size = np.abs(residual)
        weight = self.huber / np.maximum(size, self.huber)
        return weight, np.einsum("mw,mw->m", weight * size, size - weight * size / 2) + _squares(edge_residual) / 2

    def _ranges(self, beams: Beams, pose: Array, derive: bool = True) -> tuple[Array, Array]:
        """Residuals (M, W) of the ranges [standard deviations], and their Jacobian (M, 3, W), empty unless `derive`."""
        x, y, phi = pose[:, :1], pose[:, 1:2], pose[:, 2:]
        cos, sin = np.cos(phi), np.sin(phi)  # (M, 1)
        along, across = cos * x + sin * y, cos * y - sin * x
        u_e = cos * beams.u_x + sin * beams.u_y  # (M, W)
        u_n = cos * beams.u_y - sin * beams.u_x

        # ranges to the long and the short face that point towards the LRF; -inf if not entered
        half_length, half_thickness = self.plate.length / 2, self.plate.thickness / 2
        long_face = np.where(np.abs(across) > half_thickness, across - np.sign(across) * half_thickness, 0.0)
        short_face = np.where(np.abs(along) > half_length, along - np.sign(along) * half_length, 0.0)
        to_long, to_short = _range_to(long_face, u_n), _range_to(short_face, u_e)
        on_long = to_long > to_short
        entered = np.maximum(to_long, to_short)
        distance, reach = np.hypot(x, y), math.hypot(half_length, half_thickness)
        predicted = np.minimum(np.maximum(entered, distance - reach), distance + reach)
        residual = np.where(beams.hit, (predicted - beams.range) / beams.noise, 0.0)
        if not derive:
            return residual, np.empty(0)

        # dr/dcentre = m / (m.u); dr/dphi = how far along the face the beam hits, over m.u
        m_u = np.where(on_long, u_n, u_e)
        slope = np.where((predicted == entered) & beams.hit, 1.0 / (np.where(m_u == 0, 1.0, m_u) * beams.noise), 0.0)
        from_middle = np.where(on_long, u_e, -u_n)
        from_middle *= predicted
        from_middle += np.where(on_long, -along, across)
        in_long = np.where(on_long, slope, 0.0)
        in_short = slope - in_long
        jacobian = np.empty((len(pose), 3, slope.shape[1]))
        jacobian[:, 0] = cos * in_short - sin * in_long
        jacobian[:, 1] = cos * in_long + sin * in_short
        jacobian[:, 2] = from_middle * slope
        return residual, jacobian

    def _edges(self, beams: Beams, pose: Array) -> tuple[Array, Array]:
        """Residuals (M, 2) of the two edges of the silhouette, and their Jacobian (M, 2, 3)."""
        bearing, jacobian, square = self.plate.silhouette(pose, beams.ahead)
        off = bearing - beams.edges
        residual = off - np.minimum(np.maximum(off, -beams.slack), beams.slack)
        weight = np.where((beams.slack == 0) | (residual != 0), beams.edge_weight, 0.0)
        return residual * weight, jacobian * (weight / np.maximum(square, 1e-12))[..., None]


@dataclass(frozen=True)
class Beams(Rows):
    """The beams of M scans that measure the plate."""

    u_x: Array  # (M, W) directions of the beams
    u_y: Array  # (M, W)
    range: Array  # (M, W) [m]
    hit: np.ndarray  # (M, W) bool
    ahead: Array  # (M, 2) direction of the middle, half-way between the outermost returns
    edges: Array  # (M, 2) bearings of the silhouette's edges, from the middle [rad]
    edge_weight: Array  # (M, 2) reciprocal of their standard deviation, 0 if not an edge of the plate [1/rad]
    slack: Array  # (M, 2) deviation of a hidden edge that costs nothing [rad]
    noise: float  # of a range [m]

    @classmethod
    def of(cls, scan: Scan, cluster: Cluster) -> Beams:
        """The beams of each cluster of a scan."""
        step = scan.beam_step
        low = np.min(cluster.bearing, axis=1, where=cluster.hit, initial=np.inf)
        high = np.max(cluster.bearing, axis=1, where=cluster.hit, initial=-np.inf)
        middle = (low + high) / 2
        missed = cluster.lost / np.maximum(cluster.lost + cluster.count, 1)  # of the beams inside the cluster
        lost = np.maximum(missed, scan.dropout)
        beyond = lost / (1 - lost)  # expected number of beams missed beyond it
        slack = np.where(np.isfinite(cluster.hidden), cluster.hidden, 0.0) / 2
        reach = (high - low)[:, None] / 2 + (0.5 + beyond)[:, None] * step + slack
        spread = step * np.sqrt(1 / 12 + beyond / (1 - lost))
        farthest = np.max(cluster.range, axis=1, where=cluster.hit, initial=0.0)
        within = farthest < scan.max_range - _MARGIN
        tolerance = step / 4
        inside = np.stack([low > scan.bearings[0] + tolerance, high < scan.bearings[-1] - tolerance], axis=1)
        weight = np.where(inside & within[:, None] & np.isfinite(cluster.hidden), 1 / spread[:, None], 0.0)
        noise = max(scan.noise, MIN_NOISE)
        u_x, u_y = np.cos(cluster.bearing), np.sin(cluster.bearing)
        edges = reach * np.array([-1.0, 1.0])
        ahead = np.stack([np.cos(middle), np.sin(middle)], axis=1)
        return cls(u_x, u_y, cluster.range, cluster.hit, ahead, edges, weight, slack, noise)

    def thinned(self, most: int) -> Beams:
        """Only every n-th beam, so that at most about `most` are left; the edges are kept."""
        every = max(1, self.u_x.shape[1] // most)
        return replace(self, **{name: getattr(self, name)[:, ::every] for name in ("u_x", "u_y", "range", "hit")})


@dataclass(frozen=True)
class Evaluation(Rows):
    """The likelihood at M poses."""

    pose: Array  # (M, 3) in the LRF's frame
    cost: Array  # (M,) negative log likelihood
    gradient: Array  # (M, 3)
    hessian: Array  # (M, 3, 3)
    misfit: Array  # (M,) rms residual of the ranges [standard deviations]


def _range_to(face: Array, m_u: Array) -> Array:
    """Range (M, W) at which beams enter the half-plane behind a face m.p = h (M, 1); -inf where they do not."""
    entering = (face * m_u) > 0
    return np.where(entering, face / np.where(entering, m_u, 1.0), -np.inf)


def _squares(array: Array) -> Array:
    """Sums (M,) of the squares in rows (M, K)."""
    return np.einsum("mk,mk->m", array, array)


def inverses(matrix: Array) -> tuple[Array, np.ndarray]:
    """Inverses of symmetric matrices (M, 3, 3) by cofactors, and a mask (M,) of the positive definite ones.

    Written out because NumPy's inverse calls LAPACK for each matrix.
    """
    xx, xy, xz = matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 0, 2]
    yy, yz, zz = matrix[:, 1, 1], matrix[:, 1, 2], matrix[:, 2, 2]
    c_xx, c_xy, c_xz = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    determinant = xx * c_xx + xy * c_xy + xz * c_xz
    regular = (determinant > 1e-12 * xx * yy * zz) & (xx > 0)
    scale = 1 / np.where(regular, determinant, 1.0)
    c_yy, c_yz, c_zz = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    inverse = np.empty((len(matrix), 9))
    for k, cofactor in enumerate((c_xx, c_xy, c_xz, c_xy, c_yy, c_yz, c_xz, c_yz, c_zz)):
        np.multiply(cofactor, scale, out=inverse[:, k])
    return inverse.reshape(-1, 3, 3), regular


def covariances(hessian: Array) -> Array:
    """Inverses (M, 3, 3) of Hessians (M, 3, 3); UNKNOWN in every element of one that is not positive definite."""
    inverse, regular = inverses(hessian)
    return np.where(regular[:, None, None], inverse, UNKNOWN)
