from dataclasses import replace

import numpy as np

from trackslip.localization.beams import PlateBeams
from trackslip.localization.likelihood import PlateLikelihood
from trackslip.localization.scan import Plate, extract_plate

PLATE = Plate()


def off_the_plate(scan_rectangle):
    """Poses (5, 3) that are slightly wrong, and the beams of the scans."""
    rng = np.random.default_rng(0)
    heading = np.radians([20.0, 55.0, 90.0, 130.0, 170.0])
    poses = np.column_stack([rng.uniform(1.5, 3.0, 5), rng.uniform(-1.0, 1.0, 5), heading])
    scan = scan_rectangle(poses, rng)
    beams = PlateBeams.of(scan, extract_plate(scan, PLATE))
    return poses + rng.normal(size=poses.shape) * [0.004, 0.004, 0.01], beams


def test_gradient_by_finite_differences(scan_rectangle):
    pose, beams = off_the_plate(scan_rectangle)
    likelihood = PlateLikelihood(PLATE, huber=3.0)
    gradient = likelihood.evaluate(beams, pose).in_lrf_frame().gradient
    h = 1e-7
    for k in range(3):
        up, down = (likelihood.evaluate(beams, pose + sign * h * np.eye(3)[k]).cost for sign in (1, -1))
        np.testing.assert_allclose(gradient[:, k], (up - down) / (2 * h), rtol=1e-4, atol=1e-2)


def test_hessian_is_the_information_of_the_gradient(scan_rectangle):
    """At the true pose the gradient's scatter over noise is its mean Hessian, which is Fisher's information."""
    rng = np.random.default_rng(1)
    pose = np.tile([2.0, 0.3, 1.2], (4000, 1))
    scan = scan_rectangle(pose, rng)
    beams = PlateBeams.of(scan, extract_plate(scan, PLATE))
    fit = PlateLikelihood(PLATE, huber=100.0).evaluate(beams, pose).in_lrf_frame()
    ranges_only = fit.gradient - fit.gradient.mean(axis=0)  # the edges are the same in every scan
    scatter = ranges_only.T @ ranges_only / len(pose)
    no_edges = replace(beams, edges=replace(beams.edges, weight=0 * beams.edges.weight))
    information = PlateLikelihood(PLATE, huber=100.0).evaluate(no_edges, pose).in_lrf_frame().hessian.mean(axis=0)
    scale = np.sqrt(np.diag(information))
    np.testing.assert_allclose(scatter / np.outer(scale, scale), information / np.outer(scale, scale), atol=0.1)
