"""How well the drive estimator does: errors and intervals from many drives whose law is known."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy

from experiments.measuring.check import Check
from experiments.measuring.drive_bound import drive_bound
from experiments.measuring.drive_cases import CASES, DURATION, ENCODER_RATE, EXTRAS, LAW, TRUE_LAW, Case
from sim.seeds import generator
from sim.wander.commands import Driver, track_commands
from sim.wander.law_motion import LawMotion, SlipVariation
from sim.wander.log import encoder_log, joined_log
from sim.wander.motion import Motion, steps_between
from sim.wander.pose_source import PoseSource
from trackslip.errors import TrackslipError
from trackslip.identification.drive.estimate import fit_drives
from trackslip.kinematics import Array, RobotGeometry
from trackslip.logs.runlog import RunLog
from trackslip.metrics import rms
from trackslip.slip.families import FAMILIES

_NORMAL = float(scipy.special.ndtri(0.975))
_LEAST_WAY = 1e-6  # of a step, for a robot at rest [m]
NOISE_FREE = PoseSource(rate=20.0)
"""Poses of a drive that are exact."""


@dataclass(frozen=True)
class Estimate:
    """A parameter estimated from a drive, in its unit."""

    value: float
    stderr: float
    """By the model of the noise."""
    low: float
    high: float
    """The 95 % interval."""


Estimates = Mapping[str, Estimate]
"""By parameter."""


@dataclass(frozen=True)
class Task:
    """A repeat of a case."""

    case: int
    """Its place in CASES."""
    number: int
    """Of the repeat, from 0."""
    seed: int
    geometry: RobotGeometry
    driven: RunLog | None = None
    """A drive in MuJoCo with its true poses, to be measured; None for a drive by the law."""
    truth: Mapping[str, float] = field(default_factory=lambda: {**TRUE_LAW, **EXTRAS})
    """What its intervals should cover."""
    aim: Mapping[str, float] | None = None
    """What its errors are measured from, if that is something else."""


@dataclass(frozen=True)
class Repeat:
    """What came out of a task."""

    task: Task
    estimates: Estimates
    bound: Mapping[str, float]
    """Cramér-Rao bounds of the law's parameters, if the case asks for them."""
    failure: str | None = None
    """Why there is no estimate."""

    def covers(self, name: str) -> bool:
        """Whether the interval of a parameter contains the truth; one that was not estimated does not."""
        found = self.estimates.get(name)
        return found is not None and found.low <= self.task.truth[name] <= found.high

    def error(self, name: str) -> float:
        """The error of a parameter that was estimated."""
        aim = self.task.truth if self.task.aim is None else self.task.aim
        return self.estimates[name].value - aim[name]


def repeat(task: Task) -> Repeat:
    """Drive, measure and fit; a fit that fails is recorded."""
    case = CASES[task.case]
    rng = generator(task.seed, f"drive coverage {case.name} {task.number}")
    bound: dict[str, float] = {}
    if task.driven is not None:
        log = measured(task.driven, case.source, rng)
    else:
        assert case.slip is not None
        log, bound = _driven_by_law(case, case.slip, task.geometry, rng)
    try:
        return Repeat(task, estimated(log, task.geometry), bound)
    except TrackslipError as error:
        return Repeat(task, {}, bound, str(error))


def estimated(log: RunLog, geometry: RobotGeometry) -> dict[str, Estimate]:
    """The law and all else that the drive determines; raises TrackslipError if it doesn't determine the law."""
    found = fit_drives(LAW, [log], geometry)
    values = found.values | found.extras
    return {name: Estimate(values[name], error, *found.interval95[name]) for name, error in found.stderr.items()}


def measured(driven: RunLog, source: PoseSource, rng: np.random.Generator) -> RunLog:
    """A drive with true poses as a source sees it."""
    return joined_log(driven, *source.measure(Motion(driven.time, driven.pose), rng))


def _driven_by_law(
    case: Case, slip: SlipVariation, geometry: RobotGeometry, rng: np.random.Generator
) -> tuple[RunLog, dict[str, float]]:
    """The log of a drive, and the Cramér-Rao bounds if the case asks for them."""
    driver = Driver(half_gauge=geometry.half_gauge + TRUE_LAW["offset"])
    omega = track_commands("random", DURATION, ENCODER_RATE, driver, rng) / geometry.sprocket_radius
    motion, twist = _law_motion(np.array([*TRUE_LAW.values()]), geometry, slip).drive(omega, ENCODER_RATE, rng)
    stamps, poses = case.source.measure(motion, rng)
    log = joined_log(encoder_log("drive", ENCODER_RATE, omega, motion, twist, {}), stamps, poses)
    return log, {} if case.over_bound is None else _bound(omega, stamps, case.source, slip, geometry)


def _law_motion(values: Array, geometry: RobotGeometry, slip: SlipVariation) -> LawMotion:
    return LawMotion(FAMILIES[LAW].law(values, geometry), geometry, slip)


def _bound(
    omega: Array, stamps: Array, source: PoseSource, slip: SlipVariation, geometry: RobotGeometry
) -> dict[str, float]:
    """The Cramér-Rao bounds of the law's parameters, for poses stamped by the encoders' clock and white slip."""

    def steps(values: Array) -> Array:
        silent = _law_motion(values, geometry, SlipVariation())
        return steps_between(silent.drive(omega, ENCODER_RATE, np.random.default_rng(0))[0].at(stamps))

    speed = geometry.sprocket_radius * np.abs(omega[1:]).mean(axis=1)
    way = np.concatenate([[0.0], np.cumsum(speed / ENCODER_RATE)])
    between = np.diff(np.interp(stamps, np.arange(len(way)) / ENCODER_RATE, way))
    white = np.array([slip.along, slip.across, slip.turning])
    noise = np.array([source.position_noise, source.position_noise, source.heading_noise])
    truth = np.array([*TRUE_LAW.values()])
    found = drive_bound(steps, truth, np.sqrt(np.maximum(between, _LEAST_WAY))[:, None] * white, noise)
    return dict(zip(TRUE_LAW, found.tolist(), strict=True))


def checks_of(case: Case, repeats: Sequence[Repeat]) -> list[Check]:
    """Everything that a case has to reach; a repeat without an estimate covers nothing."""
    good = [one for one in repeats if TRUE_LAW.keys() <= one.estimates.keys()]
    found = [Check(case.name, "fits without D or epsilon", float(len(repeats) - len(good)), 0.0, "1")]
    most = dict(case.rms)
    if case.over_bound is not None:
        most |= {name: case.over_bound * rms([one.bound[name] for one in repeats]) for name in TRUE_LAW}
    for name, limit in most.items():
        errors = [one.error(name) for one in good]
        found.append(Check(case.name, f"rms error of {name}", rms(errors), limit, unit_of(name)))
    for name in case.covered:
        share = sum(one.covers(name) for one in repeats) / len(repeats)
        found.append(Check(case.name, f"coverage of {name}", share, case.coverage, "1"))
        having = [(one.estimates[name], one.error(name)) for one in good if name in one.estimates]
        if case.over_model is not None:
            widths = [(one.high - one.low) / 2 / (_NORMAL * one.stderr) for one, _ in having]
            over = float(np.median(widths)) if widths else np.nan
            found.append(Check(case.name, f"half width of {name} over the model's", over, case.over_model, "1"))
        if case.standard_errors is not None:
            largest = max((abs(error) / one.stderr for one, error in having), default=np.nan)
            what = f"largest error of {name} in standard errors"
            found.append(Check(case.name, what, largest, case.standard_errors, "1"))
    return found


def unit_of(name: str) -> str:
    """Unit of a parameter, 1 for a pure number."""
    return {"offset": "m", "sensor_x": "m", "sensor_y": "m", "sensor_yaw": "rad", "clock_offset": "s"}.get(name, "1")
