"""The paper's localization: a line through the points on the plate (Sec. III-B), with two corrections."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.base import PoseEstimate
from trackslip.localization.scan import Cluster, Plate, Scan, extract_plate

_MIN_EXTENT = 0.35  # of a valid line [m]


@dataclass(frozen=True)
class LineLocator:
    """Total-least-squares line through the cluster: its slope is the heading, its mid-point the position.

    Corrected are two points that the paper does not mention. The points lie on the face of the plate, half its
    thickness closer to the LRF than its centre. And twice per turn the plate is seen edge-on, so that the line fits the
    thin face, 90 degrees off: clusters shorter than _MIN_EXTENT are rejected.
    """

    plate: Plate = field(default_factory=Plate)

    def locate(self, scan: Scan, predicted: Array | None = None) -> PoseEstimate:
        """Poses of the plate in scans with ranges (S, B); see `Locator`."""
        near = None if predicted is None else scan.from_world(predicted)
        cluster = extract_plate(scan, self.plate, near)
        line = fit_line(cluster)
        normal = np.stack([-np.sin(line.heading), np.cos(line.heading)], axis=-1)
        away = np.sign(np.einsum("si,si->s", normal, line.middle))[:, None]
        position = line.middle + away * normal * self.plate.thickness / 2
        pose = np.concatenate([position, line.heading[:, None]], axis=-1)
        valid = (cluster.count >= 3) & (line.extent > _MIN_EXTENT)
        covariance = _covariance(scan, cluster, line, self.plate, valid)
        return PoseEstimate(scan.to_world(pose), scan.covariance_to_world(covariance), valid)


@dataclass(frozen=True)
class Line:
    """Lines through clusters, in the LRF's frame."""

    heading: Array  # (S,) up to half a turn [rad]
    middle: Array  # (S, 2) half-way between the outermost points [m]
    extent: Array  # (S,) distance of the outermost points along the line [m]


def fit_line(cluster: Cluster) -> Line:
    """Total-least-squares line through the returns of each cluster; arbitrary for an empty one."""
    row, n = cluster.row, np.maximum(cluster.count, 1)
    x, y = cluster.range * np.cos(cluster.bearing), cluster.range * np.sin(cluster.bearing)
    mean_x, mean_y = cluster.sums(x) / n, cluster.sums(y) / n
    dx, dy = x - mean_x[row], y - mean_y[row]
    heading = np.arctan2(2 * cluster.sums(dx * dy), cluster.sums(dx * dx) - cluster.sums(dy * dy)) / 2
    cos, sin = np.cos(heading), np.sin(heading)
    low, high = cluster.extremes(dx * cos[row] + dy * sin[row])
    shift = (low + high) / 2
    return Line(heading, np.stack([mean_x + shift * cos, mean_y + shift * sin], axis=-1), high - low)


def _covariance(scan: Scan, cluster: Cluster, line: Line, plate: Plate, valid: np.ndarray) -> Array:
    """Covariance (S, 3, 3) of a line fit: noise across the line, the silhouette's beam spacing along it, model error.

    The model is wrong where both faces are visible, because one line is fitted to the returns from both.
    """
    n = np.maximum(cluster.count, 3)
    distance = np.maximum(np.hypot(line.middle[:, 0], line.middle[:, 1]), 1e-3)
    sight = np.arctan2(line.middle[:, 1], line.middle[:, 0])
    grazing = np.maximum(np.abs(np.sin(line.heading - sight)), 1e-2)
    facing = np.abs(np.cos(line.heading - sight))  # how much of the short face is seen
    short_share = plate.thickness * facing / (plate.thickness * facing + plate.length * grazing)  # of the returns
    mixed = plate.thickness * short_share
    across = (scan.noise * grazing) ** 2 / n + mixed**2
    along = (distance * scan.beam_step / grazing) ** 2 / 12 / 2 + (scan.noise * (1 - grazing)) ** 2 / 2 + mixed**2
    # least squares with that share of the returns at one end, off by the thickness
    leaning = 3 * plate.thickness / plate.length * short_share
    heading = 12 * (scan.noise * grazing) ** 2 / (n * np.maximum(line.extent, 1e-2) ** 2) + leaning**2
    cos, sin = np.cos(line.heading), np.sin(line.heading)
    covariance = np.zeros((len(n), 3, 3))
    covariance[:, 0, 0] = along * cos**2 + across * sin**2
    covariance[:, 1, 1] = along * sin**2 + across * cos**2
    covariance[:, 0, 1] = covariance[:, 1, 0] = (along - across) * cos * sin
    covariance[:, 2, 2] = heading
    covariance[~valid] = np.nan
    return covariance
