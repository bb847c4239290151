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
_BESIDE_SIGHT: Final = np.radians(2.0)
# sine of the viewing angle above which a plate is seen from the side
_FROM_SIDE: Final = np.sin(np.radians(30.0))
# visible fraction of a side above which both visible ends locate the side [-]
_VISIBLE_SIDE: Final = 0.8
_MIN_EXTENT: Final = 0.35  # smallest extent of a valid line [m]
_MIN_RETURNS: Final = 3  # fewest returns of a valid line
_MIN_DISTANCE: Final = 1e-3  # smallest distance of a line that its covariance assumes [m]
_MIN_LENGTH: Final = 1e-2  # smallest extent of a line that its covariance assumes [m]
# smallest sine of the viewing angle that the covariance of a line assumes [-]
_MIN_SINE: Final = 1e-2


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

        # from the face to the centre, away from the LRF
        normal = np.stack([-np.sin(line.heading), np.cos(line.heading)], axis=-1)
        side = np.sign(np.einsum("si,si->s", normal, line.middle))[:, None]
        position = line.middle + side * normal * self.plate.thickness / 2
        pose = np.concatenate([position, line.heading[:, None]], axis=-1)

        valid = (cluster.count >= _MIN_RETURNS) & (line.extent > _MIN_EXTENT)
        covariance = _covariance(scan, cluster, line, self.plate)
        covariance[~valid] = np.nan
        return PoseEstimate(scan.to_world(pose), scan.covariance_to_world(covariance), valid)


@dataclass(frozen=True)
class Line:
    """Lines through the clusters of S scans, in the LRF's frame."""

    heading: Array  # (S,) ambiguous by half a turn [rad]
    middle: Array  # (S, 2) halfway between the outermost points [m]
    extent: Array  # (S,) distance between the outermost points along the line [m]

    @property
    def distance(self) -> Array:
        """Distances (S,) of the middles from the LRF [m]."""
        return np.hypot(self.middle[:, 0], self.middle[:, 1])

    @property
    def sight(self) -> Array:
        """Bearings (S,) of the middles [rad]."""
        return np.arctan2(self.middle[:, 1], self.middle[:, 0])


def fit_line(cluster: Cluster) -> Line:
    """Fit a total-least-squares line to the returns of each cluster; arbitrary for an empty
    cluster.

    The line passes through the mean of the points. With the sums S of squares and products of their
    deviations (x, y) from the mean, the sum of squared distances from a line of the heading phi,

        sum (y cos(phi) - x sin(phi))^2 = (S_xx + S_yy) / 2 - (S_xx - S_yy) / 2 cos(2 phi)
                                          - S_xy sin(2 phi),

    is smallest where tan(2 phi) = 2 S_xy / (S_xx - S_yy), in the quadrant of both.
    """
    row = cluster.row
    count = np.maximum(cluster.count, 1)
    x, y = cluster.positions
    mean_x = cluster.sums(x) / count
    mean_y = cluster.sums(y) / count
    x = x - mean_x[row]
    y = y - mean_y[row]
    s_xx = cluster.sums(x * x)
    s_xy = cluster.sums(x * y)
    s_yy = cluster.sums(y * y)
    heading = np.arctan2(2 * s_xy, s_xx - s_yy) / 2

    # the outermost points along the line, from the mean
    cos = np.cos(heading)
    sin = np.sin(heading)
    low, high = cluster.extremes(x * cos[row] + y * sin[row])
    shift = (low + high) / 2
    middle = np.stack([mean_x + shift * cos, mean_y + shift * sin], axis=-1)
    return Line(heading, middle, extent=high - low)


def _covariance(scan: Scan, cluster: Cluster, line: Line, plate: Plate) -> Array:
    """Covariance (S, 3, 3) of line fits, from noise across the line, beam spacing along the line,
    and model error.

    Across the line, the mean of n ranges with the noise sigma has the variance sigma^2 sin^2 / n,
    with the angle between the line of sight and the line. The slope of a line through n points that
    are spread evenly over the length l has 12 / l^2 times this variance. Along the line, each end
    is uniformly distributed over the spacing of the beams, with 1 / 12 of its square as variance,
    and the middle is the mean of both ends.

    The model is wrong where both faces are visible, because a single line is fitted to the returns
    from both faces.
    """
    count = np.maximum(cluster.count, _MIN_RETURNS)
    distance = np.maximum(line.distance, _MIN_DISTANCE)
    extent = np.maximum(line.extent, _MIN_LENGTH)
    angle = line.heading - line.sight
    sine = np.maximum(np.abs(np.sin(angle)), _MIN_SINE)
    cosine = np.abs(np.cos(angle))

    # share of the returns that are from the short face, by the apparent sizes of both faces
    short_size = plate.thickness * cosine
    short_share = short_size / (short_size + plate.length * sine)
    mixed = plate.thickness * short_share

    noise_across = (scan.noise * sine) ** 2
    spacing = distance * scan.beam_step / sine
    across = noise_across / count + mixed**2
    along = spacing**2 / 12 / 2 + (scan.noise * (1 - sine)) ** 2 / 2 + mixed**2
    # turn of the line if these returns are at one end, off by the thickness
    leaning = 3 * plate.thickness / plate.length * short_share
    heading = 12 * noise_across / (count * extent**2) + leaning**2

    axes = in_axes(line.heading)
    variances = np.stack([along, across, heading], axis=-1)
    return np.asarray(axes.swapaxes(1, 2) @ (variances[..., None] * axes))


def starts(cluster: Cluster, plate: Plate, beam_step: float, near: Array | None) -> Array:
    """Initial poses (S, K, 3) for fits.

    The headings are that of the fitted line, that of its mirror image, and one on each side of
    edge-on. If the line is seen from the side, the poses near edge-on are replaced by the pose of
    the line, shifted slightly towards each end or, if part of the plate is out of sight, as far as
    it may extend. With `near` (S, 3), two more poses follow.
    """
    line = fit_line(cluster)
    sight = line.sight
    is_from_side = np.abs(np.sin(line.heading - sight)) > _FROM_SIDE
    mirrored = 2 * sight - line.heading

    # how far the plate may slide along the line
    is_all_visible = line.extent > _VISIBLE_SIDE * plate.length
    half_spacing = line.distance * beam_step / 2
    hidden_length = plate.length - line.extent
    slide = np.where(is_all_visible, half_spacing, hidden_length)
    slide = np.where(is_from_side, slide, 0.0)
    zero = np.zeros(len(slide))
    along = np.stack([np.cos(line.heading), np.sin(line.heading), zero], axis=-1)
    shift = slide[:, None] * along

    on_left = np.where(is_from_side, line.heading, sight + _BESIDE_SIGHT)
    on_right = np.where(is_from_side, line.heading, sight - _BESIDE_SIGHT)
    poses = [
        place(cluster, line.heading, line.middle, plate),
        place(cluster, mirrored, line.middle, plate),
        place(cluster, on_left, line.middle, plate) + shift,
        place(cluster, on_right, line.middle, plate) - shift,
    ]
    if near is not None:
        poses += [place(cluster, near[:, 2], line.middle, plate), near]
    return np.stack(poses, axis=1)


def place(cluster: Cluster, heading: Array, middle: Array, plate: Plate) -> Array:
    """Poses (S, 3) of plates with `heading` (S,), placed so that the faces towards the LRF touch
    the returns.

    `middle` (S, 2) are points of the plates.
    """
    along = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    along_centre = _centre(cluster, along, middle, plate.length)
    across_centre = _centre(cluster, across, middle, plate.thickness)
    centre = along_centre[:, None] * along + across_centre[:, None] * across
    return np.concatenate([centre, heading[:, None]], axis=-1)


def _centre(cluster: Cluster, axis: Array, middle: Array, size: float) -> Array:
    """Coordinates (S,) along `axis` (S, 2) of the centres of plates with a side of `size` [m].

    Both ends of the returns locate a side that is visible from end to end. A partly visible side is
    visible at its end towards the LRF, whose coordinate is 0.
    """
    row = cluster.row
    x, y = cluster.positions
    low, high = cluster.extremes(x * axis[row, 0] + y * axis[row, 1])
    lrf_is_below = np.sum(axis * middle, axis=1) > 0
    from_near_end = np.where(lrf_is_below, low + size / 2, high - size / 2)
    is_visible = high - low > _VISIBLE_SIDE * size
    return np.where(is_visible, (low + high) / 2, from_near_end)
