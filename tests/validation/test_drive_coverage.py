"""Whole drives: how far off the law identified from each is, and how often its 95 % intervals hold
the truth.

`pytest -m slow tests/validation/test_drive_coverage.py -s` prints the tables of docs/validation.md,
in minutes. The robot and its law are those of `plain_drives`.
"""

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
import pytest
from plain_drives import HUSKY, Drive, drive_of, log_of, measured
from trials import LAW, Estimate, Estimates, identified, outcomes, plausible_shares, share_text

from experiments.common.table import Table
from trackslip import se2
from trackslip.drives.conditioning import drives_of
from trackslip.identification.answer import combined
from trackslip.identification.law_fit import fit_drives
from trackslip.laws.turn_loss import TurnLoss
from trackslip.logs.runlog import RunLog

pytestmark = pytest.mark.slow
REPEATS = 200
"""Drives in each case."""
SEEDS = 40
"""Drives whose errors are averaged."""
TRUTH = {"offset": HUSKY.offset, "radius_error": HUSKY.radius_error}
LOSS = TurnLoss(HUSKY.offset, HUSKY.half_gauge, HUSKY.radius_error, 0.15)


def white(seed: int) -> list[RunLog]:
    """Poses with white noise of 1 cm and 0.01 rad at 10 Hz, and no other errors."""
    return [_log(drive_of(seed=seed), seed)]


def slipping(seed: int) -> list[RunLog]:
    """Slip that varies by 5 %, for about a second."""
    return [_log(drive_of(seed=seed, slip=0.05), seed)]


def positions(seed: int) -> list[RunLog]:
    """Slip that varies by 5 %, and positions alone."""
    log = _log(drive_of(seed=seed, slip=0.05), seed)
    log.pose[:, 2] = np.nan
    return [log]


def held(seed: int) -> list[RunLog]:
    """Slip that varies by 5 %, and encoders that are read at 10 Hz and logged at 50 Hz."""
    drive = drive_of(seed=seed, slip=0.05)
    read = np.arange(len(drive.time)) // 5 * 5
    return [_log(drive.with_wheels(drive.omega[read]), seed)]


def another_law(seed: int, duration: float = 120.0) -> list[RunLog]:
    """Slip that varies by 5 %, of a robot that loses speed in turns, which the law doesn't know."""
    return [_log(drive_of(seed=seed, slip=0.05, law=LOSS, duration=duration), seed)]


def blocks(seed: int) -> list[RunLog]:
    """Slip that varies by 5 %, in 12 drives of 10 s."""
    seeds = range(12 * seed, 12 * seed + 12)
    return [_log(drive_of(seed=each, slip=0.05, duration=10.0), each) for each in seeds]


def short(seed: int) -> list[RunLog]:
    """Slip that varies by 5 %, for a minute."""
    return [_log(drive_of(seed=seed, slip=0.05, duration=60.0), seed)]


def drifting(seed: int) -> list[RunLog]:
    """Slip that varies by 5 %, and headings that drift as a random walk of 0.01 rad/√s."""
    drive = drive_of(seed=seed, slip=0.05)
    time, pose = measured(drive, position_noise=0.01, heading_noise=0.01, seed=10_000 + seed)
    stride = len(drive.pose) // (len(pose) - 1)
    true = drive.pose[::stride]
    noise = pose - true
    steps = se2.steps(true)
    walk = np.random.default_rng(20_000 + seed).normal(size=len(steps))
    steps[:, 2] += 0.01 * np.sqrt(np.diff(time)) * walk
    drifted = se2.chain(true[0], steps)
    return [log_of(drive, time, drifted + noise, f"drive {seed}")]


def runs_of_one_ground(seed: int) -> list[RunLog]:
    """Slip that varies by 5 %, in 8 runs of a minute, each with a D of its own."""
    changes = np.random.default_rng(30_000 + seed).normal(0.0, 0.015, 8)
    logs = []
    for k, change in enumerate(changes.tolist()):
        robot = replace(HUSKY, offset=HUSKY.offset + change)
        drive = drive_of(robot, seed=8 * seed + k, slip=0.05, duration=60.0)
        logs.append(_log(drive, 8 * seed + k))
    return logs


def _log(drive: Drive, seed: int) -> RunLog:
    time, pose = measured(drive, position_noise=0.01, heading_noise=0.01, seed=10_000 + seed)
    return log_of(drive, time, pose, f"drive {seed}")


class Case(NamedTuple):
    """Logs by seed, and the least share of the intervals that hold the truth."""

    logs: Callable[[int], list[RunLog]]
    least: float = 0.92


CASES = {
    "white noise of poses": Case(white),
    "slip that varies by 5 %": Case(slipping),
    "the same, positions alone": Case(positions),
    "the same, encoders read at 10 Hz": Case(held),
    "the same, another law": Case(another_law),
    "the same, 12 drives of 10 s": Case(blocks),
    "the same, 60 s": Case(short, least=0.88),
    "the same, drifting poses": Case(drifting),
    "the same, 8 runs with a D each": Case(runs_of_one_ground),
}


def fitted(trial: tuple[str, int]) -> dict[str, Estimate]:
    """Estimates from the logs of a case."""
    name, seed = trial
    return identified(CASES[name].logs(seed), HUSKY.geometry)


COLUMNS = ("truth", "bias", "rms error", "half width", "coverage")


def cells_of(estimates: Estimates, truth: float) -> list[str]:
    """Texts of the columns: the truth, the estimates' errors from it [1e-3], and the coverage."""
    bias = float(np.nanmean(estimates.value)) - truth
    half_width = float(np.nanmedian(estimates.high - estimates.low)) / 2
    numbers = (truth, bias, estimates.rms_error(truth), half_width)
    coverage = share_text(estimates.coverage(truth), REPEATS)
    return [*(f"{1e3 * number:.2f}" for number in numbers), coverage]


def test_intervals_hold_the_truth_in_95_percent():
    """What another law's very long log gives is the truth of its short ones."""
    every = list(product(CASES, range(REPEATS)))
    found = dict(zip(every, outcomes(fitted, every), strict=True))
    long = identified(another_law(7, 4000.0), HUSKY.geometry)
    rows = []
    wrong = []
    for case, (_, least) in CASES.items():
        trials = [found[case, seed] for seed in range(REPEATS)]
        low, high = plausible_shares(least, 0.98, REPEATS)
        for name, unit in (("offset", "mm"), ("radius_error", "1e-3")):
            truth = long[name].value if case == "the same, another law" else TRUTH[name]
            estimates = Estimates.of(trials, name)
            rows.append((case, f"{name} [{unit}]", *cells_of(estimates, truth)))
            share = estimates.coverage(truth)
            if not low <= share <= high:
                wrong.append(f"{case}, {name}: {share:.3f}")
    head = ("drives of 120 s", "parameter", *COLUMNS)
    Table(f"Law {LAW} from {REPEATS} logs of each kind", head, rows, "ll").print()
    assert wrong == []


UNEQUAL = replace(HUSKY, unequal=0.01)
"""A robot whose radii differ by 2 %."""


def unequal(seed: int) -> list[RunLog]:
    """Slip that varies by 5 %."""
    return [_log(drive_of(UNEQUAL, seed=seed, slip=0.05), seed)]


def squares(seed: int) -> list[RunLog]:
    """Start and end poses of 12 squares and parts of squares, of which none is as long as another,
    and slip that varies by 2 %.
    """
    logs = []
    for k in range(12):
        speed = 0.3 + 0.04 * k
        turn = np.pi / 8 * (1 if k % 2 else -1)
        corners = 3 if k % 4 < 2 else 4
        speeds = np.array([speed, 0.0] * corners + [0.0])
        yaw_rates = np.array([0.0, turn] * corners + [0.0])
        duration = 4.0 * (2 * corners) + 1.0
        number = 12 * seed + k
        drive = drive_of(UNEQUAL, duration, number, commands=(speeds, yaw_rates), slip=0.02)
        time, pose = measured(drive, seed=10_000 + number)
        ends = [0, -1]
        logs.append(log_of(drive, time[ends], pose[ends], f"square {k}"))
    return logs


RADII_CASES = {"slip that varies by 5 %": unequal, "start and end poses of 12 squares": squares}


def differential_drive(trial: tuple[str, int]) -> dict[str, Estimate]:
    """Estimates of `diff_drive`, and of the difference of its radii, from the logs of a case."""
    name, seed = trial
    drives, _ = drives_of(RADII_CASES[name](seed))
    fit = fit_drives("diff_drive", drives, UNEQUAL.geometry)
    found = {}
    for key, value in fit.values.items():
        low, high = fit.interval95[key]
        found[key] = Estimate(value, fit.stderr[key], low, high)
    gain = combined(fit, {"radius_error_left": 1.0, "radius_error_right": -1.0})
    found["difference"] = Estimate(gain.value, np.nan, gain.low, gain.high)
    return found


def test_intervals_of_a_differential_drive_hold_the_truth():
    every = list(product(RADII_CASES, range(REPEATS)))
    found = dict(zip(every, outcomes(differential_drive, every), strict=True))
    truth = {
        "offset": UNEQUAL.offset,
        "radius_error_left": UNEQUAL.radius_error + UNEQUAL.unequal,
        "radius_error_right": UNEQUAL.radius_error - UNEQUAL.unequal,
        "difference": 2 * UNEQUAL.unequal,
    }
    low, high = plausible_shares(0.92, 0.98, REPEATS)
    rows = []
    wrong = []
    for case, (name, true) in product(RADII_CASES, truth.items()):
        estimates = Estimates.of([found[case, seed] for seed in range(REPEATS)], name)
        rows.append((case, f"{name} [1e-3]", *cells_of(estimates, true)))
        share = estimates.coverage(true)
        if not low <= share <= high:
            wrong.append(f"{case}, {name}: {share:.3f}")
    head = ("logs", "parameter", *COLUMNS)
    Table(f"Law diff_drive from {REPEATS} logs of each kind", head, rows, "ll").print()
    assert wrong == []


EFFICIENCY = {"poses of 5 mm at 10 Hz": 0.0023, "positions of 2 cm at 5 Hz": 0.0030}
"""Root mean square errors of D [m] that are allowed: 1.15 times the 2.0 and 2.6 mm of estimates of
the whole path.
"""


def of_noise(trial: tuple[str, int]) -> dict[str, Estimate]:
    """Estimates from a drive whose slip varies by 2 %."""
    name, seed = trial
    drive = drive_of(seed=seed, slip=0.02)
    time, pose = measured(drive, seed=10_000 + seed)
    if name.startswith("positions"):
        time, pose = measured(drive, pose_step=0.2, position_noise=0.02, seed=10_000 + seed)
        pose[:, 2] = np.nan
    return identified([log_of(drive, time, pose)], HUSKY.geometry)


def test_windows_are_as_efficient_as_an_estimate_of_the_path():
    every = list(product(EFFICIENCY, range(SEEDS)))
    found = dict(zip(every, outcomes(of_noise, every), strict=True))
    errors = {}
    rows = []
    for name, allowed in EFFICIENCY.items():
        estimates = Estimates.of([found[name, seed] for seed in range(SEEDS)], "offset")
        errors[name] = estimates.rms_error(HUSKY.offset)
        rows.append((name, f"{1e3 * errors[name]:.2f}", f"{1e3 * allowed:.1f}"))
    title = f"D of {SEEDS} drives of 120 s, slip 2 %"
    Table(title, ("poses", "rms error [mm]", "allowed [mm]"), rows).print()
    assert all(error < EFFICIENCY[name] for name, error in errors.items())
