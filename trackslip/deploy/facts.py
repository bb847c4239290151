"""Facts about a deployed law, as comments and as JSON: parameters, intervals, origin, gain and warnings."""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Iterable
from typing import Any

from trackslip.deploy.prediction import gain_lines, prediction_errors
from trackslip.errors import counted
from trackslip.logs.file_format import installed_version
from trackslip.slip.families import FAMILIES
from trackslip.slip.law_file import NO_SLIP, StoredLaws, entry, laws_content, number, text, texts

_MAX_LENGTH = 200  # of a line taken from a file
_MAX_NAMES = 5  # of drives
_MAX_WARNINGS = 12
_SPELLED = str.maketrans(
    {
        **{"±": "+/-", "°": " deg", "ε": "epsilon", "τ": "tau", "ψ": "psi", "²": "^2", "·": "*", "×": "x"},
        **{"−": "-", "–": "-", "—": "-", "’": "'", "…": "...", "µ": "u", "\\": "/"},
    }
)


def fact_lines(stored: StoredLaws, law: str) -> list[str]:
    """The facts about a law as lines of ASCII, for comments."""
    robot = stored.geometry
    lines = [
        f"Slip law {law}: {FAMILIES[law].title}. Written by trackslip {installed_version()}; SI units, radians.",
        *_parameter_lines(stored, law),
        f"Robot: half gauge b = {robot.half_gauge!r} m, sprocket radius r = {robot.sprocket_radius!r} m",
        *_origin_lines(stored),
    ]
    if len(sensor := _sensor(stored, law)) == 3:
        x, y, yaw = sensor.values()
        lines.append(
            f"The poses' sensor, seen from the turning centre: {x:.4f} m ahead, {y:.4f} m to the left, "
            f"turned by {math.degrees(yaw):.2f} deg counter-clockwise"
        )
    lines += [*gain_lines(stored, law), *(f"warning: {warning}" for warning in _warnings(stored, law))]
    return [_plain(line) for line in lines]


def json_text(stored: StoredLaws, law: str) -> str:
    """JSON of one law, which `load_laws` also reads; docs/ros.md describes its keys."""
    values = stored.values(law)
    intervals = {name: stored.interval95(law, name) for name in values}
    stderr = {name: number(stored.content, "slip_laws", law, "stderr", name) for name in values}
    described = {law: {"values": values, "stderr": stderr, "interval95": intervals}} if values else {}
    predictions = {
        name: [
            {"what": what, "seconds_ahead": ahead, "rms": size}
            for (what, ahead), size in prediction_errors(stored, name).items()
        ]
        for name in dict.fromkeys((NO_SLIP, law))
    }
    content: dict[str, Any] = {"law": law, "title": FAMILIES[law].title, "best": law}
    content |= laws_content(described, stored.geometry)
    content["units"] = {name: FAMILIES[law].parameters[name].unit or "-" for name in values}
    content["identified_from"] = {
        "file": stored.name,
        "arguments": texts(stored.manifest, "arguments"),
        "log": text(stored.manifest, "config", "path") or None,
        "created": text(stored.manifest, "created") or None,
        "trackslip": text(stored.manifest, "versions", "trackslip") or None,
        "method": text(stored.content, "method") or None,
        "drives": texts(stored.content, "drive", "drives"),
    }
    content["sensor"] = _sensor(stored, law) or None
    content["prediction"] = predictions
    content["warnings"] = _warnings(stored, law)
    content["comments"] = fact_lines(stored, law)
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def comment(lines: Iterable[str], mark: str) -> str:
    """Lines with a mark in front."""
    return "".join(f"{mark} {line}".rstrip() + "\n" for line in lines)


def _parameter_lines(stored: StoredLaws, law: str) -> list[str]:
    lines = []
    for name, value in stored.values(law).items():
        unit = FAMILIES[law].parameters[name].unit or "-"
        ends, error = stored.interval95(law, name), number(stored.content, "slip_laws", law, "stderr", name)
        about = "" if error is None else f", standard error {error:.3g}"
        about = about if ends is None else f", 95 % interval {ends[0]:.6g} to {ends[1]:.6g}"
        lines.append(f"  {name} = {value!r} [{unit}]{about}")
    return lines


def _origin_lines(stored: StoredLaws) -> list[str]:
    """Origin of the laws: command, version, date and log, drives or samples, ground."""
    manifest, content = stored.manifest, stored.content
    arguments, version = texts(manifest, "arguments"), text(manifest, "versions", "trackslip")
    command = shlex.join(["trackslip", *arguments]) if arguments else text(content, "made_by")
    made = [f"made by `{command}`" * bool(command), f"trackslip {version}" * bool(version), text(manifest, "created")]
    log, drives, samples = (
        text(manifest, "config", "path"),
        texts(content, "drive", "drives"),
        number(content, "samples"),
    )
    sources = [f"log {log}"] if log else []
    if content.get("method") == "drive" and drives:
        more = f" and {len(drives) - _MAX_NAMES} more" if len(drives) > _MAX_NAMES else ""
        sources.append(f"{counted(len(drives), 'drive')}: {', '.join(drives[:_MAX_NAMES])}{more}")
    elif samples is not None:
        sources.append(counted(int(samples), "steady sample"))
    along, across = (number(manifest, "ground", direction) for direction in ("along", "across"))
    if along is not None and across is not None:
        sources.append(f"simulated ground: friction {along:g} along, {across:g} across")
    lines = [", ".join([f"Laws from {stored.name}", *filter(None, made)])]
    return [*lines, f"Identified from {'; '.join(sources)}"] if sources else lines


def _sensor(stored: StoredLaws, law: str) -> dict[str, float]:
    """Place and yaw of the poses' sensor, as far as they were identified with a law [m, m, rad]."""
    if stored.content.get("method") != "drive":
        return {}
    names = ("sensor_x", "sensor_y", "sensor_yaw")
    found = {name: number(stored.content, "drive", "laws", law, "extras", name) for name in names}
    return {name: value for name, value in found.items() if value is not None}


def _warnings(stored: StoredLaws, law: str) -> list[str]:
    """Warnings of the identification that concern a law, and the parameters that were held."""
    others = tuple(f"law {name}:" for name in FAMILIES if name != law)
    by_drives = stored.content.get("method") == "drive"
    unrelated = [] if by_drives else texts(stored.content, "drive", "warnings")  # of laws that are not deployed
    warnings = texts(stored.content, "warnings")
    found = [line for line in warnings if not line.startswith(others) and line not in unrelated]
    held = entry(stored.content, "drive", "laws", law, "held") if by_drives else None
    for name, reason in held.items() if isinstance(held, dict) else ():
        if reason != "none shows" and not any(name in line for line in found):
            found.append(f"{name} is held: {reason}")
    if len(found) > _MAX_WARNINGS:
        found = [*found[:_MAX_WARNINGS], f"{len(found) - _MAX_WARNINGS} more in {stored.name}"]
    return found


def _plain(line: str) -> str:
    """A line as ASCII that is safe in comments of any language."""
    blank = "".join(c if c.isprintable() else " " for c in line.translate(_SPELLED))
    ascii_only = blank.encode("ascii", "replace").decode().rstrip()
    for closing in ("*/", "/*", "??"):  # ends, begins and trigraphs of C
        while closing in ascii_only:
            ascii_only = ascii_only.replace(closing, f"{closing[0]} {closing[1]}")
    return ascii_only if len(ascii_only) <= _MAX_LENGTH else f"{ascii_only[: _MAX_LENGTH - 4]} ..."
