"""Recognises the columns of tables that other programs wrote, to say which option reads them."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from trackslip.kinematics import Array
from trackslip.logs.angles import EncoderKind

_TIME: Final = (
    r"(^|[^a-z])(t|time|times|stamp|timestamp|timestamps|sec|secs|seconds|clock)($|[^a-z])"
)
# the side alone, at the end of a word as in speedL, or of a usual letter as in wl
_LEFT: Final = r"left|(^|[^a-z])[wnv]?_?(l|lhs)($|[^a-z])|[a-z]L$"
_RIGHT: Final = r"right|(^|[^a-z])[wnv]?_?(r|rhs)($|[^a-z])|[a-z]R$"
_SPEED: Final = r"rpm|omega|speed|vel|rad_?/?p?_?s(ec)?$|rps|dps|^[wnv]_?[lr]$|^v_|_v$|m/s|mps|m_s$"
# speeds of the belts, by their symbol: in m/s
_BELT_SPEED: Final = r"^v_?[lr]$|^v_|_v$"
# of the sides, what isn't a sprocket's or a belt's measured motion: commands
_NOT_MEASURED: Final = r"cmd|command|target|set_?point|desired"
_TICKS: Final = r"tick|count|enc|pulse"
_ANGLE: Final = r"angle|position|(^|[^a-z])pos($|[^a-z])|joint"
_HEADING: Final = r"yaw|heading|theta|phi|psi|azimuth"
_GYRO: Final = r"gyro.*z|angular_?(vel|rate).*z|yaw_?rate|(^|[^a-z])(gz|wz)($|[^a-z])"
# columns with positions, speeds or headings of something else than the robot that was measured
_OTHER: Final = (
    r"cmd|command|goal|target|desired|set_?point|ref|true|truth|gps_?t|cov|var|std|accel|acc_"
    r"|twist|velocity|orientation|(^|[^a-z])(vel|v|w|q)($|[^a-z])|quat|odom|wheel|enc|motor|rate|angular"
    r"|(^|[^a-z])(gyro|imu|mag)"
)
# units at the end of a column's name, as in left_rpm, time [ms] or x(mm)
_UNITS: Final = {
    "ms": r"(^|[^a-z])(ms|msec|millis|milliseconds)\W*$",
    "us": r"(^|[^a-z])(us|usec|micros|microseconds|µs)\W*$",
    "ns": r"(^|[^a-z])(ns|nsec|nanos|nanosec|nanoseconds)\W*$",
    "rpm": r"rpm\W*$",
    "deg/s": r"deg(rees)?_?(/|p|per)_?_?s(ec)?\W*$|dps\W*$",
    "turn/s": r"(^|[^a-z])(rps|rev_?/?p?s)\W*$",
    "mm/s": r"mm_?(/|p|per|_)_?s(ec)?\W*$",
    "cm/s": r"cm_?(/|p|per|_)_?s(ec)?\W*$",
    "km/h": r"km_?(/|p|per)_?h\W*$|kmh\W*$",
    "m/s": r"(^|[^a-z])m_?(/|p|per|_)_?s(ec)?\W*$",
    "deg": r"deg(rees)?\W*$|°\W*$",
    "mm": r"(^|[^a-z])mm\W*$",
    "cm": r"(^|[^a-z])cm\W*$",
}
# factors from units of time to seconds
_TIMES: Final = (("", 1.0), (":ms", 1e-3), (":us", 1e-6), (":ns", 1e-9))
_LONGEST_STEP: Final = 5.0  # a usual step of a log's times that is longer is in another unit [s]
_MOST_RADIANS: Final = 6.6  # headings above this number, within a turn, are degrees
_ALLOWED: Final = {
    "t": ("ms", "us", "ns"),
    "omega": ("rpm", "deg/s", "turn/s", "mm/s", "cm/s", "km/h", "m/s"),
    "angle": ("deg",),
    "ticks": (),
    "x": ("mm", "cm"),
    "y": ("mm", "cm"),
    "phi": ("deg",),
    "gyro": ("deg/s",),
}
"""Units that a column may have, by the start of our name for it."""


def suggested_columns(names: Sequence[str], values: Callable[[str], Array]) -> str:
    """The option that renames a table's columns `names` to ours, such as
    `--columns t=stamp:ms,omega_l=left_rpm:rpm`; empty unless time, encoders
    and poses are recognised.

    `values` returns the numbers in a column; the units of times and headings follow from them.
    """
    chosen = dict[str, str]()
    for name, column in _recognised(names).items():
        if name != column or _unit(name, column, values):
            chosen[name] = column + _unit(name, column, values)
    found = {*chosen, *names}
    has_sides = any({f"{kind}_l", f"{kind}_r"} <= found for kind in ("omega", "angle", "ticks"))
    has_odometry = {"odom_v", "odom_w"} <= found or {"odom_x", "odom_y", "odom_phi"} <= found
    has_poses = {"x", "y"} <= found or not found.isdisjoint(("phi", "gyro"))
    if not (chosen and "t" in found and has_poses and (has_sides or has_odometry)):
        return ""
    pairs = ",".join(f"{name}={column}" for name, column in chosen.items())
    ticks = " --ticks-per-turn N" if {"ticks_l", "ticks_r"} <= found else ""
    return f"--columns {shlex.quote(pairs)}{ticks}"


def _recognised(names: Sequence[str]) -> dict[str, str]:
    """The column for each of our names that is recognised, best guesses first."""
    found = dict[str, str]()

    def take(name: str, pattern: str, besides: str = "") -> None:
        """Take the first free column that matches, and not `besides`, for our `name`."""
        if name in names:
            return
        for column in names:
            free = column not in found.values()
            matches = re.search(pattern, _plain(column), re.IGNORECASE)
            excluded = besides and re.search(besides, _plain(column), re.IGNORECASE)
            if free and matches and not excluded:
                found[name] = column
                return

    take("t", _TIME, "step|dt|diff")
    if not _has_encoders(names):
        found |= _sides(names)
    take("x", r"(^|[^a-z])(px|x|posx|position_?x|xpos)($|[^a-z])|[a-z]X$", _OTHER)
    take("y", r"(^|[^a-z])(py|y|posy|position_?y|ypos)($|[^a-z])|[a-z]Y$", _OTHER)
    take("phi", _HEADING, _OTHER)
    take("gyro", _GYRO, r"cmd|command|goal|target")
    return found


def _has_encoders(names: Sequence[str]) -> bool:
    """True if a column has our name for a reading of the encoders."""
    ours = {name for kind in EncoderKind for name in kind.value}
    return not ours.isdisjoint(names)


def _sides(names: Sequence[str]) -> dict[str, str]:
    """The columns with the speeds, ticks or angles of both sides by our names for them."""
    for kind, pattern in (("omega", _SPEED), ("ticks", _TICKS), ("angle", _ANGLE)):
        measured = [
            column
            for column in names
            if re.search(pattern, column, re.IGNORECASE)
            and not re.search(_NOT_MEASURED, column, re.IGNORECASE)
        ]
        left = next((column for column in measured if _is_side(column, _LEFT)), None)
        right = next((column for column in measured if _is_side(column, _RIGHT)), None)
        if left is not None and right is not None and left != right:
            return {f"{kind}_l": left, f"{kind}_r": right}
    return {}


def _is_side(column: str, mark: str) -> bool:
    """True if a column's name has the `mark` of a side, whether in capitals or not."""
    plain = _plain(column)
    return bool(re.search(mark, plain) or re.search(mark, plain.lower()))


def _plain(column: str) -> str:
    """A column's name with spaces between its parts, without its unit."""
    return re.sub(r"[._/\[\]():\s]+", "_", column).strip("_")


def _unit(name: str, column: str, values: Callable[[str], Array]) -> str:
    """The unit of a column as `:UNIT`, by its name or its numbers; empty if it is ours."""
    allowed = _ALLOWED.get(name.partition("_")[0], ())
    for unit in allowed:
        if re.search(_UNITS[unit], column, re.IGNORECASE):
            return f":{unit}"
    if name.startswith("omega") and re.search(_BELT_SPEED, _plain(column), re.IGNORECASE):
        return ":m/s"
    if name not in ("t", "phi"):
        return ""
    numbers = values(column)
    numbers = numbers[np.isfinite(numbers)]
    if name == "phi":
        largest = float(np.max(np.abs(numbers), initial=0.0))
        return ":deg" if _MOST_RADIANS < largest <= 360.5 else ""
    if len(numbers) < 2:
        return ""
    step = float(np.median(np.abs(np.diff(numbers))))
    return next((unit for unit, factor in _TIMES if step * factor <= _LONGEST_STEP), "")
