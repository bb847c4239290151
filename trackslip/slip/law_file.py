"""Identified slip laws to and from JSON: the `slip_laws` of a summary, with the geometry they were identified for."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from trackslip.errors import InvalidValueError, LogError
from trackslip.identification.comparison import Comparison
from trackslip.identification.fitted import FittedLaw
from trackslip.identification.identify import Identification
from trackslip.kinematics import RobotGeometry
from trackslip.logs.file_format import FORMAT, require_known_format, require_known_manifest
from trackslip.slip.base import SlipLaw
from trackslip.slip.families import FAMILIES, law_from_values

SHIPPED = Path(__file__).parent / "laws.json"
"""Laws of the default robot on the default ground, made by `trackslip reproduce`."""


def laws_to_json(laws: Mapping[str, FittedLaw], geometry: RobotGeometry) -> dict[str, Any]:
    """What goes into a summary: `slip_laws` and `geometry`."""
    return {
        "format": FORMAT,
        "geometry": {"half_gauge": geometry.half_gauge, "sprocket_radius": geometry.sprocket_radius},
        "slip_laws": {
            name: {"values": fit.values, "stderr": fit.stderr, "rms": fit.rms}
            for name, fit in laws.items()
            if fit.values
        },
    }


def identification_to_json(found: Identification, geometry: RobotGeometry) -> dict[str, Any]:
    """What goes into a summary of an identification: `laws` with all that is known of each, and what was left out."""
    return laws_to_json(found.comparison.laws, geometry) | {
        "laws": {name: _law_to_json(name, found.comparison) for name in found.comparison.laws},
        "best": found.comparison.best,
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


def load_laws(path: Path = SHIPPED, robot: RobotGeometry | None = None) -> dict[str, SlipLaw]:
    """The laws in a JSON file, or in the summary.json of a folder.

    Args:
        path: the file or folder.
        robot: whom they are for, if that is to be checked.

    Raises:
        LogError: for a file that isn't there, isn't what `laws_to_json` makes, or was made for another robot or by
            a newer version.
    """
    file = path
    try:
        file = path / "summary.json" if path.is_dir() else path
        if path.is_dir():
            require_known_manifest(path)
        content = json.loads(file.read_text(encoding="utf-8"))
        require_known_format(content, file)
        half_gauge, radius = (float(content["geometry"][key]) for key in ("half_gauge", "sprocket_radius"))
        stored = content["slip_laws"]
        if robot is not None and not np.allclose([half_gauge, radius], [robot.half_gauge, robot.sprocket_radius]):
            raise LogError(
                f"{file}: its laws are for half_gauge = {half_gauge:g} m and sprocket_radius = {radius:g} m, "
                f"the robot has {robot.half_gauge:g} m and {robot.sprocket_radius:g} m"
            )
        return {name: law_from_values(name, stored[name]["values"], half_gauge) for name in FAMILIES if name in stored}
    except OSError as error:
        raise LogError(f"{file}: {error.strerror}") from error
    except (json.JSONDecodeError, UnicodeDecodeError, RecursionError) as error:  # or nested too deeply
        raise LogError(f"{file}: not JSON ({error})") from error
    except InvalidValueError as error:
        raise LogError(f"{file}: {error}") from error
    except LogError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise LogError(f"{file}: no slip laws in it ({type(error).__name__}: {error})") from error
