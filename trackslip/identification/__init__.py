"""Runs -> steady slip samples -> slip laws fitted to them, with intervals, compared."""

from trackslip.identification.comparison import Comparison, CrossValidation, compare_laws, cross_validate
from trackslip.identification.coverage import coverage, noise_coverage
from trackslip.identification.families import FAMILIES, LawFamily, Parameter, law_from_values
from trackslip.identification.fitted import FittedLaw, fit_law
from trackslip.identification.identify import Identification, identify
from trackslip.identification.outliers import split_outliers
from trackslip.identification.replicates import LackOfFit
from trackslip.identification.samples import (
    Refused,
    Sampling,
    SlipSamples,
    slip_samples,
    true_samples,
    usable_rows,
    usable_samples,
)

__all__ = [
    "FAMILIES",
    "Comparison",
    "CrossValidation",
    "FittedLaw",
    "Identification",
    "LackOfFit",
    "LawFamily",
    "Parameter",
    "Refused",
    "Sampling",
    "SlipSamples",
    "compare_laws",
    "coverage",
    "cross_validate",
    "fit_law",
    "identify",
    "law_from_values",
    "noise_coverage",
    "slip_samples",
    "split_outliers",
    "true_samples",
    "usable_rows",
    "usable_samples",
]
