"""Whole drives: how far off the law identified from each is, and how often its 95 % intervals hold
the truth.

`pytest -m slow tests/validation/test_drive_coverage.py -s` prints the tables of docs/validation.md,
in minutes. The robot and its law are those of `plain_drives`.
"""

from collections.abc import Callable
from dataclasses import replace
from itertools import product

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
    return [
        _log(drive_of(seed=12 * seed + k, slip=0.05, duration=10.0), 12 * seed + k)
        for k in range(12)
    ]


def short(seed: int) -> list[RunLog]:
    """Slip that varies by 5 %, for a minute."""
    return [_log(drive_of(seed=seed, slip=0.05, duration=60.0), seed)]


def drifting(seed: int) -> list[RunLog]:
    """Slip that varies by 5 %, and headings that drift as a random walk of 0.01 rad/√s."""
    drive = drive_of(seed=seed, slip=0.05)
    time, pose = measured(drive, position_noise=0.01, heading_noise=0.01, seed=10_000 + seed)
    true = drive.pose[:: len(drive.pose) // (len(pose) - 1)]
    steps = se2.steps(true)
    walk = np.random.default_rng(20_000 + seed).normal(size=len(steps))
    steps[:, 2] += 0.01 * np.sqrt(np.diff(time)) * walk
    return [log_of(drive, time, se2.chain(true[0], steps) + pose - true, f"drive {seed}")]


def runs_of_one_ground(seed: int) -> list[RunLog]:
    """Slip that varies by 5 %, in 8 runs of a minute, each with a D of its own."""
    changes = np.random.default_rng(30_000 + seed).normal(0.0, 0.015, 8)
    logs = []
    for k, change in enumerate(changes.tolist()):
        robot = replace(HUSKY, offset=HUSKY.offset + change)
        logs.append(
            _log(drive_of(robot, seed=8 * seed + k, slip=0.05, duration=60.0), 8 * seed + k)
        )
    return logs


def _log(drive: Drive, seed: int) -> RunLog:
    time, pose = measured(drive, position_noise=0.01, heading_noise=0.01, seed=10_000 + seed)
    return log_of(drive, time, pose, f"drive {seed}")


CASES: dict[str, tuple[Callable[[int], list[RunLog]], float]] = {
    "white noise of poses": (white, 0.92),
    "slip that varies by 5 %": (slipping, 0.92),
    "the same, positions alone": (positions, 0.92),
    "the same, encoders read at 10 Hz": (held, 0.92),
    "the same, another law": (another_law, 0.92),
    "the same, 12 drives of 10 s": (blocks, 0.92),
    "the same, 60 s": (short, 0.88),
    "the same, drifting poses": (drifting, 0.92),
    "the same, 8 runs with a D each": (runs_of_one_ground, 0.92),
}
"""Logs by seed, and the least share of the intervals that hold the truth."""


def fitted(trial: tuple[str, int]) -> dict[str, Estimate]:
    """Estimates from the logs of a case."""
    name, seed = trial
    return identified(CASES[name][0](seed), HUSKY.geometry)


def test_intervals_hold_the_truth_in_95_percent():
    """What another law's very long log gives is the truth of its short ones."""
    every = list(product(CASES, range(REPEATS)))
    found = dict(zip(every, outcomes(fitted, every), strict=True))
    long = identified(another_law(7, 4000.0), HUSKY.geometry)
    rows, wrong = [], []
    for case, (_, least) in CASES.items():
        trials = [found[case, seed] for seed in range(REPEATS)]
        for name, unit in (("offset", "mm"), ("radius_error", "1e-3")):
            truth = long[name].value if case == "the same, another law" else TRUTH[name]
            of = Estimates.of(trials, name)
            share = of.coverage(truth)
            bias = float(np.nanmean(of.value)) - truth
            half = float(np.nanmedian(of.high - of.low)) / 2
            numbers = (f"{1e3 * number:.2f}" for number in (truth, bias, of.rms_error(truth), half))
            rows.append((case, f"{name} [{unit}]", *numbers, share_text(share, REPEATS)))
            low, high = plausible_shares(least, 0.98, REPEATS)
            if not low <= share <= high:
                wrong.append(f"{case}, {name}: {share:.3f}")
    head = ("drives of 120 s", "parameter", "truth", "bias", "rms error", "half width", "coverage")
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
        speed, turn = 0.3 + 0.04 * k, np.pi / 8 * (1 if k % 2 else -1)
        corners = 3 if k % 4 < 2 else 4
        commands = np.array([speed, 0.0] * corners + [0.0]), np.array([0.0, turn] * corners + [0.0])
        length = 4.0 * (2 * corners) + 1.0
        drive = drive_of(UNEQUAL, length, 12 * seed + k, commands=commands, slip=0.02)
        time, pose = measured(drive, seed=10_000 + 12 * seed + k)
        logs.append(log_of(drive, time[[0, -1]], pose[[0, -1]], f"square {k}"))
    return logs


RADII_CASES = {"slip that varies by 5 %": unequal, "start and end poses of 12 squares": squares}


def differential_drive(trial: tuple[str, int]) -> dict[str, Estimate]:
    """Estimates of `diff_drive`, and of the difference of its radii, from the logs of a case."""
    name, seed = trial
    fit = fit_drives("diff_drive", drives_of(RADII_CASES[name](seed))[0], UNEQUAL.geometry)
    found = {
        key: Estimate(value, fit.stderr[key], *fit.interval95[key])
        for key, value in fit.values.items()
    }
    gain = combined(fit, {"radius_error_left": 1.0, "radius_error_right": -1.0})
    return found | {"difference": Estimate(gain.value, np.nan, gain.low, gain.high)}


def test_intervals_of_a_differential_drive_hold_the_truth():
    every = list(product(RADII_CASES, range(REPEATS)))
    found = dict(zip(every, outcomes(differential_drive, every), strict=True))
    truth = {
        "offset": UNEQUAL.offset,
        "radius_error_left": UNEQUAL.radius_error + UNEQUAL.unequal,
        "radius_error_right": UNEQUAL.radius_error - UNEQUAL.unequal,
        "difference": 2 * UNEQUAL.unequal,
    }
    rows, wrong = [], []
    for case, (name, true) in product(RADII_CASES, truth.items()):
        of = Estimates.of([found[case, seed] for seed in range(REPEATS)], name)
        share = of.coverage(true)
        bias = float(np.nanmean(of.value)) - true
        half = float(np.nanmedian(of.high - of.low)) / 2
        numbers = (f"{1e3 * number:.2f}" for number in (true, bias, of.rms_error(true), half))
        rows.append((case, f"{name} [1e-3]", *numbers, share_text(share, REPEATS)))
        low, high = plausible_shares(0.92, 0.98, REPEATS)
        if not low <= share <= high:
            wrong.append(f"{case}, {name}: {share:.3f}")
    head = ("logs", "parameter", "truth", "bias", "rms error", "half width", "coverage")
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
