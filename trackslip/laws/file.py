"""Slip laws in JSON files, with the robot's geometry and further results of the identification."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import asdict, astuple, dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from trackslip.arguments import checks_arguments
from trackslip.errors import InvalidValueError, LogError, OutputError, require_one_of
from trackslip.files import FORMAT, known_manifest, read_json, reason, require_known_format
from trackslip.kinematics import RobotGeometry
from trackslip.laws.base import NoSlip, SlipLaw
from trackslip.laws.families import FAMILIES, family, law_from_values

NO_SLIP: Final = "none"
"""Name of the law without slip."""
SHIPPED: Final = Path(__file__).parent / "laws.json"
"""File with the laws of the default robot on the default ground, from `trackslip reproduce`."""


@dataclass(frozen=True)
class StoredLaws:
    """The laws in a file, with the rest of the file's content."""

    name: str  # name of the file in messages and comments, without its folder
    geometry: RobotGeometry  # geometry of the robot for which the laws were identified
    laws: Mapping[str, SlipLaw]  # laws by family name, always including `none`
    content: Mapping[str, Any]  # content of the file
    # content of the manifest next to the file; empty without a manifest
    manifest: Mapping[str, Any]

    def law_named(self, name: str | None) -> str:
        """Return `name`, or for None the name of the best law according to the file or of the only
        law.

        Raises InvalidValueError for an unknown name, and LogError if the file doesn't say which of
        its laws is best.
        """
        if name is not None:
            require_one_of("law", name, self.laws, f" (in {self.name})")
            return name
        best = self.content.get("best")
        if isinstance(best, str) and best in self.laws:
            return best
        identified = [law for law in self.laws if law != NO_SLIP]
        if len(identified) != 1:
            choice = f"choose one of {', '.join(identified)}" if identified else "it holds no law"
            raise LogError(f"{self.name}: says nothing of which law is best: {choice}")
        return identified[0]

    def values(self, law: str) -> dict[str, float]:
        """Values of a law's parameters by name, in SI units."""
        return {name: float(getattr(self.laws[law], name)) for name in FAMILIES[law].names}

    def drive_fit(self, law: str) -> Mapping[str, Any] | None:
        """Stored fit of the law to whole drives; None without such a fit."""
        found = entry(self.content, "drive", "laws", law)
        return found if isinstance(found, Mapping) else None

    def fit(self, law: str) -> Mapping[str, Any]:
        """Stored fit from which the law comes; empty if none is stored."""
        by_runs = entry(self.content, "laws", law)
        by_drives = self.drive_fit(law)
        is_of_drives = self.content.get("method") == "drive" or by_runs is None
        full = by_drives if is_of_drives else by_runs
        values_alone = entry(self.content, "slip_laws", law)
        for fit in (full, values_alone):
            if isinstance(fit, Mapping):
                return fit
        return {}

    def interval95(self, law: str, parameter: str) -> tuple[float, float] | None:
        """95 % interval of a parameter; None if unknown, for example because the parameter was
        fixed.
        """
        interval = ("slip_laws", law, "interval95", parameter)
        low = number(self.content, *interval, 0)
        high = number(self.content, *interval, 1)
        return None if low is None or high is None else (low, high)


@checks_arguments
def load_laws(path: str | Path = SHIPPED, robot: RobotGeometry | None = None) -> dict[str, SlipLaw]:
    """Read the laws in a JSON file, or in the summary.json of a results folder, by family name.

    If `robot` is given, the laws must have been identified for this geometry. Raises LogError if
    the file does not exist, holds no slip laws, is for another robot, or was written by a newer
    version.
    """
    laws = read_stored(Path(path), robot).laws
    return {name: law for name, law in laws.items() if name != NO_SLIP}


@checks_arguments
def save_laws(path: str | Path, laws: Mapping[str, SlipLaw], geometry: RobotGeometry) -> None:
    """Write laws by family name to a JSON file for `load_laws` and the command-line option
    `--laws`.

    `geometry` is that of the robot for which the laws were identified. Laws without parameters are
    not stored.

    Raises:
        InvalidValueError: if a name is not the name of a family, or a law does not belong to the
            family of its name.
        OutputError: if the file cannot be written.
    """
    stored: dict[str, dict[str, Any]] = {}
    for name, law in laws.items():
        values = {key: getattr(law, key, None) for key in family(name).names}
        if law_from_values(name, values, geometry.half_gauge) != law:
            raise InvalidValueError(name, law, f"a law of the family {name!r} for this geometry")
        numbers = {key: float(value) for key, value in values.items() if value is not None}
        if numbers:
            stored[name] = {"values": numbers}
    text = json.dumps(laws_content(stored, geometry), indent=2) + "\n"
    try:
        Path(path).write_text(text, encoding="utf-8")
    except (OSError, ValueError) as error:
        cause = getattr(error, "strerror", None) or error
        raise OutputError(f"{path}: cannot be written ({cause})") from error


def laws_content(laws: Mapping[str, Mapping[str, Any]], geometry: RobotGeometry) -> dict[str, Any]:
    """Build the content of a laws file. Each family name maps to the law's `values` and,
    optionally, other entries.
    """
    return {"format": FORMAT, "geometry": asdict(geometry), "slip_laws": dict(laws)}


def read_stored(path: Path, robot: RobotGeometry | None = None) -> StoredLaws:
    """Read the laws in a JSON file, or in the summary.json of a results folder, with the rest of
    the content.

    Raises LogError like `load_laws`.
    """
    if path.is_dir():
        file = path / "summary.json"
        manifest = known_manifest(path)
        # the name appears in code for other programs, so it must not contain local folders
        name = f"{path.resolve().name}/{file.name}"
    else:
        file = path
        manifest = {}
        name = "the laws shipped with trackslip" if path == SHIPPED else path.name
    stored = stored_laws(read_json(file), str(file), manifest, robot)
    return replace(stored, name=name)


def stored_laws(
    content: Any,
    name: str,
    manifest: Mapping[str, Any] | None = None,
    robot: RobotGeometry | None = None,
) -> StoredLaws:
    """Extract the laws from the content of a file, called `name` in messages. Raises LogError like
    `load_laws`.
    """
    try:
        require_known_format(content, name)
        geometry = RobotGeometry(
            half_gauge=float(content["geometry"]["half_gauge"]),
            sprocket_radius=float(content["geometry"]["sprocket_radius"]),
        )
        stored = content["slip_laws"]
        laws = {
            law: law_from_values(law, stored[law]["values"], geometry.half_gauge)
            for law in FAMILIES
            if law in stored
        }
    except InvalidValueError as error:
        raise LogError(f"{name}: {error}") from error
    except LogError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise LogError(f"{name}: no slip laws in it ({reason(error)})") from error
    if not laws and content.get("best") != NO_SLIP:
        unknown = ", ".join(stored)
        only = f" of a known family, only {unknown}: import the module that adds it to FAMILIES"
        raise LogError(f"{name}: no slip laws{only if unknown else ' in it'}")
    if robot is not None and not np.allclose(astuple(geometry), astuple(robot)):
        raise LogError(
            f"{name}: its laws are for half_gauge = {geometry.half_gauge:g} m and "
            f"sprocket_radius = {geometry.sprocket_radius:g} m, the robot has "
            f"{robot.half_gauge:g} m and {robot.sprocket_radius:g} m"
        )
    return StoredLaws(
        name=name,
        geometry=geometry,
        laws={NO_SLIP: NoSlip(), **laws},
        content=content,
        manifest=manifest or {},
    )


def entry(content: Any, *keys: str | int) -> Any:
    """The value at nested keys or list indices in the content of a JSON file; None if missing."""
    for key in keys:
        try:
            content = content[key]
        except (LookupError, TypeError):
            return None
    return content


def number(content: Any, *keys: str | int) -> float | None:
    """The finite number at nested keys; None if missing or not a finite number."""
    found = entry(content, *keys)
    if isinstance(found, bool) or not isinstance(found, int | float):
        return None
    is_finite = abs(found) <= sys.float_info.max  # false for NaN, and for integers too large
    return float(found) if is_finite else None


def text(content: Any, *keys: str | int) -> str:
    """The text at nested keys; empty if missing or not a text."""
    found = entry(content, *keys)
    return found if isinstance(found, str) else ""
