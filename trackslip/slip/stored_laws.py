"""Laws as stored, by `identify` or in a file of laws, with everything else that is known of them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from trackslip.errors import InvalidValueError, LogError
from trackslip.kinematics import RobotGeometry
from trackslip.logs.file_format import MANIFEST, require_known_format, require_known_manifest
from trackslip.slip.base import SlipLaw
from trackslip.slip.constant import NoSlip
from trackslip.slip.families import FAMILIES, RETIRED, law_from_values, retired_note
from trackslip.slip.nested import entry, number

NO_SLIP = "none"
"""Name of the law of a robot that doesn't slip."""
SHIPPED = Path(__file__).parent / "laws.json"
"""Laws of the default robot on the default ground, made by `trackslip reproduce`."""


@dataclass(frozen=True)
class StoredLaws:
    """The laws of a robot, and everything else that the file of laws says."""

    name: str
    """What messages and comments call the file; without the folders that lead to it."""
    geometry: RobotGeometry
    """Of the robot that the laws were identified for."""
    laws: Mapping[str, SlipLaw]
    """Laws by family name; `none` is always there."""
    content: Mapping[str, Any]
    """Content of the file."""
    manifest: Mapping[str, Any]
    """Content of the manifest beside it; empty where there is none."""

    def require_robot(self, robot: RobotGeometry) -> None:
        """Raise LogError if the laws are for a robot of another geometry."""
        mine, theirs = self.geometry, robot
        if not np.allclose((mine.half_gauge, mine.sprocket_radius), (theirs.half_gauge, theirs.sprocket_radius)):
            raise LogError(
                f"{self.name}: its laws are for half_gauge = {mine.half_gauge:g} m and sprocket_radius = "
                f"{mine.sprocket_radius:g} m, the robot has {theirs.half_gauge:g} m and {theirs.sprocket_radius:g} m"
            )

    def law_named(self, name: str | None) -> str:
        """`name` if there is such a law; for None the best law, the only one, or the one that fits best.

        Raises InvalidValueError for another name, LogError where the file says nothing of which law is best.
        """
        if name is not None:
            if name not in self.laws:
                raise InvalidValueError(
                    "law", name, f"one of {', '.join(self.laws)} (in {self.name}){retired_note(name)}"
                )
            return name
        best = self.content.get("best")
        if isinstance(best, str) and best in self.laws:
            return best
        if best in RETIRED:
            raise LogError(f"{self.name}: its best law is {best}: choose another{retired_note(best)}")
        identified = [name for name in self.laws if name != NO_SLIP]
        errors = {name: number(self.content, "slip_laws", name, "rms") for name in identified}
        known = {name: error for name, error in errors.items() if error is not None}
        if len(identified) == 1:
            return identified[0]
        if not identified or len(known) < len(identified):
            choice = f"choose one of {', '.join(identified)}" if identified else "it holds no law"
            raise LogError(f"{self.name}: says nothing of which law is best: {choice}")
        return min(known, key=lambda name: known[name])

    def values(self, law: str) -> dict[str, float]:
        """Parameters of a law by name, in SI units."""
        return {name: float(getattr(self.laws[law], name)) for name in FAMILIES[law].names}

    def drive_fit(self, law: str) -> Mapping[str, Any] | None:
        """What is stored of the law's fit to whole drives; None if it wasn't fitted to any."""
        found = entry(self.content, "drive", "laws", law)
        return found if isinstance(found, Mapping) else None

    def fit(self, law: str) -> Mapping[str, Any]:
        """What is stored of the fit that the law comes from; empty where nothing is."""
        steady, short = (entry(self.content, key, law) for key in ("laws", "slip_laws"))
        drive = self.drive_fit(law)
        inner = drive if self.content.get("method") == "drive" or steady is None else steady
        return next((one for one in (inner, short) if isinstance(one, Mapping)), {})

    def interval95(self, law: str, parameter: str) -> tuple[float, float] | None:
        """95 % interval of a parameter; None where it is not known, as for one that was held."""
        for keys in (("slip_laws", law), ("laws", law)):
            low, high = (number(self.content, *keys, "interval95", parameter, k) for k in (0, 1))
            if low is not None and high is not None:
                return low, high
        return None


def read_stored(path: Path, robot: RobotGeometry | None = None) -> StoredLaws:
    """The laws in a JSON file, or in the summary.json of a folder of results.

    Raises LogError if there are none, or, where `robot` is given, if they were identified for another geometry.
    """
    content, file = read_content(path)
    manifest = path / MANIFEST
    about = json.loads(manifest.read_text(encoding="utf-8")) if path.is_dir() and manifest.is_file() else {}
    parse_laws(content, file)  # errors name the whole path
    return stored_laws(content, _short(path, file), about, robot)


def stored_laws(
    content: Mapping[str, Any],
    name: str,
    manifest: Mapping[str, Any] | None = None,
    robot: RobotGeometry | None = None,
) -> StoredLaws:
    """The laws in the content of such a file, called `name` in messages; raises LogError as `read_stored` does."""
    geometry, laws = parse_laws(content, name)
    if not laws and content.get("best") not in (NO_SLIP, *RETIRED):
        raise LogError(f"{name}: no slip laws in it")
    stored = StoredLaws(name, geometry, {NO_SLIP: NoSlip(), **laws}, content, manifest or {})
    if robot is not None:
        stored.require_robot(robot)
    return stored


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


def _short(path: Path, file: Path) -> str:
    """What to call a file: nothing of the machine's folders, as the name goes into comments."""
    if file == SHIPPED:
        return "the laws shipped with trackslip"
    return file.name if file == path else f"{path.resolve().name}/{file.name}"
