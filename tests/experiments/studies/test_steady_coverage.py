"""Coverage of grids: errors of repeated scans, and the command."""

import numpy as np
import pytest

from experiments.coverage import Config
from experiments.simulate.grid_runs import drive_grid
from experiments.simulate.world import World
from experiments.studies.steady_coverage import scanned_again
from sim.scanner.scanner import LaserScanner
from trackslip.slip.families import FAMILIES


@pytest.fixture(scope="module")
def grid():
    """Logs of a grid without scanner errors, and the robot's geometry."""
    options = Config(radii=(0.8, 1.5), speeds=(0.1, 0.2), duration=8.0).grid(0)
    world = World.of(options)
    return drive_grid(options, world, kept=True), world.robot.geometry


def scatter(grid, **options):
    """Variances (4, 2) of the runs' twists, as stated and as they are, in 40 repeats."""
    again = scanned_again(*grid, LaserScanner(**options), seed=0, repeats=40)
    stated = np.mean([np.diagonal(one.covariance, axis1=1, axis2=2) for one in again], axis=0)
    return stated, np.var([one.twist for one in again], axis=0, ddof=1)


@pytest.mark.parametrize(
    ("options", "factor"),
    [
        ({"noise": 0.01}, 4.0),
        ({"dropout": 0.5}, 2.0),  # half the returns
        ({"quantisation": 0.02}, 1 + (0.02 / 0.005) ** 2 / 12),
    ],
)
def test_all_errors_of_the_scanner_count(grid, options, factor):
    (plain, _), (stated, found) = scatter(grid), scatter(grid, **options)
    assert np.mean(stated / plain) == pytest.approx(factor, rel=0.35)  # edges of the plate tell something as well
    assert np.mean(found / stated) < 1.0 + 4 * np.sqrt(2 / 39 / stated.size)  # the statement may be cautious


def test_a_bias_shifts_no_twist(grid):
    biased, plain = (scanned_again(*grid, LaserScanner(range_bias=bias), 0, 1)[0] for bias in (0.005, 0.0))
    np.testing.assert_allclose(biased.twist, plain.twist, rtol=0.01)
    assert not np.array_equal(biased.twist, plain.twist)


SMALL = ("--radii", "0.6", "1.2", "2.4", "--speeds", "0.1", "0.2", "--duration", "8", "--repeats", "40")


def test_every_parameter_of_every_law_has_its_share(trackslip):
    result = trackslip("coverage", *SMALL, "--run-repeats", "6", "--grids", "2", "--threads", "1")
    assert result.summary["repeats"] == 40
    for key in ("laws", "laws_errors_unknown"):
        laws = result.summary[key]
        assert set(laws) == {name for name in FAMILIES if FAMILIES[name].names} - {"icr_load", "centrifugal"}
        for name, shares in laws.items():
            assert set(shares) == set(FAMILIES[name].names)
            assert all(0.6 < share <= 1 for share in shares.values())
    runs = result.summary["runs"]
    assert runs["repeats"] == 6
    assert set(runs["noise"]) == {"offset", "radius_error"}
    assert 0 < runs["bias_by_lean"]["offset"] < 1e-4
    assert "noise alone" in result.printed


@pytest.mark.slow
def test_drives_are_checked(trackslip):
    result = trackslip("coverage", "--drives", "--drive-repeats", "2", "--threads", "2")
    checks = result.summary["checks"]
    assert all(set(check) == {"name", "value", "expected", "bound", "unit", "holds", "source"} for check in checks)
    assert [check["value"] for check in checks if check["name"].endswith("fits without D or epsilon")] == [0.0] * 8
    errors = [check for check in checks if "rms error of offset" in check["name"]]
    assert len(errors) == 8
    assert all(check["unit"] == "m" and check["value"] < 0.005 for check in errors)
    assert result.summary["simulated"]["drives"] == 2
    assert "of the same speeds" in result.printed
