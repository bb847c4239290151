"""The figure of slip against load."""

from dataclasses import replace

import numpy as np
import pytest
from identified import GEOMETRY

from experiments.measuring.steady_turns import InnerOuterSamples
from experiments.report.figures.slip_under_load import slip_under_load
from trackslip.identification.fitted import fit_law
from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import SIDES
from trackslip.slip.icr_load import IcrLoad

LAW = IcrLoad(0.04, GEOMETRY.half_gauge, 0.01, 0.1, 0.2)


@pytest.fixture(scope="module")
def samples():
    curvature = np.repeat([0.5, 1.0, 2.0], 6)
    omega = 3.0 * (1 + SIDES * GEOMETRY.half_gauge * curvature[:, None])
    load = np.column_stack([np.tile(np.linspace(-0.2, 0.2, 6), 3), np.zeros(18)])
    names = [f"run {k}" for k in range(18)]
    return SlipSamples.of(omega, LAW.under(load).twist(omega, GEOMETRY), GEOMETRY, names, load=load)


def test_points_lie_on_the_lines_of_the_law_that_made_them(samples):
    figure = slip_under_load(samples, fit_law("icr_load", samples, GEOMETRY, bootstraps=0), GEOMETRY)
    (axes,) = figure.axes
    points = axes.collections[0].get_offsets()
    straightest, _, tightest = axes.lines
    for rows, line in ((slice(6), straightest), (slice(12, 18), tightest)):
        np.testing.assert_allclose(np.interp(points[rows, 0], *line.get_data()), points[rows, 1], atol=1e-3)
    assert axes.get_xlabel().endswith("]")


def test_samples_without_loads_have_no_figure(samples):
    fitted = fit_law("icr_load", samples, GEOMETRY, bootstraps=0)
    assert slip_under_load(replace(samples, load=None), fitted, GEOMETRY) is None


def test_residuals_of_the_law_take_the_load_into_account(samples):
    np.testing.assert_allclose(InnerOuterSamples.of(samples, GEOMETRY).residual(LAW), 0.0, atol=1e-12)
