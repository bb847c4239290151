"""Steady samples: do the 95 % intervals of laws cover the truth in 95 % of many repeats?

`pytest -m slow tests/validation/test_steady_coverage.py -s` prints the tables of
docs/validation.md, in minutes.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.stats import chi2
from trials import LAW, outcomes, plausible_shares, report, share_text

from experiments.common.check import Check
from experiments.common.table import Table
from experiments.simulate.grid_options import GridConfig
from experiments.simulate.grid_runs import drive_grid
from experiments.simulate.world import World
from sim.common.seeds import generator
from trackslip.identification.samples import SlipSamples, true_samples, usable_samples
from trackslip.identification.steady import fit_law
from trackslip.kinematics import RobotGeometry
from trackslip.laws.families import FAMILIES
from trackslip.laws.icr import DiffDrive
from trackslip.logs.runlog import RunLog
from trackslip.views.symbols import symbol

pytestmark = pytest.mark.slow
REPEATS = 100
"""Sets of samples drawn from each law."""
GRIDS = 40
"""Grids of the paper's runs, from new points of the circles, that are driven and fitted."""
DRAWN_LAWS = tuple(
    n
    for n, law in FAMILIES.items()
    if law.names and law.of_runs and not law.loaded and not law.fast
)
"""The laws that samples are drawn from: on level ground and in slow turns, none of slip under load
or by speed.
"""

Values = Mapping[str, float]


def test_samples_drawn_from_each_law():
    """Laws fitted to samples with the errors of the paper's grid, which the fits know, or estimate
    from the scatter.
    """
    design, geometry = driven(GridConfig(seed=0, threads=0, random_phase=True))
    values = {name: generating_values(name, design, geometry) for name in DRAWN_LAWS}
    trials = [(name, values[name], known) for name in DRAWN_LAWS for known in (True, False)]
    found = outcomes(partial(share_covered, design=design, geometry=geometry), trials)
    shares = {(name, known): share for (name, _, known), share in zip(trials, found, strict=True)}
    rows = [
        (
            name,
            symbol(name, key),
            f"{value:+.4f}",
            *(share_text(shares[name, known][key], REPEATS) for known in (True, False)),
        )
        for name, of_law in values.items()
        for key, value in of_law.items()
    ]
    title = f"Share of {REPEATS} repeats whose 95 % interval covers the parameter"
    print()
    Table(
        title, ("law", "parameter", "drawn from", "errors known", "errors unknown"), rows, "lr"
    ).print()
    bound = plausible_shares(0.94, 0.98, REPEATS)
    report(
        "Shares that intervals of 94 to 98 % can have by chance",
        [
            Check(
                f"{name}, errors {'known' if known else 'unknown'}",
                f"coverage of {key}",
                share,
                bound,
            )
            for (name, known), of_law in shares.items()
            for key, share in of_law.items()
        ],
    )


def test_grids_driven_again_and_again():
    """Each run's stated error covers the plate's true motion, and a law's interval the law fitted
    to that motion.

    Either may cover more often: statements may be cautious, and intervals allow for what the law
    can't describe.
    """
    runs, laws = (
        np.mean(shares, axis=0) for shares in zip(*outcomes(grid_covers, range(GRIDS)), strict=True)
    )
    count = GRIDS * len(runs)
    checks = [
        Check(
            f"{count} runs",
            "coverage of v and w",
            float(np.mean(runs)),
            plausible_shares(0.94, 1.0, count),
        ),
        *(
            Check(
                f"{GRIDS} grids",
                f"coverage of {name}",
                float(share),
                plausible_shares(0.95, 1.0, GRIDS),
            )
            for name, share in zip(FAMILIES[LAW].names, laws, strict=True)
        ),
    ]
    report("Shares of 95 % regions that cover the plate's true motion", checks)


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("aside", [0.0, 0.01])
def test_samples_of_a_differential_drive(known, aside):
    """Straights, turns in place and arcs to both sides, seen by a sensor `aside` to the left."""
    geometry, law = RobotGeometry(0.168, 0.06), DiffDrive(0.045, 0.012, -0.006, 0.168)
    path = [(0.2, 0.0), (0.3, 0.0), (0.0, 0.5), (0.0, -0.5), (0.2, 0.3), (0.2, -0.3), (-0.2, 0.1)]
    path += [(0.25, 0.05), (0.3, -0.1), (0.15, 0.4), (0.15, -0.4), (-0.2, -0.2), (0.1, 0.5)]
    twist = np.array(path)
    omega = law.sprocket_speeds(twist, geometry)
    seen = twist - aside * twist[:, 1:] * [1.0, 0.0]
    belts = geometry.sprocket_radius * np.abs(omega).max(axis=1)
    size = 0.005 * belts[:, None] * [1.0, 1 / geometry.half_gauge]
    covariance = size[:, :, None] ** 2 * np.eye(2) if known else None
    rng = generator(0, f"differential drive {known} {aside}")
    covered = dict.fromkeys(("offset", "radius_error_left", "radius_error_right"), 0)
    repeats = 400
    names = [f"row {k}" for k in range(len(twist))]
    for _ in range(repeats):
        noisy = seen + size * rng.standard_normal(seen.shape)
        samples = SlipSamples.of(omega, noisy, geometry, names, covariance)
        fit = fit_law("diff_drive", samples, geometry)
        for name in covered:
            low, high = fit.interval95[name]
            covered[name] += low <= getattr(law, name) <= high
    print({name: count / repeats for name, count in covered.items()})
    low, high = plausible_shares(0.92, 0.98, repeats)
    assert all(low <= count / repeats <= high for count in covered.values())


def driven(grid: GridConfig) -> tuple[SlipSamples, RobotGeometry]:
    world = World.of(grid)
    return usable_samples(
        drive_grid(grid, world), world.robot.geometry
    ).samples, world.robot.geometry


def generating_values(name: str, design: SlipSamples, geometry: RobotGeometry) -> dict[str, float]:
    """Parameters to draw with: those of the grid or, for laws of two sides, which left turns leave
    open, LAW's.
    """
    if not FAMILIES[name].two_sided:
        return fit_law(name, design, geometry).values
    both = fit_law(LAW, design, geometry).values
    return {
        key: both.get(key.removesuffix("_left").removesuffix("_right"), 0.0)
        for key in FAMILIES[name].names
    }


def share_covered(
    trial: tuple[str, Values, bool], design: SlipSamples, geometry: RobotGeometry
) -> dict[str, float]:
    """Share of the repeats in which the 95 % interval of each parameter of a law contains its
    value.

    Each repeat draws the twists of a robot that follows the law, at the sprocket speeds of the
    design and with its errors of twists. The fits know the covariances of these errors, or estimate
    the scatter from the samples.
    """
    name, values, known = trial
    rng = generator(0, f"coverage {name} {known}")
    root = np.linalg.cholesky(design.covariance)
    errors = np.einsum("nij,mnj->mni", root, rng.standard_normal((REPEATS, len(design), 2)))
    covered = dict.fromkeys(values, 0)
    for twist in FAMILIES[name].build(values, geometry).twist(design.omega, geometry) + errors:
        samples = SlipSamples.of(
            design.omega, twist, geometry, design.run, design.covariance if known else None
        )
        for key, (low, high) in fit_law(name, samples, geometry).interval95.items():
            covered[key] += low <= values[key] <= high
    return {key: count / REPEATS for key, count in covered.items()}


def of_plate(log: RunLog) -> RunLog:
    """A run whose true motion is the scanned plate's, which leans outwards with the robot: on a
    wider circle.
    """
    twist = log.truth.twist.copy()
    twist[:, 0] -= twist[:, 2] * log.truth.lean
    return replace(log, truth=replace(log.truth, twist=twist))


def grid_covers(number: int) -> tuple[list[bool], list[bool]]:
    """Whether the 95 % ellipse of each run covers its true twist, and the interval each parameter
    fitted to these.
    """
    grid = GridConfig(seed=number, threads=1, random_phase=True)
    world = World.of(grid)
    geometry, logs = world.robot.geometry, drive_grid(grid, world)
    measured = usable_samples(logs, geometry).samples
    true = replace(measured, twist=true_samples([of_plate(log) for log in logs], geometry).twist)
    errors = (measured.twist - true.twist)[..., None]
    squares = (errors.mT @ np.linalg.solve(measured.covariance, errors)).ravel()
    interval = fit_law(LAW, measured, geometry).interval95
    goal = fit_law(LAW, true, geometry).values
    return list(squares < chi2.ppf(0.95, 2)), [
        interval[name][0] <= aim <= interval[name][1] for name, aim in goal.items()
    ]
