"""Likelihood of the known rectangle, given the ranges of a scan.

A beam with direction u meets a face whose plane is m.p = h at range h / (m.u). Two faces at most are turned to the LRF,
one long and one short; together they are a wedge, and a beam meets it where it enters the second of the two
half-planes. The likelihood has two parts:

- every return's range, with the scanner's noise, under a Huber loss;
- the two edges of the silhouette: the plate's outermost corners lie somewhere between the last beam that missed it and
  the first that hit it, uniformly, so the middle of that gap measures the corner's bearing with variance step^2 / 12.
  Without them nothing would hold the plate along its own direction when it is seen broadside on. An edge of the field
  of view, or of the scanner's reach, is no edge of the plate and measures nothing; and where beams inside the cluster
  are missing, at a rate p, beams beyond its last return may be too, p / (1 - p) of them with variance p / (1 - p)^2.
  An edge made by something that stands in front is none of the plate's either: the corner may lie anywhere behind it,
  and only a pose whose corner sticks out on the far side, or isn't reached by the last return, pays for it.

Thus a beam that passed where the pose says the plate is costs by the edges, and a return where the pose says there is
nothing costs as much as if it had been measured at the plate's near or far end.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trackslip.kinematics import Array
from trackslip.scan import LEAST_NOISE, Cluster, Plate, Scan

_ALONG, _ACROSS = np.array([1.0, 1.0, -1.0, -1.0]), np.array([1.0, -1.0, 1.0, -1.0])  # of the plate's corners
_MARGIN = 0.1  # returns this near to the scanner's reach may be cut off by it [m]


@dataclass(frozen=True)
class PlateLikelihood:
    """Minus the log likelihood of poses, with its derivatives."""

    plate: Plate
    huber: float
    """Residual beyond which a range counts linearly only [standard deviations]."""

    def evaluate(self, view: View, pose: Array, turn: bool) -> Fit:
        """Cost, gradient and Gauss-Newton Hessian at poses (M, 3); without `turn` as if the heading were known."""
        meeting = self._meeting(view, pose)
        residual, weight, cost = self._misses(view, meeting)
        e, n, predicted, on_long = meeting.e, meeting.n, meeting.predicted, meeting.on_long

        # dr/dcentre = m / (m.u); dr/dphi = how far along the face the beam hits, over m.u
        m_u = np.where(on_long, meeting.u_n, meeting.u_e)
        slope = np.where(meeting.on_plate & view.hit, 1.0 / (np.where(m_u == 0, 1.0, m_u) * view.noise), 0.0)
        from_middle = np.where(on_long, meeting.u_e, -meeting.u_n)
        from_middle *= predicted
        from_middle += np.where(on_long, -meeting.along[:, None], meeting.across[:, None])
        in_long = np.where(on_long, slope, 0.0)
        in_short = slope - in_long
        jacobian = np.empty((len(pose), 3, slope.shape[1]))
        jacobian[:, 0] = n[:, :1] * in_long + e[:, :1] * in_short
        jacobian[:, 1] = n[:, 1:] * in_long + e[:, 1:] * in_short
        jacobian[:, 2] = from_middle * slope
        weighted = jacobian * weight[:, None, :]
        gradient = (weighted @ residual[..., None])[..., 0]
        hessian = weighted @ jacobian.swapaxes(1, 2)

        edge_residual, edge_jacobian = self._edges(view, pose[:, :2], e, n)
        cost += np.sum(edge_residual**2, axis=1) / 2
        gradient += np.einsum("mei,me->mi", edge_jacobian, edge_residual)
        hessian += edge_jacobian.swapaxes(1, 2) @ edge_jacobian
        misfit = np.sqrt(np.sum(residual**2, axis=1) / np.maximum(view.hit.sum(axis=1), 1))
        if not turn:
            gradient[:, 2] = 0.0
            hessian[:, 2, :] = hessian[:, :, 2] = 0.0
            hessian[:, 2, 2] = 1.0
        return Fit(pose, cost, gradient, hessian, misfit)

    def cost(self, view: View, pose: Array) -> Array:
        """The cost (M,) alone at poses (M, 3)."""
        meeting = self._meeting(view, pose)
        edge_residual, _ = self._edges(view, pose[:, :2], meeting.e, meeting.n)
        return self._misses(view, meeting)[2] + np.sum(edge_residual**2, axis=1) / 2

    def _meeting(self, view: View, pose: Array) -> _Meeting:
        """Where beams meet plates at poses (M, 3)."""
        centre, phi = pose[:, :2], pose[:, 2]
        e = np.stack([np.cos(phi), np.sin(phi)], axis=-1)  # along the plate
        n = np.stack([-e[:, 1], e[:, 0]], axis=-1)  # across it
        along, across = np.sum(e * centre, axis=1), np.sum(n * centre, axis=1)
        u_e = e[:, :1] * view.u_x + e[:, 1:] * view.u_y  # (M, W)
        u_n = n[:, :1] * view.u_x + n[:, 1:] * view.u_y

        # range to the long and to the short face, whichever is turned to the LRF; -inf for one that isn't entered
        half_length, half_thickness = self.plate.length / 2, self.plate.thickness / 2
        long_face = np.where(np.abs(across) > half_thickness, across - np.sign(across) * half_thickness, 0.0)
        short_face = np.where(np.abs(along) > half_length, along - np.sign(along) * half_length, 0.0)
        to_long, to_short = _range_to(long_face, u_n), _range_to(short_face, u_e)
        on_long = to_long > to_short
        predicted = np.maximum(to_long, to_short)
        distance = np.hypot(centre[:, 0], centre[:, 1])
        reach = np.hypot(half_length, half_thickness)
        low, high = (distance - reach)[:, None], (distance + reach)[:, None]
        on_plate = (predicted > low) & (predicted < high)
        return _Meeting(e, n, along, across, u_e, u_n, on_long, on_plate, np.clip(predicted, low, high))

    def _misses(self, view: View, meeting: _Meeting) -> tuple[Array, Array, Array]:
        """Residuals (M, W) of the ranges [standard deviations], their weights (M, W), and what they cost (M,)."""
        residual = np.where(view.hit, (meeting.predicted - view.range) / view.noise, 0.0)
        size = np.abs(residual)
        weight = self.huber / np.maximum(size, self.huber)
        cost = np.sum(weight * size * (size - weight * size / 2), axis=1)
        return residual, weight, cost

    def _edges(self, view: View, centre: Array, e: Array, n: Array) -> tuple[Array, Array]:
        """Residuals (M, 2) of the silhouette's two edges and their Jacobian (M, 2, 3)."""
        along, across = self.plate.length / 2 * _ALONG, self.plate.thickness / 2 * _ACROSS
        d_x, d_y = along * e[:, :1] + across * n[:, :1], along * e[:, 1:] + across * n[:, 1:]  # (M, 4)
        x, y = centre[:, :1] + d_x, centre[:, 1:] + d_y
        cos, sin = np.cos(view.middle)[:, None], np.sin(view.middle)[:, None]  # bearings from the middle: no wrap there
        bearing = np.arctan2(cos * y - sin * x, cos * x + sin * y)
        rows = np.arange(len(centre))[:, None]
        outermost = np.stack([bearing.argmin(axis=1), bearing.argmax(axis=1)], axis=1)  # (M, 2)
        x, y, d_x, d_y = x[rows, outermost], y[rows, outermost], d_x[rows, outermost], d_y[rows, outermost]
        square = np.maximum(x**2 + y**2, 1e-12)
        jacobian = np.stack([-y, x, x * d_x + y * d_y], axis=-1) / square[..., None]
        off = bearing[rows, outermost] - view.edges
        residual = off - np.minimum(np.maximum(off, -view.slack), view.slack)
        weight = np.where((view.slack == 0) | (residual != 0), view.edge_weight, 0.0)
        return residual * weight, jacobian * weight[..., None]


@dataclass(frozen=True)
class _Meeting:
    """Beams that meet plates."""

    e: Array  # (M, 2) along the plate
    n: Array  # (M, 2) across it
    along: Array  # (M,) of the plate's centre, in these directions [m]
    across: Array  # (M,)
    u_e: Array  # (M, W) directions of the beams
    u_n: Array  # (M, W)
    on_long: np.ndarray  # (M, W) bool: the long face is met, else the short one
    on_plate: np.ndarray  # (M, W) bool
    predicted: Array  # (M, W) range [m]; of a beam that misses, that of the plate's near or far end


@dataclass(frozen=True)
class View:
    """What is measured of the plate in M scans."""

    u_x: Array  # (M, W) directions of the beams
    u_y: Array  # (M, W)
    range: Array  # (M, W) [m]
    hit: np.ndarray  # (M, W) bool
    middle: Array  # (M,) bearing half-way between the outermost returns [rad]
    edges: Array  # (M, 2) bearings of the silhouette's edges, from the middle [rad]
    edge_weight: Array  # (M, 2) one over their standard deviation, 0 for what is no edge [1/rad]
    slack: Array  # (M, 2) how far an edge that is hidden may be off and cost nothing [rad]
    noise: float  # of a range [m]

    @classmethod
    def of(cls, scan: Scan, cluster: Cluster) -> View:
        """What a scan shows of each cluster."""
        step = scan.beam_step
        low = np.min(cluster.bearing, axis=1, where=cluster.hit, initial=np.inf)
        high = np.max(cluster.bearing, axis=1, where=cluster.hit, initial=-np.inf)
        middle = (low + high) / 2
        missed = cluster.lost / np.maximum(cluster.lost + cluster.count, 1)  # of the beams inside the cluster
        lost = np.maximum(missed, scan.dropout)
        beyond = lost / (1 - lost)  # beams missed beyond it, expected
        slack = np.where(np.isfinite(cluster.hidden), cluster.hidden, 0.0) / 2
        reach = (high - low)[:, None] / 2 + (0.5 + beyond)[:, None] * step + slack
        spread = step * np.sqrt(1 / 12 + beyond / (1 - lost))
        farthest = np.max(cluster.range, axis=1, where=cluster.hit, initial=0.0)
        within = farthest < scan.max_range - _MARGIN
        tolerance = step / 4
        inside = np.stack([low > scan.bearings[0] + tolerance, high < scan.bearings[-1] - tolerance], axis=1)
        weight = np.where(inside & within[:, None] & np.isfinite(cluster.hidden), 1 / spread[:, None], 0.0)
        noise = max(scan.noise, LEAST_NOISE)
        u_x, u_y = np.cos(cluster.bearing), np.sin(cluster.bearing)
        edges = reach * np.array([-1.0, 1.0])
        return cls(u_x, u_y, cluster.range, cluster.hit, middle, edges, weight, slack, noise)

    def thinned(self, most: int) -> View:
        """Every so many beams only, so that at most about `most` are left; the edges stay."""
        every = max(1, self.u_x.shape[1] // most)
        return replace(
            self,
            u_x=self.u_x[:, ::every],
            u_y=self.u_y[:, ::every],
            range=self.range[:, ::every],
            hit=self.hit[:, ::every],
        )

    def take(self, rows: np.ndarray) -> View:
        """The scans `rows`, in that order, repeated where asked."""
        return View(
            self.u_x[rows],
            self.u_y[rows],
            self.range[rows],
            self.hit[rows],
            self.middle[rows],
            self.edges[rows],
            self.edge_weight[rows],
            self.slack[rows],
            self.noise,
        )


@dataclass(frozen=True)
class Fit:
    """A point on the climb."""

    pose: Array  # (M, 3) in the LRF's frame
    cost: Array  # (M,) minus log likelihood
    gradient: Array  # (M, 3)
    hessian: Array  # (M, 3, 3)
    misfit: Array  # (M,) rms residual of the ranges [standard deviations]

    def take(self, rows: np.ndarray) -> Fit:
        """The rows `rows`."""
        return Fit(self.pose[rows], self.cost[rows], self.gradient[rows], self.hessian[rows], self.misfit[rows])

    def put(self, rows: np.ndarray, other: Fit) -> None:
        """Overwrite the rows `rows` (R,) with `other`, R of them."""
        self.pose[rows], self.cost[rows], self.gradient[rows] = other.pose, other.cost, other.gradient
        self.hessian[rows], self.misfit[rows] = other.hessian, other.misfit


def _range_to(face: Array, m_u: Array) -> Array:
    """Range (M, W) at which beams enter the half-plane behind a face m.p = h (M,); -inf where they don't."""
    entering = (face[:, None] * m_u) > 0
    return np.where(entering, face[:, None] / np.where(entering, m_u, 1.0), -np.inf)


def inverses(matrix: Array) -> tuple[Array, np.ndarray]:
    """Inverses of symmetric (M, 3, 3) matrices by cofactors, and which of them (M,) are positive definite.

    Written out because numpy's inverse takes a call into LAPACK for each matrix.
    """
    xx, xy, xz = matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 0, 2]
    yy, yz, zz = matrix[:, 1, 1], matrix[:, 1, 2], matrix[:, 2, 2]
    c_xx, c_xy, c_xz = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    determinant = xx * c_xx + xy * c_xy + xz * c_xz
    regular = (determinant > 1e-12 * xx * yy * zz) & (xx > 0)
    scale = 1 / np.where(regular, determinant, 1.0)
    c_yy, c_yz, c_zz = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    inverse = np.stack([c_xx, c_xy, c_xz, c_xy, c_yy, c_yz, c_xz, c_yz, c_zz], axis=-1) * scale[:, None]
    return inverse.reshape(-1, 3, 3), regular
