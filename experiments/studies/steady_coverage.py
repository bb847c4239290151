"""Coverage study of steady samples: drawn from every law, and from grids scanned repeatedly."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from experiments.common.check import Check
from experiments.common.laws import symbol
from experiments.common.table import Table
from experiments.simulate.grid_runs import cells_of, drive_grid
from experiments.simulate.world import World
from experiments.studies.trials import Study, Trial, TrialOutcome, Values, plausible_shares, run_trials, share_interval
from sim.scanner.scanner import LaserScanner
from sim.seeds import generator
from trackslip.errors import counted
from trackslip.identification.comparison import SteadyComparison, compare_laws
from trackslip.identification.coverage import coverage, noise_coverage
from trackslip.identification.fitted import fit_law
from trackslip.identification.samples import SlipSamples, true_samples
from trackslip.kinematics import RobotGeometry
from trackslip.localization.scan import extract_plate
from trackslip.logs.runlog import RunLog
from trackslip.motion.methods import MOTION_METHODS
from trackslip.motion.steady import steady_part
from trackslip.slip.families import FAMILIES

if TYPE_CHECKING:
    from experiments.common.run import Run
    from experiments.coverage import Config

RUN_LAW = "icr_radius"
"""The law that is fitted to runs scanned repeatedly."""
DRAWN_LAWS = tuple(name for name, one in FAMILIES.items() if one.names and not one.loaded and not one.fast)
"""The laws that samples are drawn from: on level ground and in slow turns, none of slip under load or by speed."""
_MOTION = "bundle"  # takes ranges, to which noise can be added again and again


def steady_coverage(config: Config, world: World, run: Run) -> Study:
    """Drive grids without noise, repeat what is random, and count what the intervals cover."""
    geometry = world.robot.geometry
    with run.progress(f"a grid of {counted(len(cells_of(config)), 'run')}", config.duration) as report:
        logs = drive_grid(config.grid(0), world, report, kept=True)
    (design,) = scanned_again(logs, geometry, config.scanner, config.seed, 1)
    fitted = compare_laws(design, geometry)
    values = {name: generating_values(name, fitted) for name in DRAWN_LAWS}
    draw = partial(_drawn, values=values, design=design, geometry=geometry, repeats=config.repeats)
    draws = [Trial(f"{name} {known}", given=(name, known)) for known in (True, False) for name in values]
    shares = run_trials(run, draw, draws, "coverage {case}", world.about)
    known, unknown = ({name: shares[f"{name} {known}"][0].numbers for name in values} for known in (True, False))
    scan = partial(_scanned, config=config, design=design, geometry=geometry)
    grids = [Trial("grid", number) for number in range(config.grids)]
    scanned = run_trials(run, scan, grids, "coverage {case} {number}", world.about)["grid"]
    weights = [_repeats(config, number) for number in range(config.grids)]

    def mean(kind: str) -> dict[str, float]:
        found = {name: [one.numbers[kind][name] for one in scanned] for name in FAMILIES[RUN_LAW].names}
        return {name: float(np.average(numbers, weights=weights)) for name, numbers in found.items()}

    noise, whole, lean = mean("noise"), mean("interval95"), mean("lean")
    runs = {"repeats": config.run_repeats, "law": RUN_LAW, "noise": noise, "interval95": whole, "bias_by_lean": lean}
    checks = [
        *(
            check
            for law in values
            for what, shares in (("known", known), ("unknown", unknown))
            for check in _checks(f"{law}, errors {what}", shares[law], config.repeats)
        ),
        *_checks("grids, noise alone", noise, config.run_repeats, 0.94, 0.96),
        *_checks("grids, 95 % interval", whole, config.run_repeats, 0.95, 1.0),
    ]
    bias = " and ".join(f"{symbol(RUN_LAW, key)} by {value:+.6f}" for key, value in lean.items())
    shown: list[Table | str] = [
        _law_table(values, known, unknown, config.repeats),
        _run_table(noise, whole, config.run_repeats),
        f"The true motion here is the plate's, which leans outwards with the robot. This changes {bias}.",
        *(f"does not hold: {check.to_json()['name']}" for check in checks if not check.holds),
    ]
    summary = {"repeats": config.repeats, "laws": known, "laws_errors_unknown": unknown, "runs": runs}
    return Study(summary, shown, checks)


def _checks(case: str, shares: Values, repeats: int, low: float = 0.94, high: float = 0.98) -> Iterator[Check]:
    """Shares near 95 %; intervals that allow for errors of the law may cover more often."""
    bound = plausible_shares(low, high, repeats)
    source = f"what a probability from {low:g} to {high:g} gives in {repeats} repeats, but once in a thousand studies"
    for name, share in shares.items():
        yield Check(case, f"coverage of {name}", share, bound, source=source)


def _law_table(
    values: Mapping[str, Values], known: Mapping[str, Values], unknown: Mapping[str, Values], repeats: int
) -> Table:
    rows = []
    for law, drawn in values.items():
        for k, (name, value) in enumerate(drawn.items()):
            letter = f"{symbol(law, name)} [{FAMILIES[law].parameters[name].unit or '-'}]"
            both = (_share(shares[law][name], repeats) for shares in (known, unknown))
            rows.append((law if k == 0 else "", letter, f"{value:+.4f}", *both))
    title = f"Share of {repeats} repeats whose 95 % interval covers the parameter"
    return Table(title, ("law", "parameter", "drawn from", "errors known", "errors unknown"), rows, "lr")


def _run_table(noise: Values, whole: Values, repeats: int) -> Table:
    rows = [(symbol(RUN_LAW, name), *(_share(one[name], repeats) for one in (noise, whole))) for name in noise]
    title = f"Share of {repeats} grids whose {RUN_LAW} interval covers the value fitted to the true motion"
    return Table(title, ("parameter", "noise alone", "95 % interval"), rows)


def _share(share: float, repeats: int) -> str:
    low, high = share_interval(round(share * repeats), repeats)
    return f"{share:.3f} ({low:.2f} to {high:.2f})"


def _drawn(
    trial: Trial,
    rng: np.random.Generator,
    values: Mapping[str, Values],
    design: SlipSamples,
    geometry: RobotGeometry,
    repeats: int,
) -> TrialOutcome:
    """Shares of the repeats that cover each parameter of a law."""
    name, known = trial.given
    return TrialOutcome(numbers=coverage(name, values[name], design, geometry, repeats, rng, known))


def _scanned(
    trial: Trial, rng: np.random.Generator, config: Config, design: SlipSamples, geometry: RobotGeometry
) -> TrialOutcome:
    """Drive a grid, scan it again and again, and compare the law with the one fitted to the true motion."""
    grid = replace(config.grid(trial.number), threads=1)
    logs = drive_grid(grid, World.of(grid), kept=True)
    plate, robot = true_samples(logs, geometry, of_plate=True), true_samples(logs, geometry)
    repeats = _repeats(config, trial.number)
    again = scanned_again(logs, geometry, config.scanner, int(rng.integers(2**62)), repeats)
    noise, whole = noise_coverage(RUN_LAW, [(samples, plate) for samples in again], geometry)
    of_plate, of_robot = (
        fit_law(RUN_LAW, replace(design, twist=true.twist, slip=true.slip), geometry, bootstraps=0).values
        for true in (plate, robot)
    )
    lean = {name: of_plate[name] - of_robot[name] for name in of_plate}
    return TrialOutcome(numbers={"noise": noise, "interval95": whole, "lean": lean})


def _repeats(config: Config, number: int) -> int:
    """Number of times that a grid is scanned."""
    return len(range(number, config.run_repeats, config.grids))


def generating_values(name: str, fitted: SteadyComparison) -> Values:
    """Parameters to draw with: those of the grid, or for a two-sided law, which left turns leave open, the ICR's."""
    if name in fitted.laws:
        return fitted.laws[name].values
    both = fitted.laws[RUN_LAW].values
    return {key: both.get(key, both.get(key.rsplit("_", 1)[0], 0.0)) for key in FAMILIES[name].names}


def scanned_again(
    logs: Sequence[RunLog], geometry: RobotGeometry, scanner: LaserScanner, seed: int, repeats: int
) -> list[SlipSamples]:
    """Samples of runs whose true ranges a scanner measures anew in each repeat."""
    omega = np.array([steady_part(log, geometry).omega for log in logs])
    found = [_twists(log, geometry, scanner, generator(seed, f"coverage {log.run}"), repeats) for log in logs]
    names = [log.run for log in logs]
    by_repeat = (np.stack(arrays, axis=1) for arrays in zip(*found, strict=True))
    return [SlipSamples.of(omega, twist, geometry, names, errors) for twist, errors in zip(*by_repeat, strict=True)]


def _twists(
    log: RunLog, geometry: RobotGeometry, scanner: LaserScanner, rng: np.random.Generator, repeats: int
) -> tuple[np.ndarray, np.ndarray]:
    """Twists (repeats, 2) of a run and their covariances (repeats, 2, 2), with its true ranges measured anew."""
    part = steady_part(log, geometry)
    true = part.log.scans
    assert true is not None
    assert true.full is not None
    beams = np.flatnonzero(np.isfinite(true.full).any(axis=0))  # the others see nothing
    beams = np.arange(beams[0], beams[-1] + 1)
    ranges, bearings, found = true.full[:, beams].astype(float), scanner.bearings[beams], []
    for _ in range(repeats):
        scan = replace(scanner.scan(scanner.measure(ranges, rng), true.scan.mount), bearings=bearings)
        cluster = extract_plate(scan, true.plate, scan.from_world(part.log.pose))
        scans = replace(true, scan=replace(scan, ranges=scan.ranges[:0]), cluster=cluster, full=None)
        found.append(MOTION_METHODS[_MOTION](replace(part.log, scans=scans), part.window))
    return np.array([one.twist for one in found]), np.array([one.covariance for one in found])
