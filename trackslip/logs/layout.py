"""How a table that another program wrote names and states its readings: names of columns, units,
ticks per turn, and the geometry with which odometry was computed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import pyarrow as pa

from trackslip.errors import InvalidValueError, LogError, did_you_mean, require_within
from trackslip.kinematics import RobotGeometry
from trackslip.logs.schema import READ

SCALE: Final = b"scale"
"""Key, in a field's metadata, of the factor from the column's unit to ours."""
UNITS: Final[dict[str, dict[str, float]]] = {
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    "rad/s": {
        "rad/s": 1.0,
        "deg/s": np.pi / 180,
        "rpm": 2 * np.pi / 60,
        "turn/s": 2 * np.pi,
    },
    "rad": {"rad": 1.0, "deg": np.pi / 180, "turn": 2 * np.pi},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "m/s": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "km/h": 1 / 3.6},
}
"""Units in which a column may be stated, by our unit, with the factor to it."""
BELT_UNITS: Final[dict[str, dict[str, float]]] = {
    "omega_l": UNITS["m/s"],
    "omega_r": UNITS["m/s"],
    "angle_l": UNITS["m"],
    "angle_r": UNITS["m"],
}
"""Units in which motion of the belts may be stated in place of the sprockets', by our column, with
the factor to m/s or m."""
TICKS_PER_TURN: Final = (1e-3, 1e9)
"""Least and largest number of ticks per turn; with a gear, a turn may have fewer than one."""
_QUATERNION: Final = ("qx", "qy", "qz", "qw")  # columns that may replace phi
_DOCUMENTED: Final = (
    *("run", "t", "omega_l", "omega_r", "angle_l", "angle_r", "ticks_l", "ticks_r"),
    *("odom_x", "odom_y", "odom_phi", "odom_v", "odom_w"),
    *("x", "y", "phi", "gyro", "valid", "v", "w"),
)
"""Columns that the message on an unknown name lists."""


@dataclass(frozen=True)
class Layout:
    """Names and units of a table's columns; by default those of the documentation."""

    columns: str | Mapping[str, str] | None = None
    """The table's column for each of ours, with its unit if it is another, as in
    `{"omega_l": "left_rpm:rpm", "t": "stamp:ms"}` or `"omega_l=left_rpm:rpm,t=stamp:ms"`.
    """
    ticks_per_turn: float | None = None
    """Ticks per turn, for the columns ticks_l and ticks_r, or counters in a bag [-]."""
    odometry: RobotGeometry | None = None
    """Geometry with which odometry that replaces encoders was computed; by default the robot's."""
    robot: RobotGeometry | None = None
    """The robot's geometry, if it is known before the log is read."""

    def __post_init__(self) -> None:
        if self.ticks_per_turn is not None:
            require_within("ticks_per_turn", self.ticks_per_turn, *TICKS_PER_TURN)
        for name in self.sources:
            if name not in (*READ, *_QUATERNION):
                allowed = f"one of {', '.join(_DOCUMENTED)}{did_you_mean(name, READ)}"
                raise InvalidValueError("columns", name, allowed)

    @cached_property
    def sources(self) -> dict[str, str]:
        """The text after the equals sign, such as left_rpm:rpm, by the name of our column."""
        if self.columns is None:
            return {}
        if isinstance(self.columns, Mapping):
            return {str(name): str(source) for name, source in self.columns.items()}
        sources = dict[str, str]()
        for entry in self.columns.split(","):
            name, equals, source = (part.strip() for part in entry.partition("="))
            if not (name and equals and source):
                raise InvalidValueError(
                    "columns", entry, "NAME=COLUMN or NAME=COLUMN:UNIT, as in t=stamp:ms"
                )
            if name in sources:
                raise InvalidValueError("columns", name, "there once")
            sources[name] = source
        return sources

    def applied(self, table: pa.Table, source: str) -> pa.Table:
        """The table with our names; a field whose unit isn't ours has the factor as metadata SCALE.

        A column of the table that has our name already gives way to the chosen one. Raises LogError
        for a column that the table doesn't have, InvalidValueError for an unknown unit.
        """
        if not self.sources:
            return table
        radius = None if self.robot is None else self.robot.sprocket_radius
        chosen = {
            name: _column_and_factor(name, text, table.column_names, source, radius)
            for name, text in self.sources.items()
        }
        taken = {column for column, _ in chosen.values()}
        fields = []
        columns = []
        for field, column in zip(table.schema, table.columns, strict=True):
            if field.name not in taken and field.name not in chosen:
                fields.append(field)
                columns.append(column)
        for name, (column, factor) in chosen.items():
            kind = table.schema.field(column).type
            fields.append(pa.field(name, kind, metadata={SCALE: repr(factor)}))
            columns.append(table.column(column))
        return pa.Table.from_arrays(columns, schema=pa.schema(fields, table.schema.metadata))


def _column_and_factor(
    name: str, text: str, present: list[str], source: str, radius: float | None
) -> tuple[str, float]:
    """The table's column that `text` names for our column `name`, and the factor to our unit, of a
    robot whose sprockets have a known `radius` [m] or None.
    """
    if text in present:  # a name may contain colons
        _require_once(text, present, source)
        return text, 1.0
    column, colon, unit = text.rpartition(":")
    column = column if colon else text
    if column not in present:
        raise LogError(
            f"{source}: columns {name}={text}: has no column {column!r}"
            f"{did_you_mean(column, present)}; found {', '.join(present)[:200]!r}"
        )
    _require_once(column, present, source)
    if unit in BELT_UNITS.get(name, {}):
        return column, BELT_UNITS[name][unit] / _known_radius(radius, f"{name}={text}")
    units = UNITS.get(READ[name].unit, {}) if name in READ else {}
    if unit not in units:
        known = [*units, *BELT_UNITS.get(name, {})]
        allowed = f"one of {', '.join(known)}" if known else "left out: the column has no unit"
        raise InvalidValueError("columns", f"{name}={text}", f"in a known unit: {allowed}")
    return column, units[unit]


def _known_radius(radius: float | None, column: str) -> float:
    """The radius of the sprockets [m]; raises InvalidValueError if it is unknown, as motion of the
    belts in a `column` is divided by it.
    """
    if radius is None:
        raise InvalidValueError(
            "sprocket_radius",
            None,
            f"given (--half-gauge and --sprocket-radius): {column} is motion of the belts, which "
            "is divided by it",
        )
    return radius


def _require_once(column: str, present: list[str], source: str) -> None:
    """Raise LogError if several columns have the name."""
    if present.count(column) > 1:
        raise LogError(f"{source}: column {column} is there {present.count(column)} times")


AS_DOCUMENTED: Final = Layout()
"""Our names, in our units."""


def known_ticks(layout: Layout) -> float:
    """Ticks per turn; raises InvalidValueError if the layout doesn't state them."""
    if layout.ticks_per_turn is None:
        raise InvalidValueError(
            "ticks_per_turn",
            None,
            "given (--ticks-per-turn N): the ticks that an encoder counts per turn",
        )
    return layout.ticks_per_turn


def known_odometry(layout: Layout, what: str) -> RobotGeometry:
    """The geometry with which `what` were computed; raises InvalidValueError if it is unknown."""
    geometry = layout.odometry or layout.robot
    if geometry is None:
        raise InvalidValueError(
            "odometry",
            None,
            "given (--odom-half-gauge and --odom-radius): the geometry with which "
            f"{what} were computed",
        )
    return geometry
