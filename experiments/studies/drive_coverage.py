"""Coverage study of whole drives: errors and intervals of laws over drives whose law is known."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import cycle, islice
from math import radians
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from experiments.common.check import Check, checks_table
from experiments.common.formats import number
from experiments.common.table import Table
from experiments.simulate.drives import KnownDrive, driven_by_law, driven_in_mujoco
from experiments.simulate.world import World
from experiments.studies.trials import (
    Estimate,
    Estimates,
    Study,
    Trial,
    TrialOutcome,
    Values,
    failures_of,
    rms_interval,
    run_trials,
    sampling_error,
    share_interval,
)
from sim.fleet import Fleet
from sim.loop import open_loop
from sim.robot.robot import Robot
from sim.run_recorder import Description
from sim.seeds import generator
from sim.wander.commands import Driver, track_commands
from sim.wander.motion import LASTING, WHITE, LawMotion, SlipVariation
from sim.wander.pose_source import PoseSource
from trackslip.errors import LogError, TrackslipError, counted
from trackslip.identification.drive_law import fit_drives
from trackslip.identification.drive_model import DriveModel
from trackslip.identification.drives import drive_of
from trackslip.identification.fitted import fit_law
from trackslip.identification.samples import true_samples
from trackslip.kinematics import Array, RobotGeometry
from trackslip.logs.runlog import RunLog
from trackslip.metrics import rms
from trackslip.planning.information import PoseQuality, information, with_extras
from trackslip.planning.plan import paper_runs
from trackslip.slip.families import FAMILIES

if TYPE_CHECKING:
    from experiments.common.run import Run
    from experiments.coverage import Config

LAW = "icr_radius"
"""The law that moves the robot and is fitted."""
D, EPSILON = "offset", "radius_error"
TRUE_LAW: Mapping[str, float] = {D: 0.045, EPSILON: 0.0066}
"""Its parameters [m, -], similar to the shipped robot's on stone."""
TRUTH = np.array([*TRUE_LAW.values()])
MAX_SIMULATED = 40
"""Drives in MuJoCo; each is measured again and again."""
_DURATION = 120.0  # of each drive [s]
_ENCODER_RATE = 50.0  # [Hz]
_KEY = "drive coverage {case} {number}"
_NORMAL = float(scipy.special.ndtri(0.975))
_CIRCLES = 10.0  # duration of steady circles [s]
_OUTER, _INNER = (0.1, 0.2, 0.3), (0.1, 0.4, 0.7)  # speeds of the tracks [m/s], and relative to the outer one [-]


@dataclass(frozen=True)
class CoverageCase:
    """Repeated drives of one kind, and bounds on what is estimated from each."""

    name: str
    source: PoseSource
    slip: SlipVariation | None = WHITE
    """None where MuJoCo moves the robot."""
    rms: Mapping[str, float] = field(default_factory=dict)
    """Largest root mean square errors, by parameter, in its unit."""
    coverage: tuple[float, float] = (0.93, 0.995)
    """Smallest and largest share of the repeats whose 95 % interval covers the truth [-]."""
    covered: tuple[str, ...] = (D, EPSILON)
    """Parameters whose intervals are checked."""
    over_bound: float | None = None
    """Largest root mean square error over the Cramér-Rao bound, if that is checked [-]."""
    over_model: float | None = None
    """Largest half width of an interval relative to the noise model's, if it is checked [-]."""
    standard_errors: float | None = None
    """Largest error of any repeat, in its standard errors, if that is checked."""


_COARSE = PoseSource(rate=10.0, position_noise=0.02, heading_noise=radians(1.0))
_FINE = PoseSource(rate=20.0, position_noise=0.002, heading_noise=radians(0.25))
_GNSS = PoseSource(rate=5.0, position_noise=0.05, heading=False)
_ODOMETRY = PoseSource(rate=20.0, drift=0.01, heading_drift=0.004)
_EVERYTHING = PoseSource(
    rate=10.0,
    position_noise=0.02,
    heading_noise=radians(1.0),
    outliers=0.05,
    gaps=3,
    gap_duration=5.0,
    jumps=1,
    jump_size=0.5,
    delay=0.15,
    ahead=0.3,
    left=0.1,
    mounting=radians(5.0),
)
EXTRAS: Mapping[str, float] = {
    "sensor_x": _EVERYTHING.ahead,
    "sensor_y": _EVERYTHING.left,
    "sensor_yaw": _EVERYTHING.mounting,
    "clock_offset": -_EVERYTHING.delay,
}
"""True values of what is estimated besides the law in the case with everything [m, m, rad, s]."""
_LASTING_RMS = {D: 0.0022, EPSILON: 0.0055}
SIMULATED = "20 mm, 1 deg, 10 Hz; MuJoCo's own motion"
"""The case whose errors are from the law of steady circles, and coverage of the same drive's fit without noise."""
NOISE_FREE = "MuJoCo's own motion, exact poses"
"""Instead of the truth, which a drive in MuJoCo doesn't have."""
_CASES = (
    CoverageCase("20 mm, 1 deg, 10 Hz; white slip", _COARSE, over_bound=1.15, over_model=1.5),
    CoverageCase("2 mm, 0.25 deg, 20 Hz; white slip", _FINE, rms={D: 0.0002, EPSILON: 0.0006}),
    CoverageCase("2 mm, 0.25 deg, 20 Hz; slip that lasts", _FINE, LASTING, _LASTING_RMS),
    CoverageCase("20 mm, 1 deg, 10 Hz; slip that lasts", _COARSE, LASTING, _LASTING_RMS),
    CoverageCase(
        "50 mm, no heading, 5 Hz; white slip",
        _GNSS,
        rms={D: 0.0006, EPSILON: 0.003},
        coverage=(0.93, 1.0),
        standard_errors=5.0,
    ),
    CoverageCase("odometry that drifts 1 %; white slip", _ODOMETRY, rms={D: 0.002, EPSILON: 0.01}),
    CoverageCase(SIMULATED, _COARSE, None, {D: 0.0005, EPSILON: 0.001}, coverage=(0.9, 1.0)),
    CoverageCase(
        "20 mm with outliers, gaps, a jump, clock, mounting",
        _EVERYTHING,
        rms={D: 0.0006, EPSILON: 0.002},
        coverage=(0.9, 0.995),
        covered=(D, EPSILON, *EXTRAS),
    ),
)
CASES: Mapping[str, CoverageCase] = {case.name: case for case in _CASES}
"""All cases by name, in the order of the table."""


def drive_study(config: Config, world: World, run: Run) -> Study:
    """Repeat every case; raises LogError if no drive in MuJoCo determines the law."""
    robot, repeats = world.robot, config.drive_repeats
    do = partial(fitted_drive, geometry=robot.geometry)
    count = min(repeats, MAX_SIMULATED)
    with run.progress(f"{counted(count, 'drive')} and circles", count * _DURATION) as report:
        steady, paper = steady_laws(robot, config.threads)
        commands = [_commands(robot.geometry, generator(config.seed, f"simulated drive {k}")) for k in range(count)]
        fleet = Fleet(robot, np.zeros((count, 3)), threads=config.threads)
        about = [Description(f"drive {k}") for k in range(count)]
        drives = driven_in_mujoco(fleet, commands, _ENCODER_RATE, about, lambda s: report(count * s))
    fits = run_trials(run, do, [Trial(NOISE_FREE, k, drive) for k, drive in enumerate(drives)], _KEY)[NOISE_FREE]
    known = [k for k, fit in enumerate(fits) if fit.estimates]
    if not known:
        raise LogError("no drive in MuJoCo determines the law, even without noise")
    driven = list(islice(cycle(known), repeats))  # measured in turn
    trials = [
        Trial(name, number, drives[k] if name == SIMULATED else None)
        for name in CASES
        for number, k in enumerate(driven)
    ]
    outcomes = run_trials(run, do, trials, _KEY)
    exact = {name: np.array([fits[k].estimates[name].value for k in known]) for name in TRUE_LAW}
    measured_exactly = {name: np.resize(values, repeats) for name, values in exact.items()}
    statistics: dict[str, Any] = {}
    checks: list[Check] = []
    for name, case in CASES.items():
        aim: Values = steady if name == SIMULATED else {**TRUE_LAW, **EXTRAS}
        truths = measured_exactly if name == SIMULATED else aim
        statistics[name] = {key: _statistics(outcomes[name], key, aim[key], truths[key]) for key in case.covered}
        checks += checks_of(case, outcomes[name], aim, truths)
    laws: dict[str, Values] = {
        "steady": steady,
        "paper": paper,
        "mean": {name: float(values.mean()) for name, values in exact.items()},
        "scatter": {name: float(values.std(ddof=1)) if len(known) > 1 else 0.0 for name, values in exact.items()},
        "coverage_of_steady": {
            name: float(Estimates.of(outcomes[SIMULATED], name).cover(steady[name]).mean()) for name in steady
        },
    }
    summary = {
        "repeats": repeats,
        "results": statistics,
        "simulated": {"drives": len(known), **laws},
        "failures": failures_of(one for several in outcomes.values() for one in several),
    }
    shown: list[Table | str] = [
        checks_table(f"{counted(repeats, 'drive')} in each case", checks),
        _law_table(laws, len(known)),
        f"so many drives leave root mean squares uncertain by {sampling_error(repeats):.0%}",
    ]
    return Study(summary, shown, checks)


def _statistics(outcomes: Sequence[TrialOutcome], name: str, aim: float, truth: Array | float) -> dict[str, Any]:
    """Errors of a parameter and coverage of its intervals."""
    estimates = Estimates.of(outcomes, name)
    errors, covered = estimates.errors(aim), estimates.cover(truth)
    return {
        "rms": rms(errors),
        "rms_interval95": rms_interval(errors),
        "coverage": float(covered.mean()),
        "coverage_interval95": share_interval(int(covered.sum()), len(covered)),
    }


def _law_table(laws: Mapping[str, Values], drives: int) -> Table:
    lines = (
        ("steady circles of the same speeds", "steady", 1e3),
        ("steady circles, the paper's", "paper", 1e3),
        (f"mean of {drives} drives", "mean", 1e3),
        ("scatter between drives", "scatter", 1e3),
        ("coverage of the steady law", "coverage_of_steady", 1.0),
    )
    rows = [(text, *(number(scale * laws[law][name], 3) for name in TRUE_LAW)) for text, law, scale in lines]
    return Table("MuJoCo's drives without noise, and steady circles", ("", "D [mm]", "epsilon [1e-3]"), rows)


def checks_of(
    case: CoverageCase, outcomes: Sequence[TrialOutcome], aim: Values, truths: Mapping[str, float | Array]
) -> Iterator[Check]:
    """Fits, errors and intervals within the bounds of a case.

    Errors are measured from `aim`; intervals must cover `truths`, one or (n,) of each parameter.
    """
    yield Check(case.name, "fits without D or epsilon", float(sum(not one.estimates for one in outcomes)), 0.0)
    limits = {name: (most, "") for name, most in case.rms.items()}
    if case.over_bound is not None:
        source = f"{case.over_bound:g} times the Cramér-Rao bound"
        bounds = {name: rms([one.numbers[name] for one in outcomes]) for name in TRUE_LAW}
        limits |= {name: (case.over_bound * bound, source) for name, bound in bounds.items()}
    for name, (most, source) in limits.items():
        error, unit = rms(Estimates.of(outcomes, name).errors(aim[name])), FAMILIES[LAW].parameters[name].unit
        yield Check(case.name, f"rms error of {name}", error, most, unit or "1", source=source)
    for name in case.covered:
        found = Estimates.of(outcomes, name)
        share = float(found.cover(truths[name]).mean())
        yield Check(case.name, f"coverage of {name}", share, case.coverage, source="intervals of 95 %")
        if case.over_model is not None:
            widths = (found.high - found.low)[found.known] / 2 / (_NORMAL * found.stderr[found.known])
            over = float(np.median(widths)) if len(widths) else np.nan
            yield Check(case.name, f"half width of {name} over the model's", over, case.over_model)
        if case.standard_errors is not None:
            largest = float(np.fmax.reduce(np.abs(found.value - aim[name]) / found.stderr, initial=np.nan))
            yield Check(case.name, f"largest error of {name} in standard errors", largest, case.standard_errors)


def fitted_drive(trial: Trial, rng: np.random.Generator, geometry: RobotGeometry) -> TrialOutcome:
    """Drive by the law unless the trial has a drive in MuJoCo, measure and fit.

    `numbers` are the Cramér-Rao bounds, if the case asks for them.
    """
    case = CASES.get(trial.case, CoverageCase(NOISE_FREE, PoseSource(rate=20.0), None))
    drive: KnownDrive = trial.given
    if case.slip is not None:
        law = LawMotion(FAMILIES[LAW].law(TRUTH, geometry), geometry, case.slip)
        drive = driven_by_law("drive", law, _commands(geometry, rng), _ENCODER_RATE, rng)
    log, bound = drive.measured(case.source, rng), {}
    if case.slip is not None and case.over_bound is not None:
        bound = _bound(log, case.source, case.slip, geometry)
    try:
        estimates = Estimate.of(fit_drives(LAW, [log], geometry))
    except TrackslipError as error:
        return TrialOutcome(numbers=bound, notes=(str(error),))
    return TrialOutcome(estimates if TRUE_LAW.keys() <= estimates.keys() else {}, bound)


def _commands(geometry: RobotGeometry, rng: np.random.Generator) -> Array:
    """Sprocket speeds (T, 2) of a random drive [rad/s]."""
    driver = Driver(half_gauge=geometry.half_gauge + TRUE_LAW[D])
    return track_commands("random", _DURATION, _ENCODER_RATE, driver, rng) / geometry.sprocket_radius


def _bound(log: RunLog, source: PoseSource, slip: SlipVariation, geometry: RobotGeometry) -> dict[str, float]:
    """The Cramér-Rao bounds of the law's parameters, the trajectory being unknown as well, for white slip."""
    model = DriveModel(FAMILIES[LAW], geometry)
    poses = PoseQuality(source.rate, source.position_noise, source.heading_noise)
    white = (slip.along, slip.across, slip.turning)
    found = information(model, with_extras(TRUTH), [drive_of(log)], poses, white, list(TRUE_LAW))
    return dict(zip(TRUE_LAW, np.sqrt(np.diag(np.linalg.inv(found))).tolist(), strict=True))


def steady_laws(robot: Robot, threads: int) -> tuple[Values, Values]:
    """The law's parameters from true motion on steady circles: of the drives' track speeds, and the paper's.

    They differ because the ICRs of a simulated robot move outwards with the yaw rate, by 2.5 mm up to 1.4 rad/s.
    """
    same = [(inner * outer, outer) for outer in _OUTER for inner in _INNER]
    return _steady_law(robot, same, threads), _steady_law(robot, paper_runs(robot.geometry), threads)


def _steady_law(robot: Robot, speeds: Sequence[Sequence[float] | Array], threads: int) -> Values:
    """The law's parameters from circles with these track speeds [m/s], and from the mirrored ones."""
    left = np.array([*speeds])
    both = np.concatenate([left, left[:, ::-1]])
    fleet = Fleet(robot, np.zeros((len(both), 3)), threads=threads)
    logs = open_loop(fleet, both / robot.geometry.sprocket_radius, _CIRCLES)
    return dict(fit_law(LAW, true_samples(logs, robot.geometry), robot.geometry, bootstraps=0).values)
