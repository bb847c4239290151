"""How often intervals of laws cover the truth: for samples drawn from every law, and for grids scanned repeatedly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.driving.grid_runs import cells_of, drive_grid
from experiments.driving.world import World
from experiments.measuring.check import Check
from experiments.studies.trials import Outcome, Trial, Values, plausible_shares, run_trials
from sim.seeds import generator
from trackslip.identification.comparison import Comparison, compare_laws
from trackslip.identification.coverage import coverage, noise_coverage
from trackslip.identification.fitted import fit_law
from trackslip.identification.samples import SlipSamples
from trackslip.identification.true_samples import true_samples
from trackslip.kinematics import RobotGeometry
from trackslip.logs.runlog import RunLog
from trackslip.motion.methods import MOTION_METHODS
from trackslip.motion.steady import steady_part
from trackslip.slip.families import FAMILIES

if TYPE_CHECKING:
    from experiments.commands.coverage import Config
    from experiments.run import Run

RUN_LAW = "icr_radius"
"""The law that is fitted to runs scanned repeatedly."""
DRAWN_LAWS = tuple(name for name, family in FAMILIES.items() if family.names and not family.loaded)
"""The laws that samples are drawn from; on level ground, none is of slip under load."""
_MOTION = "bundle"  # takes ranges, to which noise can be added again and again


@dataclass(frozen=True)
class RunCoverage:
    """Coverage with grids scanned repeatedly."""

    repeats: int
    law: str
    noise: Values
    """Share of the repeats with intervals from the measurement noise alone that cover each parameter [-]."""
    interval95: Values
    """The same with the whole 95 % intervals."""
    bias_by_lean: Values
    """How much larger each parameter is when fitted to the plate's true motion instead of the robot's [SI]."""


@dataclass(frozen=True)
class SteadyCoverage:
    """Coverage of the 95 % intervals of laws fitted to steady samples."""

    repeats: int
    """Sets of samples drawn from each law."""
    values: Mapping[str, Values]
    """Law -> the parameters that samples are drawn with."""
    laws: Mapping[str, Values]
    """Law -> share of the repeats that cover each parameter where the fits know the errors of measurement [-]."""
    laws_errors_unknown: Mapping[str, Values]
    """The same where they estimate the scatter from the samples."""
    runs: RunCoverage

    @property
    def checks(self) -> list[Check]:
        """Shares near 95 %; intervals that allow for errors of the law may cover more often."""
        runs = self.runs
        found: list[Check] = []

        def check(case: str, shares: Values, repeats: int, low: float, high: float) -> None:
            bound = plausible_shares(low, high, repeats)
            found.extend(Check(case, f"coverage of {name}", share, bound, "1") for name, share in shares.items())

        for law in self.laws:
            check(f"{law}, errors known", self.laws[law], self.repeats, 0.94, 0.98)
            check(f"{law}, errors unknown", self.laws_errors_unknown[law], self.repeats, 0.94, 0.98)
        check("grids, noise alone", runs.noise, runs.repeats, 0.94, 0.96)
        check("grids, 95 % interval", runs.interval95, runs.repeats, 0.95, 1.0)
        return found

    def to_json(self) -> dict[str, Any]:
        """The content of summary.json."""
        content = {name: value for name, value in vars(self).items() if name != "values"}
        return content | {"checks": [check.to_json() for check in self.checks]}


def steady_coverage(config: Config, world: World, run: Run) -> SteadyCoverage:
    """Drive grids without noise, repeat what is random, and count what the intervals cover."""
    geometry = world.robot.geometry
    with run.progress(f"a grid of {len(cells_of(config))} runs", config.duration) as report:
        logs = drive_grid(config.grid(0), world, report)
    (design,) = scanned_again(logs, geometry, config.scanner.noise, config.seed, 1)
    fitted = compare_laws(design, geometry)
    values = {name: generating_values(name, fitted) for name in DRAWN_LAWS}
    draw = partial(_drawn, values=values, design=design, geometry=geometry, repeats=config.repeats)
    draws = [Trial(f"{name} {known}", given=(name, known)) for known in (True, False) for name in values]
    shares = run_trials(run, draw, draws, "coverage {case}", world.about)
    laws = {known: {name: shares[f"{name} {known}"][0].numbers for name in values} for known in (True, False)}
    scan = partial(_scanned, config=config, design=design, geometry=geometry)
    grids = [Trial("grid", number) for number in range(config.grids)]
    scanned = run_trials(run, scan, grids, "coverage {case} {number}", world.about)["grid"]
    weights = [_repeats(config, number) for number in range(config.grids)]

    def mean(kind: str) -> Values:
        numbers = {name: [one.numbers[f"{kind} {name}"] for one in scanned] for name in FAMILIES[RUN_LAW].names}
        return {name: float(np.average(found, weights=weights)) for name, found in numbers.items()}

    runs = RunCoverage(config.run_repeats, RUN_LAW, mean("noise"), mean("interval95"), mean("lean"))
    return SteadyCoverage(config.repeats, values, laws[True], laws[False], runs)


def _drawn(
    trial: Trial,
    rng: np.random.Generator,
    values: Mapping[str, Values],
    design: SlipSamples,
    geometry: RobotGeometry,
    repeats: int,
) -> Outcome:
    """Shares of the repeats that cover each parameter of a law."""
    name, known = trial.given
    return Outcome(numbers=coverage(name, values[name], design, geometry, repeats, rng, known))


def _scanned(
    trial: Trial, rng: np.random.Generator, config: Config, design: SlipSamples, geometry: RobotGeometry
) -> Outcome:
    """Drive a grid, scan it again and again, and compare the law with the one fitted to the true motion."""
    grid = replace(config.grid(trial.number), threads=1)
    logs = drive_grid(grid, World.of(grid))
    plate, robot = true_samples(logs, geometry, of_plate=True), true_samples(logs, geometry)
    repeats = _repeats(config, trial.number)
    again = scanned_again(logs, geometry, config.scanner.noise, int(rng.integers(2**62)), repeats)
    noise, whole = noise_coverage(RUN_LAW, [(samples, plate) for samples in again], geometry)
    of_plate, of_robot = (
        fit_law(RUN_LAW, replace(design, twist=true.twist, slip=true.slip), geometry, bootstraps=0).values
        for true in (plate, robot)
    )
    kinds = {"noise": noise, "interval95": whole, "lean": {name: of_plate[name] - of_robot[name] for name in of_plate}}
    return Outcome(numbers={f"{kind} {name}": value for kind, found in kinds.items() for name, value in found.items()})


def _repeats(config: Config, number: int) -> int:
    """How often a grid is scanned."""
    return len(range(number, config.run_repeats, config.grids))


def generating_values(name: str, fitted: Comparison) -> Values:
    """Parameters to draw with: those of the grid, or for a two-sided law, which left turns leave open, the ICR's."""
    if name in fitted.laws:
        return fitted.laws[name].values
    both = fitted.laws[RUN_LAW].values
    return {key: both[key.rsplit("_", 1)[0]] for key in FAMILIES[name].names}


def scanned_again(
    logs: Sequence[RunLog], geometry: RobotGeometry, noise: float, seed: int, repeats: int
) -> list[SlipSamples]:
    """Samples of runs whose true ranges get new noise [m] in each repeat."""
    omega = np.array([steady_part(log, geometry).omega for log in logs])
    found = [_twists(log, geometry, noise, generator(seed, f"coverage {log.run}"), repeats) for log in logs]
    names = [log.run for log in logs]
    by_repeat = (np.stack(arrays, axis=1) for arrays in zip(*found, strict=True))
    return [SlipSamples.of(omega, twist, geometry, names, errors) for twist, errors in zip(*by_repeat, strict=True)]


def _twists(
    log: RunLog, geometry: RobotGeometry, noise: float, rng: np.random.Generator, repeats: int
) -> tuple[np.ndarray, np.ndarray]:
    """Twists (repeats, 2) of a run and their covariances (repeats, 2, 2), with new noise in each repeat."""
    part = steady_part(log, geometry)
    clean = part.log.scans
    assert clean is not None
    cluster = clean.cluster
    found = []
    for _ in range(repeats):
        ranges = np.where(cluster.hit, cluster.range + rng.normal(0.0, noise, cluster.range.shape), 1.0)
        scans = replace(clean, scan=replace(clean.scan, noise=noise), cluster=replace(cluster, range=ranges))
        found.append(MOTION_METHODS[_MOTION](replace(part.log, scans=scans), part.window))
    return np.array([one.twist for one in found]), np.array([one.covariance for one in found])
