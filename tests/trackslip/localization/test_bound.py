import numpy as np
import pytest
from bound import pose_bound, ratio_to_bound, scan_ratio_to_bound

from trackslip.localization.plate import PlateLocator
from trackslip.localization.scan import Plate, Scan
from trackslip.localization.view import viewing_angle

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


def test_information_by_finite_differences_of_another_ray_caster(scan_rectangle):
    rng = np.random.default_rng(0)
    poses = seen_at((15, 75), rng, 6)
    h = 1e-6
    jacobian = []
    for k in range(3):
        up, down = (scan_rectangle(poses + s * h * np.eye(3)[k], rng, noise=0.0).ranges for s in (1, -1))
        jacobian.append(np.nan_to_num((up - down) / (2 * h)))
    jacobian = np.stack(jacobian, axis=-1)  # (S, B, 3)

    def edge_bearings(pose):
        x, y, phi = pose
        corners = [
            (x + a * np.cos(phi) - b * np.sin(phi), y + a * np.sin(phi) + b * np.cos(phi))
            for a in (-0.3, 0.3)
            for b in (-0.02, 0.02)
        ]
        bearing = [np.arctan2(y, x) for x, y in corners]
        return np.array([min(bearing), max(bearing)])

    for pose, of_ranges, bound in zip(poses, jacobian, pose_bound(poses, PLATE, BEARINGS, 0.005), strict=True):
        of_edges = np.stack(
            [(edge_bearings(pose + h * d) - edge_bearings(pose - h * d)) / (2 * h) for d in np.eye(3)], axis=-1
        )
        information = of_ranges.T @ of_ranges / 0.005**2 + of_edges.T @ of_edges * 12 / STEP**2
        np.testing.assert_allclose(np.linalg.inv(bound), information, rtol=1e-4, atol=1e-4 * information.max())


def test_broadside_the_ranges_tell_across_and_the_edges_along():
    far = np.array([[8.0, 0.0, np.pi / 2]])
    bound = pose_bound(far, PLATE, BEARINGS, 0.005)[0]
    hits = np.sum(np.abs(np.tan(BEARINGS)) < 0.3 / 7.98)
    assert np.sqrt(bound[0, 0]) == pytest.approx(0.005 / np.sqrt(hits), rel=0.01)
    assert np.sqrt(bound[1, 1]) == pytest.approx(7.98 * STEP / np.sqrt(12 * 2), rel=0.01)
    # without noise in the ranges the edges still are all there is along the plate
    assert pose_bound(far, PLATE, BEARINGS, 1e-6)[0, 1, 1] == pytest.approx(bound[1, 1], rel=0.01)


def test_more_noise_raises_the_bound_and_what_is_out_of_sight_has_none():
    poses = seen_at((3, 90), np.random.default_rng(1), 50)
    variance = [np.einsum("sii->si", pose_bound(poses, PLATE, BEARINGS, noise)) for noise in (0.002, 0.005, 0.01)]
    assert np.all(variance[0] < variance[1])
    assert np.all(variance[1] < variance[2])
    assert np.isnan(pose_bound(np.array([[-3.0, 0.0, 1.0]]), PLATE, BEARINGS, 0.005)).all()
    assert np.isnan(pose_bound(poses, PLATE, BEARINGS, 0.0)).all()


def test_ratio_is_one_for_errors_drawn_from_the_bound():
    rng = np.random.default_rng(2)
    frame = Scan(BEARINGS, np.empty((0, 721)), 0.005, np.array([-1.5, -1.5, 0.7]))
    local = seen_at((5, 90), rng, 4000)
    bound = frame.covariance_to_world(pose_bound(local, PLATE, BEARINGS, 0.005))
    error = np.einsum("sij,sj->si", np.linalg.cholesky(bound), rng.normal(size=(4000, 3)))
    np.testing.assert_allclose(ratio_to_bound(error, bound), 1.0, atol=0.05)
    # nor do scans count that are edge-on, nor half turns
    edge_on = frame.to_world(seen_at((0, 2.9), rng, 100))
    poses = np.concatenate([frame.to_world(local), edge_on])
    estimated = np.concatenate([frame.to_world(local) + error + [0, 0, np.pi], edge_on + 1.0])
    np.testing.assert_allclose(scan_ratio_to_bound(estimated, poses, PLATE, frame), 1.0, atol=0.05)
    np.testing.assert_array_equal(viewing_angle(local) > np.radians(3), True)


@pytest.mark.parametrize("noise", [0.002, 0.010])
def test_plate_locator_is_within_a_tenth_of_the_bound(noise, scan_rectangle):
    rng = np.random.default_rng(3)
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
