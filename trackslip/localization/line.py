"""Lines through the points on the plate: the paper's localization (Sec. III-B), and initial poses
for fits.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.likelihood import in_axes
from trackslip.localization.pose_estimate import PoseEstimate
from trackslip.localization.scan import Cluster, Plate, Scan, extract_plate

# angle between the line of sight and the two initial headings beside it [rad]
_BESIDE: Final = np.radians(2.0)
# sine of the viewing angle above which a plate is seen from the side
_FROM_SIDE: Final = np.sin(np.radians(30.0))
_WHOLE: Final = 0.8  # visible fraction of a side above which both visible ends locate the side
_MIN_EXTENT: Final = 0.35  # smallest extent of a valid line [m]


@dataclass(frozen=True)
class LineLocator:
    """Locator that fits a total-least-squares line: its slope is the heading, its mid-point the
    position.

    Two effects that the paper does not mention are corrected. The points lie on the face of the
    plate, half its thickness closer to the LRF than the plate's centre. And twice per turn the
    plate is seen edge-on, and the line fits the thin face, 90 degrees off: clusters shorter than
    _MIN_EXTENT are rejected.
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
    """Lines through the clusters of S scans, in the LRF's frame."""

    heading: Array  # (S,) ambiguous by half a turn [rad]
    middle: Array  # (S, 2) halfway between the outermost points [m]
    extent: Array  # (S,) distance between the outermost points along the line [m]


def fit_line(cluster: Cluster) -> Line:
    """Fit a total-least-squares line to the returns of each cluster; arbitrary for an empty
    cluster.
    """
    row, n = cluster.row, np.maximum(cluster.count, 1)
    x, y = cluster.range * np.cos(cluster.bearing), cluster.range * np.sin(cluster.bearing)
    mean_x, mean_y = cluster.sums(x) / n, cluster.sums(y) / n
    dx, dy = x - mean_x[row], y - mean_y[row]
    heading = (
        np.arctan2(2 * cluster.sums(dx * dy), cluster.sums(dx * dx) - cluster.sums(dy * dy)) / 2
    )
    cos, sin = np.cos(heading), np.sin(heading)
    low, high = cluster.extremes(dx * cos[row] + dy * sin[row])
    shift = (low + high) / 2
    return Line(
        heading, np.stack([mean_x + shift * cos, mean_y + shift * sin], axis=-1), high - low
    )


def _covariance(scan: Scan, cluster: Cluster, line: Line, plate: Plate, valid: np.ndarray) -> Array:
    """Covariance (S, 3, 3) of line fits, from noise across the line, beam spacing along the line,
    and model error.

    The model is wrong where both faces are visible, because a single line is fitted to the returns
    from both faces.
    """
    n = np.maximum(cluster.count, 3)
    distance = np.maximum(np.hypot(line.middle[:, 0], line.middle[:, 1]), 1e-3)
    sight = np.arctan2(line.middle[:, 1], line.middle[:, 0])
    grazing = np.maximum(np.abs(np.sin(line.heading - sight)), 1e-2)
    # apparent size of the short face, relative to its thickness
    facing = np.abs(np.cos(line.heading - sight))
    # share of returns
    short_share = plate.thickness * facing / (plate.thickness * facing + plate.length * grazing)
    mixed = plate.thickness * short_share
    across = (scan.noise * grazing) ** 2 / n + mixed**2
    along = (
        (distance * scan.beam_step / grazing) ** 2 / 12 / 2
        + (scan.noise * (1 - grazing)) ** 2 / 2
        + mixed**2
    )
    # turn of a least-squares line if the share `short_share` of the returns is at one end, off by
    # the thickness
    leaning = 3 * plate.thickness / plate.length * short_share
    heading = (
        12 * (scan.noise * grazing) ** 2 / (n * np.maximum(line.extent, 1e-2) ** 2) + leaning**2
    )
    axes = in_axes(line.heading)
    covariance = axes.swapaxes(1, 2) @ (
        np.stack([along, across, heading], axis=-1)[..., None] * axes
    )
    covariance[~valid] = np.nan
    return covariance


def starts(cluster: Cluster, plate: Plate, beam_step: float, near: Array | None) -> Array:
    """Initial poses (S, K, 3) for fits.

    The headings are that of the fitted line, that of its mirror image, and one on each side of
    edge-on. If the line is seen from the side, the poses near edge-on are replaced by the pose of
    the line, shifted slightly towards each end or, if part of the plate is out of sight, as far as
    it may extend. With `near` (S, 3), two more poses follow.
    """
    line = fit_line(cluster)
    distance = np.hypot(line.middle[:, 0], line.middle[:, 1])
    sight = np.arctan2(line.middle[:, 1], line.middle[:, 0])
    from_side = np.abs(np.sin(line.heading - sight)) > _FROM_SIDE
    whole = line.extent > _WHOLE * plate.length
    slide = np.where(
        from_side, np.where(whole, distance * beam_step / 2, plate.length - line.extent), 0.0
    )
    end = slide[:, None] * np.stack(
        [np.cos(line.heading), np.sin(line.heading), np.zeros(len(slide))], axis=-1
    )
    poses = [
        place(cluster, heading, line.middle, plate)
        for heading in (line.heading, 2 * sight - line.heading)
    ]
    for sign in (1, -1):
        heading = np.where(from_side, line.heading, sight + sign * _BESIDE)
        poses.append(place(cluster, heading, line.middle, plate) + sign * end)
    if near is not None:
        poses += [place(cluster, near[:, 2], line.middle, plate), near]
    return np.stack(poses, axis=1)


def place(cluster: Cluster, heading: Array, middle: Array, plate: Plate) -> Array:
    """Poses (S, 3) of plates with `heading` (S,), placed so that the faces towards the LRF touch
    the returns.
    """
    row = cluster.row
    x, y = cluster.range * np.cos(cluster.bearing), cluster.range * np.sin(cluster.bearing)
    e = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    n = np.stack([-e[:, 1], e[:, 0]], axis=-1)
    centre = np.zeros((len(heading), 2))
    for axis, size in ((e, plate.length), (n, plate.thickness)):
        low, high = cluster.extremes(x * axis[row, 0] + y * axis[row, 1])
        away = np.sum(axis * middle, axis=1) > 0  # the LRF is on the side of low coordinates
        # a partly visible side is visible at its near end
        near = np.where(away, low + size / 2, high - size / 2)
        centre += np.where(high - low > _WHOLE * size, (low + high) / 2, near)[:, None] * axis
    return np.concatenate([centre, heading[:, None]], axis=-1)
