"""What a summary.json says of an identification."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from trackslip.identification.comparison import Comparison
from trackslip.identification.fitted import FittedLaw
from trackslip.identification.result import Identification
from trackslip.kinematics import RobotGeometry
from trackslip.slip.law_file import laws_content


def laws_to_json(laws: Mapping[str, FittedLaw], geometry: RobotGeometry) -> dict[str, Any]:
    """`slip_laws` and `geometry`, as `load_laws` reads them."""
    described = {
        name: {"values": fit.values, "stderr": fit.stderr, "rms": fit.rms} for name, fit in laws.items() if fit.values
    }
    return laws_content(described, geometry)


def identification_to_json(found: Identification) -> dict[str, Any]:
    """`laws_to_json`, and `laws` with everything known of each law, and what was left out."""
    return laws_to_json(found.comparison.laws, found.geometry) | {
        "laws": {name: _law_to_json(name, found.comparison) for name in found.comparison.laws},
        "best": found.best,
        "samples": len(found.samples),
        "outliers": [{"run": outlier.run, "reason": outlier.reason} for outlier in found.outliers],
        "warnings": list(found.warnings),
    }


def _law_to_json(name: str, comparison: Comparison) -> dict[str, Any]:
    fit, validation = comparison.laws[name], comparison.validation[name]
    lack = fit.lack_of_fit
    return {
        "values": fit.values,
        "stderr": fit.stderr,
        "interval95": {key: list(ends) for key, ends in fit.interval95.items()},
        "bootstrap95": {key: list(ends) for key, ends in fit.bootstrap95.items()},
        "noise_stderr": fit.noise_stderr,
        "correlation": fit.correlation.tolist(),
        "rms": fit.rms,
        "scatter": fit.scatter,
        "aicc": comparison.aicc[name],
        "weight": comparison.weight[name],
        "cv_radius": validation.radius,
        "cv_speed": validation.speed,
        "cv_yaw_rate": validation.yaw_rate,
        "lack_of_fit": None
        if lack is None
        else {
            "test": lack.test,
            "statistic": lack.statistic,
            "freedom": list(lack.freedom),
            "probability": lack.probability,
            "inflation": lack.inflation,
        },
    }
