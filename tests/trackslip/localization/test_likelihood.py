from dataclasses import replace

import numpy as np
import pytest

from trackslip.localization.beams import Beams
from trackslip.localization.likelihood import PlateLikelihood, inverses
from trackslip.localization.scan import Plate, extract_plate

PLATE = Plate()


@pytest.mark.parametrize("turn", [True, False])
def test_gradient_by_finite_differences(turn, scan_rectangle):
    rng = np.random.default_rng(0)
    heading = np.radians([20.0, 55.0, 90.0, 130.0, 170.0])
    poses = np.column_stack([rng.uniform(1.5, 3.0, 5), rng.uniform(-1.0, 1.0, 5), heading])
    scan = scan_rectangle(poses, rng)
    beams = Beams.of(scan, extract_plate(scan, PLATE))
    likelihood = PlateLikelihood(PLATE, huber=3.0)
    offset = poses + rng.normal(size=poses.shape) * [0.004, 0.004, 0.01]
    fit = likelihood.evaluate(beams, offset, turn).in_lrf_frame()
    h = 1e-7
    for k in range(3):
        up, down = (likelihood.evaluate(beams, offset + sign * h * np.eye(3)[k], turn).cost for sign in (1, -1))
        expected = (up - down) / (2 * h) if turn or k < 2 else np.zeros(5)
        np.testing.assert_allclose(fit.gradient[:, k], expected, rtol=1e-4, atol=1e-2)


def test_hessian_is_the_information_of_the_gradient(scan_rectangle):
    """At the true pose the gradient's scatter over noise is its mean Hessian, which is Fisher's information."""
    rng = np.random.default_rng(1)
    pose = np.tile([2.0, 0.3, 1.2], (4000, 1))
    scan = scan_rectangle(pose, rng)
    beams = Beams.of(scan, extract_plate(scan, PLATE))
    fit = PlateLikelihood(PLATE, huber=100.0).evaluate(beams, pose, True).in_lrf_frame()
    ranges_only = fit.gradient - fit.gradient.mean(axis=0)  # the edges are the same in every scan
    scatter = ranges_only.T @ ranges_only / len(pose)
    no_edges = replace(beams, edges=replace(beams.edges, weight=0 * beams.edges.weight))
    information = PlateLikelihood(PLATE, huber=100.0).evaluate(no_edges, pose, True).in_lrf_frame().hessian.mean(axis=0)
    scale = np.sqrt(np.diag(information))
    np.testing.assert_allclose(scatter / np.outer(scale, scale), information / np.outer(scale, scale), atol=0.1)


def test_inverses():
    rng = np.random.default_rng(2)
    half = rng.normal(size=(50, 3, 3))
    matrices = half @ half.swapaxes(1, 2) + 0.1 * np.eye(3)
    found, regular = inverses(matrices)
    assert regular.all()
    np.testing.assert_allclose(found @ matrices, np.tile(np.eye(3), (50, 1, 1)), atol=1e-8)
    singular = np.array([np.ones((3, 3)), np.zeros((3, 3)), np.diag([1.0, 1.0, -1.0])])
    assert not inverses(singular)[1].any()
