"""From logs to slip laws: the whole identification in one call."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from trackslip.identification.comparison import compare_laws
from trackslip.identification.outliers import split_outliers
from trackslip.identification.result import Identification
from trackslip.identification.samples import Sampling
from trackslip.identification.source import Reading, read_source, source_of_runs
from trackslip.kinematics import RobotGeometry
from trackslip.logs.runlog import RunLog
from trackslip.motion.constant_speed import SETTLE


def identify(
    source: str | Path | RunLog | Sequence[RunLog],
    geometry: RobotGeometry | None = None,
    *,
    gear: float = 1.0,
    settle: float = SETTLE,
    motion: str | None = None,
) -> Identification:
    """Identify slip laws from steady runs.

    Args:
        source: a folder of results, a `.parquet` or `.csv` file of traces or steady samples, or runs in memory.
        geometry: of the robot; needed if the log does not state it.
        gear: turns of the encoder per turn of the sprocket, if omega is the speed of the encoder [-].
        settle: time after the sprockets have become steady that is left out of each run [s].
        motion: how a run becomes a twist: paper, butterworth, arc or bundle; by default the most accurate method that
            each run allows.

    Raises:
        LogError: if the log cannot be read, or its runs determine no law.
        InvalidValueError: for an invalid option, or if neither `geometry` nor the log states the geometry.
    """
    b, r = (geometry.half_gauge, geometry.sprocket_radius) if geometry else (None, None)
    reading = Reading(b, r, gear, settle, motion)
    if isinstance(source, str | Path):
        found = read_source(Path(source), reading)
    else:
        found = source_of_runs([source] if isinstance(source, RunLog) else list(source), reading)
    return identify_samples(found.sampling, found.geometry, found.logs)


def identify_samples(sampling: Sampling, geometry: RobotGeometry, logs: tuple[RunLog, ...] = ()) -> Identification:
    """Leave out outliers, fit and compare the laws; raises LogError if the samples determine no law."""
    samples, outliers = split_outliers(sampling.samples, geometry)
    left_out = (*sampling.refused, *outliers)
    comparison = compare_laws(samples, geometry)
    warnings = (*sampling.notes, *map(str, left_out), *comparison.warnings)
    return Identification(geometry, samples, left_out, comparison, warnings, logs)
