"""Errors of slip and localisation under each disturbance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from experiments.measuring.disturbances import Disturbance
from experiments.measuring.grid import LocalizationErrors, OuterInner
from trackslip.errors import LogError
from trackslip.identification.samples import true_samples, usable_samples
from trackslip.kinematics import Array, RobotGeometry
from trackslip.logs.runlog import RunLog

Setting = float | str


@dataclass(frozen=True)
class SlipErrors:
    """Errors of slip over the runs of a grid [-]."""

    bias: float
    """Mean."""
    std: float
    """Standard deviation."""
    largest: float
    """Largest absolute error."""

    @classmethod
    def of(cls, error: Array) -> SlipErrors:
        """Of errors (n,) [-]."""
        return cls(float(error.mean()), float(error.std()), float(np.abs(error).max()))


@dataclass(frozen=True)
class RunCount:
    """Runs of a grid."""

    used: int
    """Those from which slip could be identified."""
    all: int


@dataclass(frozen=True)
class SensitivityRow:
    """One disturbance and its consequences."""

    effect: str
    """Name of the disturbance."""
    settings: Mapping[str, Setting]
    """What differs from the nominal experiment."""
    slip_error: OuterInner[SlipErrors] | None
    """None where no run could be used."""
    localization: LocalizationErrors
    """Of all runs."""
    runs: RunCount
    warnings: tuple[str, ...]
    """Why runs could not be used."""


def sensitivity_row(
    disturbance: Disturbance, logs: Sequence[RunLog], geometry: RobotGeometry, motion: str | None
) -> SensitivityRow:
    """Evaluate the runs of a disturbed grid of left turns with a motion method, by default the most exact one."""
    slip, warnings = slip_errors(logs, geometry, motion)
    return SensitivityRow(
        effect=disturbance.name,
        settings=disturbance.settings,
        slip_error=None
        if slip is None
        else OuterInner(outer=SlipErrors.of(slip[:, 1]), inner=SlipErrors.of(slip[:, 0])),
        localization=LocalizationErrors.of(logs),
        runs=RunCount(used=0 if slip is None else len(slip), all=len(logs)),
        warnings=warnings,
    )


def slip_errors(
    logs: Sequence[RunLog], geometry: RobotGeometry, motion: str | None
) -> tuple[Array | None, tuple[str, ...]]:
    """Errors (n, 2) [-] of slip in the runs that can be used, None where none can; and why the others cannot."""
    try:
        sampling = usable_samples(logs, geometry, method=motion)
    except LogError as error:
        return None, (str(error),)
    truth = true_samples([log for log in logs if log.run in sampling.samples.run], geometry)
    return sampling.samples.slip - truth.slip, (*sampling.notes, *map(str, sampling.refused))
