"""Samples -> laws: the whole of it."""

from __future__ import annotations

from dataclasses import dataclass

from trackslip.identification.comparison import Comparison, compare_laws
from trackslip.identification.outliers import split_outliers
from trackslip.identification.samples import Refused, Sampling, SlipSamples
from trackslip.kinematics import RobotGeometry


@dataclass(frozen=True)
class Identification:
    """Laws identified from samples, and what was left out on the way."""

    geometry: RobotGeometry
    samples: SlipSamples
    """Those that the laws were fitted to."""
    outliers: tuple[Refused, ...]
    comparison: Comparison
    warnings: tuple[str, ...]


def identify(sampling: Sampling, geometry: RobotGeometry) -> Identification:
    """Leave out outliers, fit and compare the laws; raises LogError where no law is determined."""
    samples, outliers = split_outliers(sampling.samples, geometry)
    left_out = (*sampling.refused, *outliers)
    comparison = compare_laws(samples, geometry)
    warnings = (*sampling.notes, *map(str, left_out), *comparison.warnings)
    return Identification(geometry, samples, left_out, comparison, warnings)
