"""Steady runs of a real robot on tracks: laws predict left-out radii at least as well as plain least squares does."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from trackslip.identification.source import ReadOptions, read_source
from trackslip.identification.steady_comparison import compare_laws, folds
from trackslip.laws.icr import ConstantIcr
from trackslip.metrics import rms

LOG = Path(__file__).parents[3] / "examples/logs/maxxii.csv"


@pytest.fixture(scope="module")
def source():
    return read_source(LOG, ReadOptions(half_gauge=0.303, sprocket_radius=0.0856))


@pytest.fixture(scope="module")
def comparison(source):
    return compare_laws(source.sampling.samples, source.geometry)


def plain_left_out(samples, geometry):
    """Twists (n, 2) by D and ε of unweighted least squares on the measured twists, fitted without the runs' radii."""

    def missed(values, rows):
        law = ConstantIcr(values[0], geometry.half_gauge, values[1])
        return (law.twist(samples.omega[rows], geometry) - samples.twist[rows]).ravel()

    predicted = np.empty_like(samples.twist)
    radii = folds(samples.by_command(geometry))
    for radius in range(radii.max() + 1):
        d, epsilon = least_squares(missed, [0.1, 0.0], args=(radii != radius,)).x
        out = radii == radius
        predicted[out] = ConstantIcr(d, geometry.half_gauge, epsilon).twist(samples.omega[out], geometry)
    return predicted


def test_the_best_law_turns_as_predicted_at_left_out_radii(source, comparison):
    samples = source.sampling.samples
    plain = rms(plain_left_out(samples, source.geometry)[:, 1] - samples.twist[:, 1])
    assert comparison.validation[comparison.best].yaw_rate <= plain
    assert comparison.validation["icr_radius"].yaw_rate <= plain  # the same two numbers, otherwise weighted
    assert plain < comparison.validation["none"].yaw_rate / 2
