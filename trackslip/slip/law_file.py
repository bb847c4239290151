"""Slip laws in JSON files, with the geometry they were identified for."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from trackslip.errors import InvalidValueError, LogError, OutputError
from trackslip.kinematics import RobotGeometry
from trackslip.logs.file_format import FORMAT, require_known_format, require_known_manifest
from trackslip.slip.base import SlipLaw
from trackslip.slip.families import FAMILIES, family, law_from_values

SHIPPED = Path(__file__).parent / "laws.json"
"""Laws of the default robot on the default ground, made by `trackslip reproduce`."""


def laws_content(laws: Mapping[str, Mapping[str, Any]], geometry: RobotGeometry) -> dict[str, Any]:
    """The content of a file of laws: by family name, `values` (the parameters) and whatever else describes the law."""
    return {"format": FORMAT, "geometry": asdict(geometry), "slip_laws": dict(laws)}


def save_laws(path: str | Path, laws: Mapping[str, SlipLaw], geometry: RobotGeometry) -> None:
    """Write laws by family name to a JSON file that `load_laws` and the commands' option `--laws` read.

    The geometry is that of the robot they were identified for. Laws without parameters are not stored.

    Raises:
        InvalidValueError: if a name is not that of a family, or a law does not belong to the family it is named for.
        OutputError: if the file cannot be written.
    """
    stored: dict[str, dict[str, Any]] = {}
    for name, law in laws.items():
        values = {key: getattr(law, key, None) for key in family(name).names}
        if law_from_values(name, values, geometry.half_gauge) != law:
            raise InvalidValueError(name, law, f"a law of the family {name!r} for this geometry")
        if values:
            stored[name] = {"values": {key: float(value) for key, value in values.items() if value is not None}}
    try:
        Path(path).write_text(json.dumps(laws_content(stored, geometry), indent=2) + "\n", encoding="utf-8")
    except (OSError, ValueError) as error:
        raise OutputError(f"{path}: cannot be written ({getattr(error, 'strerror', None) or error})") from error


def load_laws(path: str | Path = SHIPPED, robot: RobotGeometry | None = None) -> dict[str, SlipLaw]:
    """The laws in a JSON file, or in the summary.json of a folder of results, by family name.

    If `robot` is given, the laws must have been identified for this geometry.

    Raises:
        LogError: if the file does not exist, holds no slip laws, or was made for another robot or by a newer version.
    """
    content, file = read_content(Path(path))
    geometry, laws = parse_laws(content, file)
    if robot is not None and not np.allclose(_sizes(geometry), _sizes(robot)):
        raise LogError(
            f"{file}: its laws are for half_gauge = {geometry.half_gauge:g} m and sprocket_radius = "
            f"{geometry.sprocket_radius:g} m, the robot has {robot.half_gauge:g} m and {robot.sprocket_radius:g} m"
        )
    return laws


def read_content(path: Path) -> tuple[Any, Path]:
    """What a JSON file, or the summary.json of a folder of results, holds, and which file it is.

    Raises LogError if the file cannot be read or the folder is of a newer version.
    """
    file = path
    try:
        if path.is_dir():
            file = path / "summary.json"
            require_known_manifest(path)
        return json.loads(file.read_text(encoding="utf-8")), file
    except OSError as error:
        raise LogError(f"{file}: {error.strerror}") from error
    except RecursionError as error:
        raise LogError(f"{file}: not JSON of slip laws (nested too deeply)") from error
    except LogError:
        raise
    except ValueError as error:
        raise LogError(f"{file}: not JSON ({error})") from error


def parse_laws(content: Any, file: object) -> tuple[RobotGeometry, dict[str, SlipLaw]]:
    """Geometry and laws by family name in the content of a file of laws; raises LogError if there are none."""
    try:
        require_known_format(content, file)
        geometry = RobotGeometry(*(float(content["geometry"][key]) for key in ("half_gauge", "sprocket_radius")))
        stored = content["slip_laws"]
        b = geometry.half_gauge
        return geometry, {name: law_from_values(name, stored[name]["values"], b) for name in FAMILIES if name in stored}
    except InvalidValueError as error:
        raise LogError(f"{file}: {error}") from error
    except LogError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise LogError(f"{file}: no slip laws in it ({type(error).__name__}: {error})") from error


def _sizes(geometry: RobotGeometry) -> tuple[float, float]:
    return geometry.half_gauge, geometry.sprocket_radius
