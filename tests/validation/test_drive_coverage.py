"""Whole drives: how far off the law identified from each is, and how often its 95 % intervals hold
the truth.

`pytest -m slow tests/validation/test_drive_coverage.py -s` prints the tables of docs/validation.md,
in minutes. The robot and its law are those of `plain_drives`.
"""

from collections.abc import Callable
from itertools import product

import numpy as np
import pytest
from plain_drives import HUSKY, Drive, drive_of, log_of, measured
from trials import LAW, Estimate, Estimates, identified, outcomes, plausible_shares, share_text

from experiments.common.table import Table
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
    errors = {
        name: Estimates.of([found[name, seed] for seed in range(SEEDS)], "offset").rms_error(
            HUSKY.offset
        )
        for name in EFFICIENCY
    }
    rows = [
        (name, f"{1e3 * error:.2f}", f"{1e3 * EFFICIENCY[name]:.1f}")
        for name, error in errors.items()
    ]
    Table(
        f"D of {SEEDS} drives of 120 s, slip 2 %", ("poses", "rms error [mm]", "allowed [mm]"), rows
    ).print()
    assert all(error < EFFICIENCY[name] for name, error in errors.items())
