"""Slip laws in JSON files, with the geometry they were identified for."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from trackslip.errors import InvalidValueError, OutputError
from trackslip.kinematics import RobotGeometry
from trackslip.logs.file_format import FORMAT
from trackslip.slip.base import SlipLaw
from trackslip.slip.families import family, law_from_values
from trackslip.slip.stored_laws import NO_SLIP, SHIPPED, read_stored


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
    return {name: law for name, law in read_stored(Path(path), robot).laws.items() if name != NO_SLIP}
