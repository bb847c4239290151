"""What every deployed law says of itself: parameters, intervals, origin, what it gains, and warnings."""

from __future__ import annotations

import importlib.metadata
import math
import shlex
from collections.abc import Iterable

from trackslip.deploy.prediction import gain_lines
from trackslip.slip.families import FAMILIES
from trackslip.slip.nested import entry, number, text, texts
from trackslip.slip.stored_laws import StoredLaws

_MAX_LENGTH = 200  # of a line taken from a file
_MAX_NAMES = 5  # of drives
_MAX_WARNINGS = 12
_SPELLED = {
    **{"±": "+/-", "°": " deg", "ε": "epsilon", "τ": "tau", "ψ": "psi", "²": "^2", "·": "*", "×": "x"},
    **{"−": "-", "–": "-", "—": "-", "’": "'", "…": "...", "µ": "u", "\\": "/"},
}  # fmt: skip


def fact_lines(stored: StoredLaws, law: str) -> list[str]:
    """The facts about a law as lines of ASCII, for comments."""
    robot = stored.geometry
    lines = [
        f"Slip law {law}: {FAMILIES[law].title}. Written by trackslip {_version()}; SI units, radians.",
        *_parameter_lines(stored, law),
        f"Robot: half gauge b = {robot.half_gauge!r} m, sprocket radius r = {robot.sprocket_radius!r} m",
        *origin_lines(stored),
        *_sensor_lines(stored, law),
        *gain_lines(stored, law),
        *(f"warning: {warning}" for warning in warnings_of(stored, law)),
    ]
    return [plain(line) for line in lines]


def origin_lines(stored: StoredLaws) -> list[str]:
    """What the laws were identified from: command, version, date and log, drives or samples, ground."""
    manifest, content = stored.manifest, stored.content
    command = shlex.join(["trackslip", *texts(manifest, "arguments")]) if texts(manifest, "arguments") else ""
    command, version = command or text(content, "made_by"), text(manifest, "versions", "trackslip")
    created = text(manifest, "created")
    made = [f"made by `{command}`" if command else "", f"trackslip {version}" if version else "", created]
    lines = [", ".join([f"Laws from {stored.name}", *(part for part in made if part)])]
    log = text(manifest, "config", "path")
    what = [f"log {log}"] if log else []
    drives, samples = texts(content, "drive", "drives"), number(content, "samples")
    if content.get("method") == "drive" and drives:
        more = f" and {len(drives) - _MAX_NAMES} more" if len(drives) > _MAX_NAMES else ""
        what.append(f"{len(drives)} drive(s): {', '.join(drives[:_MAX_NAMES])}{more}")
    elif samples is not None:
        what.append(f"{samples:g} steady samples")
    along, across = number(manifest, "ground", "along"), number(manifest, "ground", "across")
    if along is not None and across is not None:
        what.append(f"simulated ground: friction {along:g} along, {across:g} across")
    return [*lines, *([f"Identified from {'; '.join(what)}"] if what else [])]


def warnings_of(stored: StoredLaws, law: str) -> list[str]:
    """Warnings of the identification, without those about other laws, and which parameters were held."""
    others = tuple(f"law {name}:" for name in FAMILIES if name != law)
    by_drives = stored.content.get("method") == "drive"
    beside = [] if by_drives else texts(stored.content, "drive", "warnings")  # of laws that are not deployed
    warnings = texts(stored.content, "warnings")
    found = [line for line in warnings if not line.startswith(others) and line not in beside]
    held = entry(stored.content, "drive", "laws", law, "held") if by_drives else None
    for name, reason in held.items() if isinstance(held, dict) else ():
        if reason != "none shows" and not any(name in line for line in found):
            found.append(f"{name} is held: {reason}")
    if len(found) > _MAX_WARNINGS:
        found = [*found[:_MAX_WARNINGS], f"{len(found) - _MAX_WARNINGS} more in {stored.name}"]
    return found


def sensor_of(stored: StoredLaws, law: str) -> dict[str, float]:
    """Place and yaw of the poses' sensor that were identified with a law [m, m, rad]; empty where they weren't."""
    if stored.content.get("method") != "drive":
        return {}
    names = ("sensor_x", "sensor_y", "sensor_yaw")
    found = {name: number(stored.content, "drive", "laws", law, "extras", name) for name in names}
    return {name: value for name, value in found.items() if value is not None}


def plain(line: str) -> str:
    """A line as ASCII that no comment of any language stumbles over."""
    for character, spelled in _SPELLED.items():
        line = line.replace(character, spelled)
    blank = "".join(c if c.isprintable() else " " for c in line)
    ascii_only = blank.encode("ascii", "replace").decode().rstrip()
    for closing in ("*/", "/*", "??"):  # ends, begins and trigraphs of C
        while closing in ascii_only:
            ascii_only = ascii_only.replace(closing, f"{closing[0]} {closing[1]}")
    return ascii_only if len(ascii_only) <= _MAX_LENGTH else f"{ascii_only[: _MAX_LENGTH - 4]} ..."


def commented(lines: Iterable[str], mark: str) -> str:
    """Lines with a mark in front."""
    return "".join(f"{mark} {line}".rstrip() + "\n" for line in lines)


def _parameter_lines(stored: StoredLaws, law: str) -> list[str]:
    lines = []
    for name, value in stored.values(law).items():
        unit = FAMILIES[law].parameters[name].unit or "-"
        ends, error = stored.interval95(law, name), number(stored.content, "slip_laws", law, "stderr", name)
        about = ""
        if ends is not None:
            about = f", 95 % interval {ends[0]:.6g} to {ends[1]:.6g}"
        elif error is not None:
            about = f", standard error {error:.3g}"
        lines.append(f"  {name} = {value!r} [{unit}]{about}")
    return lines


def _sensor_lines(stored: StoredLaws, law: str) -> list[str]:
    sensor = sensor_of(stored, law)
    if len(sensor) < 3:
        return []
    x, y, yaw = sensor.values()
    return [
        f"The poses' sensor, seen from the turning centre: {x:.4f} m ahead, {y:.4f} m to the left, "
        f"turned by {math.degrees(yaw):.2f} deg counter-clockwise"
    ]


def _version() -> str:
    try:
        return importlib.metadata.version("trackslip")
    except importlib.metadata.PackageNotFoundError:
        return "(unknown version)"
