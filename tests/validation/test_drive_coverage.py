"""Whole drives: errors and 95 % intervals of the law identified from each, over drives whose law is known.

`pytest -m slow tests/validation/test_drive_coverage.py -s` prints the tables of docs/coverage.md, in minutes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from math import radians

import numpy as np
import pytest
from checked import report
from scipy.special import ndtri
from trials import LAW, TRUE_LAW, Estimate, Estimates, identified, outcomes

from experiments.common.check import Check
from experiments.common.table import Table
from experiments.simulate.drives import KnownDrive, driven_by_law, driven_in_mujoco
from sim.fleet import Fleet
from sim.loop import open_loop
from sim.robot.robot import Robot
from sim.run_recorder import Description
from sim.seeds import generator
from sim.wander.commands import Driver, track_commands
from sim.wander.motion import LASTING, WHITE, LawMotion, SlipVariation
from sim.wander.pose_source import PoseSource
from trackslip.identification.drive_model import DriveModel
from trackslip.identification.drives import drive_of
from trackslip.identification.fitted import fit_law
from trackslip.identification.samples import true_samples
from trackslip.kinematics import Array, RobotGeometry
from trackslip.logs.runlog import RunLog
from trackslip.planning.information import PoseQuality, information, with_extras
from trackslip.planning.plan import paper_runs
from trackslip.slip.families import FAMILIES

pytestmark = pytest.mark.slow
DRIVES = 200
"""Drives in each case."""
SIMULATED = 40
"""Drives in MuJoCo; each is measured five times."""
DURATION, RATE = 120.0, 50.0  # of each drive [s], and of its encoders [Hz]
GEOMETRY = RobotGeometry(0.168, 0.06)
TRUTH = np.array([*TRUE_LAW.values()])


@dataclass(frozen=True)
class Case:
    """Repeated drives of one kind, and bounds on what is estimated from each."""

    source: PoseSource
    slip: SlipVariation = WHITE
    rms: Mapping[str, float] = field(default_factory=dict)
    """Largest root mean square errors, by parameter, in its unit."""
    coverage: tuple[float, float] = (0.93, 0.995)
    """Smallest and largest share of the drives whose 95 % interval covers the truth [-]."""
    extras: Mapping[str, float] = field(default_factory=dict)
    """True values of other parameters whose intervals are checked, too."""
    over_bound: float | None = None
    """Largest root mean square error over the Cramér-Rao bound [-]."""
    over_model: float | None = None
    """Largest half width of an interval relative to the noise model's [-]."""
    standard_errors: float | None = None
    """Largest error of any drive, in its standard errors."""


COARSE = PoseSource(rate=10.0, position_noise=0.02, heading_noise=radians(1.0))
FINE = PoseSource(rate=20.0, position_noise=0.002, heading_noise=radians(0.25))
GNSS = PoseSource(rate=5.0, position_noise=0.05, heading=False)
ODOMETRY = PoseSource(rate=20.0, drift=0.01, heading_drift=0.004)
EVERYTHING = PoseSource(
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
EXTRAS = {"sensor_x": 0.3, "sensor_y": 0.1, "sensor_yaw": radians(5.0), "clock_offset": -0.15}
LASTING_RMS = {"offset": 0.0022, "radius_error": 0.0055}
CASES = {
    "20 mm, 1 deg, 10 Hz; white slip": Case(COARSE, over_bound=1.15, over_model=1.5),
    "2 mm, 0.25 deg, 20 Hz; white slip": Case(FINE, rms={"offset": 0.0002, "radius_error": 0.0006}),
    "2 mm, 0.25 deg, 20 Hz; slip that lasts": Case(FINE, LASTING, LASTING_RMS),
    "20 mm, 1 deg, 10 Hz; slip that lasts": Case(COARSE, LASTING, LASTING_RMS),
    "50 mm, no heading, 5 Hz; white slip": Case(
        GNSS, rms={"offset": 0.0006, "radius_error": 0.003}, coverage=(0.93, 1.0), standard_errors=5.0
    ),
    "odometry that drifts 1 %; white slip": Case(ODOMETRY, rms={"offset": 0.002, "radius_error": 0.01}),
    "20 mm with outliers, gaps, a jump, clock, mounting": Case(
        EVERYTHING, rms={"offset": 0.0006, "radius_error": 0.002}, coverage=(0.9, 0.995), extras=EXTRAS
    ),
}
IN_MUJOCO = "20 mm, 1 deg, 10 Hz; MuJoCo's own motion"


def test_drives_by_a_law():
    trials = list(product(CASES, range(DRIVES)))
    found = list(zip(trials, outcomes(drive_by_law, trials), strict=True))
    checks: list[Check] = []
    for name, case in CASES.items():
        estimates, bounds = zip(*(outcome for (of, _), outcome in found if of == name), strict=True)
        limits = dict(case.rms)
        if case.over_bound is not None:
            limits = dict(zip(TRUE_LAW, case.over_bound * np.sqrt(np.mean(np.square(bounds), axis=0)), strict=True))
        aim = TRUE_LAW | dict(case.extras)
        checks += checks_of(name, case, estimates, limits, aim, aim)
    report(f"{DRIVES} drives in each case", checks)


def test_drives_in_mujoco(robot):
    """Errors are from the law of steady circles; intervals cover the fit to the same drive without noise."""
    fleet = Fleet(robot, np.zeros((SIMULATED, 3)))
    commands = [random_commands(generator(0, f"simulated drive {k}")) for k in range(SIMULATED)]
    about = [Description(f"drive {k}") for k in range(SIMULATED)]
    drives = driven_in_mujoco(fleet, commands, RATE, about, lambda seconds: None)
    exact = outcomes(measured_exactly, enumerate(drives))
    measured = outcomes(measured_again, [(k, drives[k % SIMULATED]) for k in range(DRIVES)])
    values = {name: Estimates.of(exact, name).value for name in TRUE_LAW}
    steady = steady_law(robot, [(inner * outer, outer) for outer, inner in product((0.1, 0.2, 0.3), (0.1, 0.4, 0.7))])
    lines = {
        "steady circles of the same speeds": steady,
        "steady circles, the paper's": steady_law(robot, paper_runs(GEOMETRY)),
        f"mean of {SIMULATED} drives": {name: of_drives.mean() for name, of_drives in values.items()},
        "scatter between drives": {name: of_drives.std(ddof=1) for name, of_drives in values.items()},
    }
    rows = [(text, *(f"{1e3 * law[name]:.3f}" for name in TRUE_LAW)) for text, law in lines.items()]
    Table("MuJoCo's drives without noise, and steady circles", ("", "D [mm]", "epsilon [1e-3]"), rows).print()
    truths = {name: np.resize(of_drives, DRIVES) for name, of_drives in values.items()}
    case = Case(COARSE, coverage=(0.9, 1.0))
    limits = {"offset": 0.0005, "radius_error": 0.001}
    report(f"{DRIVES} measurements of them", list(checks_of(IN_MUJOCO, case, measured, limits, steady, truths)))


def checks_of(
    name: str,
    case: Case,
    trials: Sequence[Mapping[str, Estimate]],
    limits: Mapping[str, float],
    aim: Mapping[str, float],
    truths: Mapping[str, float | Array],
) -> Iterator[Check]:
    """Fits, root mean square errors from `aim` within `limits`, and intervals that cover `truths`."""
    yield Check(name, "fits without D or epsilon", float(sum(not estimates for estimates in trials)), 0.0)
    for key, most in limits.items():
        error, unit = Estimates.of(trials, key).rms_error(aim[key]), FAMILIES[LAW].parameters[key].unit
        yield Check(name, f"rms error of {key}", error, most, unit or "1")
    for key, truth in truths.items():
        found = Estimates.of(trials, key)
        yield Check(name, f"coverage of {key}", found.coverage(truth), case.coverage)
        if case.over_model is not None:
            widths = (found.high - found.low) / 2 / (ndtri(0.975) * found.stderr)
            yield Check(name, f"half width of {key} over the model's", float(np.nanmedian(widths)), case.over_model)
        if case.standard_errors is not None:
            largest = float(np.nanmax(np.abs(found.value - truth) / found.stderr))
            yield Check(name, f"largest error of {key} in standard errors", largest, case.standard_errors)


def drive_by_law(trial: tuple[str, int]) -> tuple[dict[str, Estimate], tuple[float, ...]]:
    """Estimates from a drive by the law, and their Cramér-Rao bounds if the case asks for them."""
    name, number = trial
    case, rng = CASES[name], generator(0, f"drive coverage {name} {number}")
    law = LawMotion(FAMILIES[LAW].law(TRUTH, GEOMETRY), GEOMETRY, case.slip)
    log = driven_by_law("drive", law, random_commands(rng), RATE, rng).measured(case.source, rng)
    return identified([log], GEOMETRY), () if case.over_bound is None else cramer_rao(log, case)


def measured_exactly(trial: tuple[int, KnownDrive]) -> dict[str, Estimate]:
    number, drive = trial
    rng = generator(0, f"drive coverage MuJoCo's own motion, exact poses {number}")
    return identified([drive.measured(PoseSource(rate=20.0), rng)], GEOMETRY)


def measured_again(trial: tuple[int, KnownDrive]) -> dict[str, Estimate]:
    number, drive = trial
    return identified([drive.measured(COARSE, generator(0, f"drive coverage {IN_MUJOCO} {number}"))], GEOMETRY)


def random_commands(rng: np.random.Generator) -> Array:
    """Sprocket speeds (T, 2) of a random drive [rad/s]."""
    driver = Driver(half_gauge=GEOMETRY.half_gauge + TRUE_LAW["offset"])
    return track_commands("random", DURATION, RATE, driver, rng) / GEOMETRY.sprocket_radius


def cramer_rao(log: RunLog, case: Case) -> tuple[float, ...]:
    """Bounds on the errors of the law, the trajectory being unknown as well, for white slip."""
    source, slip = case.source, case.slip
    poses = PoseQuality(source.rate, source.position_noise, source.heading_noise)
    model = DriveModel(FAMILIES[LAW], GEOMETRY)
    white = (slip.along, slip.across, slip.turning)
    found = information(model, with_extras(TRUTH), [drive_of(log)], poses, white, list(TRUE_LAW))
    return tuple(np.sqrt(np.diag(np.linalg.inv(found))))


def steady_law(robot: Robot, left_turns: Sequence[Array | tuple[float, float]]) -> dict[str, float]:
    """The law of true motion on circles with these track speeds (n, 2) [m/s], and on the mirrored ones."""
    speeds = np.concatenate([left_turns, np.flip(left_turns, axis=1)])
    logs = open_loop(Fleet(robot, np.zeros((len(speeds), 3))), speeds / GEOMETRY.sprocket_radius, 10.0)
    return fit_law(LAW, true_samples(logs, GEOMETRY), GEOMETRY, bootstraps=0).values
