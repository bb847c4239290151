"""Facts about a deployed law as comments and as JSON: parameters, intervals, origin and alarms."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterable
from typing import Any

from trackslip.files import installed_version
from trackslip.laws.families import FAMILIES
from trackslip.laws.file import StoredLaws, entry, laws_content, number, text

_MAX_LENGTH = 200  # maximum length of a line from a file [characters]
_SPELLED = str.maketrans(
    {
        **{
            "±": "+/-",
            "°": " deg",
            "ε": "epsilon",
            "τ": "tau",
            "ψ": "psi",
            "²": "^2",
            "·": "*",
            "×": "x",
        },
        **{"−": "-", "–": "-", "—": "-", "’": "'", "…": "...", "µ": "u", "\\": "/"},
    }
)


def alarms_of(stored: StoredLaws) -> list[str]:
    """Alarms raised in the identification, one line each."""
    found = entry(stored.content, "alarms")
    return (
        [line for alarm in found if (line := text(alarm, "line"))]
        if isinstance(found, list | tuple)
        else []
    )


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
    values = stored.values(law)
    intervals = {name: stored.interval95(law, name) for name in values}
    stderr = {name: number(stored.content, "slip_laws", law, "stderr", name) for name in values}
    described = (
        {law: {"values": values, "stderr": stderr, "interval95": intervals}} if values else {}
    )
    content: dict[str, Any] = {"law": law, "title": FAMILIES[law].title, "best": law}
    content |= laws_content(described, stored.geometry)
    content["units"] = {name: FAMILIES[law].parameters[name].unit or "-" for name in values}
    content["alarms"] = alarms_of(stored)
    content["comments"] = fact_lines(stored, law)
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def comment(lines: Iterable[str], mark: str) -> str:
    """Join lines, each with a comment mark in front."""
    return "".join(f"{mark} {line}".rstrip() + "\n" for line in lines)


def _parameter_lines(stored: StoredLaws, law: str) -> list[str]:
    lines = []
    for name, value in stored.values(law).items():
        parameter, ends = FAMILIES[law].parameters[name], stored.interval95(law, name)
        interval = (
            "no interval" if ends is None else f"95 % interval {ends[0]:.6g} to {ends[1]:.6g}"
        )
        lines.append(
            f"  {name} = {value!r} [{parameter.unit or '-'}], {interval}: {parameter.meaning}"
        )
    return lines


def _origin_line(stored: StoredLaws) -> str:
    manifest = stored.manifest
    arguments, version = entry(manifest, "arguments"), text(manifest, "versions", "trackslip")
    known = isinstance(arguments, list) and arguments
    command = (
        shlex.join(["trackslip", *map(str, arguments)])
        if known
        else text(stored.content, "made_by")
    )
    made = [f"made by `{command}`" if command else "", f"trackslip {version}" if version else ""]
    return ", ".join(filter(None, [f"Laws from {stored.name}", *made, text(manifest, "created")]))


def _plain(line: str) -> str:
    """Convert a line to ASCII that is safe in comments of any language."""
    blank = "".join(c if c.isprintable() else " " for c in line.translate(_SPELLED))
    ascii_only = blank.encode("ascii", "replace").decode().rstrip()
    for closing in ("*/", "/*", "??"):  # end and start of C comments, and start of C trigraphs
        while closing in ascii_only:
            ascii_only = ascii_only.replace(closing, f"{closing[0]} {closing[1]}")
    return ascii_only if len(ascii_only) <= _MAX_LENGTH else f"{ascii_only[: _MAX_LENGTH - 4]} ..."
