"""Facts about a deployed law as comments and as JSON: parameters, intervals, origin and alarms."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterable
from typing import Any, Final

from trackslip.files import installed_version
from trackslip.laws.families import FAMILIES
from trackslip.laws.file import StoredLaws, entry, laws_content, number, text

_MAX_LENGTH: Final = 200  # maximum length of a line from a file [characters]
_ASCII_SPELLINGS: Final = str.maketrans(
    {
        "±": "+/-",
        "°": " deg",
        "ε": "epsilon",
        "τ": "tau",
        "ψ": "psi",
        "²": "^2",
        "·": "*",
        "×": "x",
        "−": "-",
        "–": "-",
        "—": "-",
        "’": "'",
        "…": "...",
        "µ": "u",
        "\\": "/",
    }
)
# end and start of C comments, and start of C trigraphs
_UNSAFE_IN_COMMENTS: Final = ("*/", "/*", "??")


def alarms_of(stored: StoredLaws) -> list[str]:
    """Alarms raised in the identification, one line each."""
    alarms = entry(stored.content, "alarms")
    if not isinstance(alarms, list | tuple):
        return []
    lines = [text(alarm, "line") for alarm in alarms]
    return [line for line in lines if line]


def fact_lines(stored: StoredLaws, law: str) -> list[str]:
    """Facts about a law as lines of ASCII, for comments."""
    robot = stored.geometry
    lines = [
        f"Slip law {law}: {FAMILIES[law].title}. Written by trackslip {installed_version()}; SI "
        "units, radians.",
        *_parameter_lines(stored, law),
        f"Robot: half gauge b = {robot.half_gauge!r} m, sprocket radius r = "
        f"{robot.sprocket_radius!r} m",
        _origin_line(stored),
        *(f"ALARM: {line}" for line in alarms_of(stored)),
    ]
    return [_plain(line) for line in lines]


def json_text(stored: StoredLaws, law: str) -> str:
    """Write a law as JSON that `load_laws` can read. The keys are described in docs/ros.md."""
    family = FAMILIES[law]
    values = stored.values(law)
    described: dict[str, dict[str, Any]] = {}
    if values:
        described[law] = {
            "values": values,
            "stderr": {
                name: number(stored.content, "slip_laws", law, "stderr", name) for name in values
            },
            "interval95": {name: stored.interval95(law, name) for name in values},
        }
    content: dict[str, Any] = {"law": law, "title": family.title, "best": law}
    content |= laws_content(described, stored.geometry)
    content["units"] = {name: family.parameters[name].unit or "-" for name in values}
    content["alarms"] = alarms_of(stored)
    content["comments"] = fact_lines(stored, law)
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def comment(lines: Iterable[str], mark: str) -> str:
    """Join lines, each with a comment mark in front."""
    return "".join(f"{mark} {line}".rstrip() + "\n" for line in lines)


def _parameter_lines(stored: StoredLaws, law: str) -> list[str]:
    """A line for each parameter of a law: value, unit, interval and meaning."""
    lines = []
    for name, value in stored.values(law).items():
        parameter = FAMILIES[law].parameters[name]
        unit = parameter.unit or "-"
        interval = "no interval"
        ends = stored.interval95(law, name)
        if ends is not None:
            low, high = ends
            interval = f"95 % interval {low:.6g} to {high:.6g}"
        lines.append(f"  {name} = {value!r} [{unit}], {interval}: {parameter.meaning}")
    return lines


def _origin_line(stored: StoredLaws) -> str:
    """A line with the laws' file, and as far as known the command, version and date."""
    parts = [f"Laws from {stored.name}"]
    arguments = entry(stored.manifest, "arguments")
    if isinstance(arguments, list) and arguments:
        command = shlex.join(["trackslip", *map(str, arguments)])
    else:
        command = text(stored.content, "made_by")
    if command:
        parts.append(f"made by `{command}`")
    version = text(stored.manifest, "versions", "trackslip")
    if version:
        parts.append(f"trackslip {version}")
    created = text(stored.manifest, "created")
    if created:
        parts.append(created)
    return ", ".join(parts)


def _plain(line: str) -> str:
    """Convert a line to ASCII that is safe in comments of any language."""
    spelled = line.translate(_ASCII_SPELLINGS)
    printable = "".join(c if c.isprintable() else " " for c in spelled)
    plain = printable.encode("ascii", "replace").decode().rstrip()
    for first, second in _UNSAFE_IN_COMMENTS:
        while first + second in plain:
            plain = plain.replace(first + second, f"{first} {second}")
    if len(plain) > _MAX_LENGTH:
        return f"{plain[: _MAX_LENGTH - 4]} ..."
    return plain
