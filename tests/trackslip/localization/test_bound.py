import numpy as np
from bound import pose_bound, ratio_to_bound

from trackslip.localization.plate import PlateLocator
from trackslip.localization.scan import Plate

PLATE = Plate()
STEP = np.radians(0.25)
BEARINGS = np.arange(-360, 361) * STEP


def seen_at(angle, rng, n, distance=(1.5, 6.0)):
    """Poses (n, 3) in the LRF's frame, seen at angles (low, high) [deg] from edge-on, and the other way round."""
    off = np.radians(rng.uniform(*angle, n)) * rng.choice([-1, 1], n)
    distance, bearing = rng.uniform(*distance, n), rng.uniform(-1.0, 1.0, n)
    return np.column_stack([distance * np.cos(bearing), distance * np.sin(bearing), bearing + off])


def errors(estimate, poses):
    error = estimate.pose - poses
    error[:, 2] = (error[:, 2] + np.pi / 2) % np.pi - np.pi / 2
    return error


def test_plate_locator_is_within_a_tenth_of_the_bound(scan_rectangle):
    rng, noise = np.random.default_rng(3), 0.010
    everywhere = []
    for angle, heading in (((3, 10), 1.25), ((10, 30), 1.1), ((30, 60), 1.1), ((60, 90), 1.1)):
        poses = seen_at(angle, rng, 1500)
        estimate = PlateLocator().locate(scan_rectangle(poses, rng, noise=noise))
        good = estimate.valid
        assert good.mean() > 0.99
        error = errors(estimate, poses)[good]
        bound = pose_bound(poses[good], PLATE, BEARINGS, noise)
        ratio = ratio_to_bound(error, bound)
        assert ratio[:2].max() < 1.1, (angle, ratio)
        # of a plate that returns three or four beams, 3 to 4 degrees from edge-on, the heading isn't told to the bound
        assert ratio[2] < heading, (angle, ratio)
        everywhere.append((error, bound))
        deviation = error / np.sqrt(np.einsum("sii->si", estimate.covariance[good]))
        spread = np.sqrt(np.mean(deviation**2, axis=0))
        assert (spread > 0.8).all()
        assert (spread < [1.15, 1.15, 1.4 if angle[0] < 10 else 1.15]).all()
    error, bound = (np.concatenate(parts) for parts in zip(*everywhere, strict=True))
    assert ratio_to_bound(error, bound).max() < 1.1
