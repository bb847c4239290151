"""How often 95 % intervals cover the truth: with samples drawn from every law, and with grids scanned repeatedly."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from experiments.options.coverage import CoverageConfig
from experiments.parallel.executors import workers
from experiments.parallel.workers import deaf_children, processors
from sim.seeds import generator
from trackslip.identification.comparison import Comparison
from trackslip.identification.coverage import coverage, noise_coverage
from trackslip.identification.fitted import fit_law
from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import RobotGeometry
from trackslip.logs.runlog import RunLog
from trackslip.motion.methods import MOTION_METHODS
from trackslip.motion.steady import steady_part
from trackslip.slip.families import FAMILIES

RUN_LAW = "icr_radius"
"""The law that is fitted to runs scanned repeatedly."""
DRAWN_LAWS = tuple(name for name, family in FAMILIES.items() if family.names and not family.loaded)
"""The laws that samples are drawn from; on level ground, none is of slip under load."""
_MOTION = "bundle"  # takes ranges, to which noise can be added again and again

Shares = Mapping[str, float]
"""Parameter -> share of the repeats whose interval covers it [-]."""


@dataclass(frozen=True)
class RunCoverage:
    """Coverage with grids scanned repeatedly."""

    repeats: int
    law: str
    noise: Shares
    """With intervals from the measurement noise alone."""
    interval95: Shares
    """With the whole 95 % intervals."""
    bias_by_lean: Mapping[str, float]
    """How much larger each parameter is when fitted to the plate's true motion instead of the robot's [SI]."""

    @classmethod
    def of(
        cls, repeats: Sequence[tuple[SlipSamples, SlipSamples]], robot_truth: SlipSamples, geometry: RobotGeometry
    ) -> Self:
        """Evaluate repeats: measured samples of a grid, and the true samples of its plates.

        `robot_truth` are the true samples of the robots in the last repeat.
        """
        noise, whole = noise_coverage(RUN_LAW, repeats, geometry)
        design = repeats[0][0]
        plate, robot = (
            fit_law(RUN_LAW, replace(design, twist=true.twist, slip=true.slip), geometry, bootstraps=0).values
            for true in (repeats[-1][1], robot_truth)
        )
        return cls(len(repeats), RUN_LAW, noise, whole, {key: plate[key] - robot[key] for key in plate})


@dataclass(frozen=True)
class Coverage:
    """Coverage of the 95 % intervals."""

    repeats: int
    """Sets of samples drawn from each law."""
    laws: Mapping[str, Shares]
    """Law -> shares where the fits know the errors of measurement."""
    laws_errors_unknown: Mapping[str, Shares]
    """Law -> shares where they estimate the scatter from the samples."""
    runs: RunCoverage


def drawn_coverage(
    config: CoverageConfig,
    design: SlipSamples,
    values: Mapping[str, Mapping[str, float]],
    geometry: RobotGeometry,
    step: Callable[[float], None],
) -> tuple[dict[str, Shares], dict[str, Shares]]:
    """Shares for samples drawn from every law with its `values`, with known and with unknown errors of measurement.

    `step(1.0)` is called after each, twice per law.
    """
    shares: dict[bool, dict[str, Shares]] = {True: {}, False: {}}
    for name, known in itertools.product(values, (True, False)):
        rng = generator(config.seed, f"coverage {name} {known}")
        shares[known][name] = coverage(name, values[name], design, geometry, config.repeats, rng, known)
        step(1.0)
    return shares[True], shares[False]


def generating_values(name: str, fitted: Comparison) -> Mapping[str, float]:
    """Parameters to draw with: those of the grid, or for a two-sided law, which left turns leave open, the ICR's."""
    if name in fitted.laws:
        return fitted.laws[name].values
    both = fitted.laws["icr_radius"].values
    return {key: both[key.rsplit("_", 1)[0]] for key in FAMILIES[name].names}


def scanned_again(
    logs: Sequence[RunLog],
    geometry: RobotGeometry,
    config: CoverageConfig,
    repeats: int,
    step: Callable[[float], None],
) -> list[SlipSamples]:
    """Samples of runs whose true ranges get new noise in each repeat; `step(1.0)` is called after each run."""
    jobs = [(log, geometry, config.scanner.noise, config.seed, repeats) for log in logs]
    omega = np.array([steady_part(log, geometry).omega for log in logs])
    twists, covariances = [], []
    with workers("processes", config.threads or processors()) as pool:
        with deaf_children():
            results = pool.executor.map(_bundled, jobs)
        for twist, covariance in results:
            twists.append(twist)
            covariances.append(covariance)
            step(1.0)
    names = [log.run for log in logs]
    of_repeats = zip(np.stack(twists, axis=1), np.stack(covariances, axis=1), strict=True)
    return [SlipSamples.of(omega, twist, geometry, names, covariance) for twist, covariance in of_repeats]


def _bundled(job: tuple[RunLog, RobotGeometry, float, int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Twists (repeats, 2) and covariances (repeats, 2, 2) of one run, with new noise in each repeat."""
    log, geometry, noise, seed, repeats = job
    rng, part = generator(seed, f"coverage {log.run}"), steady_part(log, geometry)
    clean = part.log.scans
    assert clean is not None
    cluster = clean.cluster
    found = []
    for _ in range(repeats):
        ranges = np.where(cluster.hit, cluster.range + rng.normal(0.0, noise, cluster.range.shape), 1.0)
        scans = replace(clean, scan=replace(clean.scan, noise=noise), cluster=replace(cluster, range=ranges))
        found.append(MOTION_METHODS[_MOTION](replace(part.log, scans=scans), part.window))
    return np.array([one.twist for one in found]), np.array([one.covariance for one in found])
