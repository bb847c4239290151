"""Identified laws as stored, with what is known of where they come from."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trackslip.errors import InvalidValueError, LogError
from trackslip.kinematics import RobotGeometry
from trackslip.logs.file_format import MANIFEST
from trackslip.slip.base import SlipLaw
from trackslip.slip.constant import NoSlip
from trackslip.slip.families import FAMILIES
from trackslip.slip.law_file import SHIPPED, parse_laws, read_content

NO_SLIP = "none"


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

    def law_named(self, name: str | None) -> str:
        """`name` if there is such a law; for None the best law.

        Raises InvalidValueError for another name, LogError where the file says nothing of which law is best.
        """
        if name is not None:
            if name not in self.laws:
                raise InvalidValueError("law", name, f"one of {', '.join(self.laws)} (in {self.name})")
            return name
        best = self.content.get("best")
        if isinstance(best, str) and best in self.laws:
            return best
        identified = [name for name in self.laws if name != NO_SLIP]
        errors = {name: number(self.content, "slip_laws", name, "rms") for name in identified}
        known = {name: error for name, error in errors.items() if error is not None}
        if len(identified) == 1:
            return identified[0]
        if not identified or len(known) < len(identified):
            held = ", ".join(identified) or "no law"
            raise LogError(f"{self.name}: says nothing of which law is best: choose with --law; it holds {held}")
        return min(known, key=lambda name: known[name])

    def interval95(self, law: str, parameter: str) -> tuple[float, float] | None:
        """95 % interval of a parameter; None where it is not known, as for one that was held."""
        for keys in (("slip_laws", law), ("laws", law)):
            low, high = (number(self.content, *keys, "interval95", parameter, k) for k in (0, 1))
            if low is not None and high is not None:
                return low, high
        return None


def read_stored(path: Path) -> StoredLaws:
    """The laws in a JSON file, or in the summary.json of a folder of results; raises LogError if there are none."""
    content, file = read_content(path)
    manifest = path / MANIFEST
    about = json.loads(manifest.read_text(encoding="utf-8")) if path.is_dir() and manifest.is_file() else {}
    parse_laws(content, file)  # errors name the whole path
    return stored_laws(content, _short(path, file), about)


def stored_laws(content: Mapping[str, Any], name: str, manifest: Mapping[str, Any] | None = None) -> StoredLaws:
    """The laws in the content of such a file, called `name` in messages; raises LogError if there are none."""
    geometry, laws = parse_laws(content, name)
    if not laws and content.get("best") != NO_SLIP:
        raise LogError(f"{name}: no slip laws in it")
    return StoredLaws(name, geometry, {NO_SLIP: NoSlip(), **laws}, content, manifest or {})


def _short(path: Path, file: Path) -> str:
    """What to call a file: nothing of the machine's folders, as the name goes into comments."""
    if file == SHIPPED:
        return "the laws shipped with trackslip"
    return file.name if file == path else f"{path.resolve().name}/{file.name}"


def values_of(stored: StoredLaws, law: str) -> dict[str, float]:
    """Parameters of a law by name, in SI units."""
    return {name: float(getattr(stored.laws[law], name)) for name in FAMILIES[law].names}


def entry(content: Any, *keys: str | int) -> Any:
    """What is stored under nested keys or places in lists; None where nothing is."""
    for key in keys:
        if isinstance(content, Mapping) and isinstance(key, str):
            content = content.get(key)
        elif isinstance(content, list | tuple) and isinstance(key, int) and key < len(content):
            content = content[key]
        else:
            return None
    return content


def number(content: Any, *keys: str | int) -> float | None:
    """The finite number stored under nested keys; None for anything else."""
    found = entry(content, *keys)
    if isinstance(found, bool) or not isinstance(found, int | float) or not math.isfinite(found):
        return None
    return float(found)


def text(content: Any, *keys: str | int) -> str:
    """The text stored under nested keys; empty for anything else."""
    found = entry(content, *keys)
    return found if isinstance(found, str) else ""


def texts(content: Any, *keys: str | int) -> list[str]:
    """The texts in the list stored under nested keys."""
    found = entry(content, *keys)
    return [one for one in found if isinstance(one, str)] if isinstance(found, list | tuple) else []
