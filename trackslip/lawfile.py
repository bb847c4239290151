"""Identified slip laws to and from JSON: the `slip_laws` of a summary, with the geometry they were identified for."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from trackslip.errors import InvalidValueError, LogError
from trackslip.identification import LAW_MODELS, FittedLaw, law_from_values
from trackslip.kinematics import RobotGeometry
from trackslip.slip import SlipLaw

SHIPPED = Path(__file__).parent / "laws.json"
"""Laws of the default robot on the default ground, made by `trackslip reproduce`."""


def laws_to_json(laws: Mapping[str, FittedLaw], geometry: RobotGeometry) -> dict[str, Any]:
    """What goes into a summary: `slip_laws` and `geometry`."""
    return {
        "geometry": {"half_gauge": geometry.half_gauge, "sprocket_radius": geometry.sprocket_radius},
        "slip_laws": {name: {"values": fit.values, "stderr": fit.stderr, "rms": fit.rms} for name, fit in laws.items()},
    }


def load_laws(path: Path = SHIPPED) -> dict[str, SlipLaw]:
    """The laws in a JSON file, or in the summary.json of a folder.

    Raises:
        LogError: for a file that isn't there, or isn't what `laws_to_json` makes.
    """
    file = path / "summary.json" if path.is_dir() else path
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        half_gauge = float(content["geometry"]["half_gauge"])
        stored = content["slip_laws"]
        return {
            name: law_from_values(name, stored[name]["values"], half_gauge) for name in LAW_MODELS if name in stored
        }
    except OSError as error:
        raise LogError(f"{file}: {error.strerror}") from error
    except json.JSONDecodeError as error:
        raise LogError(f"{file}: not JSON ({error})") from error
    except (KeyError, TypeError) as error:
        raise LogError(f"{file}: no slip laws in it (missing {error})") from error
    except InvalidValueError as error:
        raise LogError(f"{file}: {error}") from error
