"""The posterior of a plate's pose under the exact likelihood of a scan with lost beams, summed over a grid of poses."""

import numpy as np
from beside import rectangle

from trackslip.kinematics import Array
from trackslip.localization.scan import Plate

_WIDTHS = np.linspace(-5.0, 5.0, 9)  # across the plate and of the heading [standard deviations]
_STEPS = 7  # beam steps by which the plate slides either way
_HOPELESS = 16.0


def ranges_of(pose: Array, plate: Plate, bearings: Array) -> Array:
    """Ranges (G, B) of beams to plates at poses (G, 3), infinite where they miss."""
    directions = np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)
    return rectangle(pose[:, None], (plate.length, plate.thickness))(np.zeros(2), directions, np.zeros(1))


def log_likelihood(pose: Array, plate: Plate, bearings: Array, ranges: Array, noise: float, dropout: float) -> Array:
    """Of poses (G, 3), given ranges (B,), NaN for none: (G,), less a constant."""
    predicted = ranges_of(pose, plate, bearings)
    hit, returned = np.isfinite(predicted), np.isfinite(ranges)
    residual = (np.where(hit, predicted, 0.0) - np.where(returned, ranges, 0.0)) / noise
    met = np.where(hit, -(residual**2) / 2, -np.inf)
    return np.where(returned, met, np.where(hit, np.log(dropout), 0.0)).sum(axis=1)


def posterior(true: Array, plate: Plate, bearings: Array, ranges: Array, noise: float, dropout: float) -> tuple:
    """Mean (3,) and covariance (3, 3) of the pose, given ranges (B,), NaN for none; the grid is laid about `true` (3,).

    The long face needs to return three beams.
    """
    got = np.flatnonzero(np.isfinite(ranges))
    near = slice(max(got[0] - 2 * _STEPS, 0), got[-1] + 2 * _STEPS + 1)
    bearings, ranges = bearings[near], ranges[near]
    x, y, phi = true
    cos, sin = np.cos(phi), np.sin(phi)
    across = cos * y - sin * x
    u_across, u_along = np.sin(bearings - phi), np.cos(bearings - phi)
    of_face = (across - np.copysign(plate.thickness / 2, across)) / u_across
    on_long = np.isfinite(ranges) & (np.abs(of_face - ranges_of(true[None], plate, bearings)[0]) < 1e-6)
    place = (of_face * u_along)[on_long] - cos * x - sin * y
    weight = 1 / (noise * u_across[on_long]) ** 2
    pivot = np.average(place, weights=weight)
    width_across, width_heading = weight.sum() ** -0.5, np.sum(weight * (place - pivot) ** 2) ** -0.5

    def costs(along: Array, across: Array, heading: Array) -> tuple[Array, Array]:
        a, d, t = (part.ravel() for part in np.meshgrid(along, across, phi + heading, indexing="ij"))
        poses = np.column_stack(
            [
                x + cos * pivot - sin * d + (a - pivot) * np.cos(t),
                y + sin * pivot + cos * d + (a - pivot) * np.sin(t),
                t,
            ]
        )
        cost = -log_likelihood(poses, plate, bearings, ranges, noise, dropout)
        return poses, cost.reshape(len(along), -1)

    reach = _STEPS * (bearings[1] - bearings[0]) * (np.hypot(x, y) + plate.length / 2)
    along = np.linspace(-1, 1, 301) * reach / np.abs(np.sin(phi - np.arctan2(y, x)))
    least = costs(along, _WIDTHS[::2] * width_across, _WIDTHS[::2] * width_heading)[1].min(axis=1)
    possible = np.flatnonzero(least < least.min() + _HOPELESS)
    first, last = along[max(possible[0] - 1, 0)], along[min(possible[-1] + 1, 300)]
    along = np.linspace(first, last, max(61, int((last - first) / (noise / 3))))
    poses, cost = costs(along, _WIDTHS * width_across, _WIDTHS * width_heading)
    share = np.exp(cost.min() - cost).ravel()
    share /= share.sum()
    mean = share @ poses
    return mean, np.einsum("g,gi,gj->ij", share, poses - mean, poses - mean)
