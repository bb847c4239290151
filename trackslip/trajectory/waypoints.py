"""A reference through waypoints from an array or a CSV file, with reversals where their headings say so."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import ArrayLike

from trackslip.errors import InvalidValueError, ReferenceFileError, first_line, require
from trackslip.files import read_text
from trackslip.kinematics import Array
from trackslip.trajectory.base import Reference
from trackslip.trajectory.path import MAX_LENGTH, ParametricPath
from trackslip.trajectory.profile import LIMITS, MotionLimits, ProfiledReference

COLUMNS = ("x", "y", "yaw", "v")
"""Of a file [m, m, rad, m/s]; the last two are optional."""
MIN_POINTS, MAX_POINTS = 3, 10_000
"""Allowed number of waypoints."""
MAX_COORDINATE = 100.0
"""Maximum absolute coordinate of a waypoint [m]."""
MIN_SPACING = 1e-3
"""Minimum distance between neighbouring waypoints [m]."""
_ALONG = np.cos(np.radians(45))  # between a chord and the headings at its ends, at most


class Stretches:
    """References one after another, each driven forwards or in reverse."""

    def __init__(self, references: Sequence[ProfiledReference], directions: Sequence[int]) -> None:
        """`directions` are 1 for forwards and -1 for reverse."""
        self._references, self._directions = references, directions
        self._starts = np.concatenate([[0.0], np.cumsum([reference.duration for reference in references])])
        self._turns: list[float] = []  # what is added to the headings of each
        heading = 0.0
        for reference, direction in zip(references, directions, strict=True):
            first, last = reference.pose([0.0, reference.duration])[:, 2]
            turn = np.pi if direction < 0 else 0.0
            if self._turns:
                turn += 2 * np.pi * np.round((heading - first - turn) / (2 * np.pi))
            self._turns.append(turn)
            heading = last + turn

    @property
    def duration(self) -> float:
        """Time at which the last reference ends [s]."""
        return float(self._starts[-1])

    @property
    def knots(self) -> Array:
        """Times (K,) between which the twist is smooth [s]."""
        starts = self._starts[:-1]
        return np.concatenate([at + part.knots for at, part in zip(starts, self._references, strict=True)])

    def pose(self, time: ArrayLike) -> Array:
        """Poses (..., 3) at times (...) [s]; phi unwrapped."""
        time = np.asarray(time, float)
        poses = np.empty((*time.shape, 3))
        for k, at in self._split(time):
            poses[at] = self._references[k].pose(time[at] - self._starts[k])
            poses[at, 2] += self._turns[k]
        return poses

    def twist(self, time: ArrayLike) -> Array:
        """Twists (..., 2) at times (...) [s]."""
        time = np.asarray(time, float)
        twists = np.empty((*time.shape, 2))
        for k, at in self._split(time):
            twists[at] = self._references[k].twist(time[at] - self._starts[k]) * [self._directions[k], 1.0]
        return twists

    def _split(self, time: Array) -> list[tuple[int, np.ndarray]]:
        """Index of each reference, and where (...) it is driven."""
        driven = np.searchsorted(self._starts[1:-1], time, side="right")
        return [(k, driven == k) for k in range(len(self._references))]


def waypoints(
    points: ArrayLike,
    limits: MotionLimits = LIMITS,
    yaw: ArrayLike | None = None,
    speed: ArrayLike | None = None,
) -> Reference:
    """A smooth reference through all points in order: a cubic spline parametrised by chord length.

    The curvature is continuous and, without `yaw`, zero at both ends. Among the usual parameters, chord length gives
    the widest bends for unevenly spaced points. The robot drives in reverse where the points go against the headings,
    and stops where its direction changes.

    Args:
        points: (N, 2) in the world [m].
        limits: of the motion.
        yaw: headings (N,) [rad]; they say where the robot reverses, and are the headings where it starts and stops.
        speed: largest speeds (N,) [m/s]; their squares are linear in between.

    Raises:
        InvalidValueError: if there are too few points, points too far away or too close, bends too tight to drive, or
            headings across the path.
    """
    points = np.asarray(points, float)
    planar = points.ndim == 2 and points.shape[1] == 2
    require(planar, "shape of the waypoints", points.shape, "(N, 2): columns x and y")
    columns = [points, *(np.reshape(column, (-1, 1)) for column in (yaw, speed) if column is not None)]
    names = [
        *COLUMNS[:2],
        *(name for name, column in zip(COLUMNS[2:], (yaw, speed), strict=True) if column is not None),
    ]
    return _through(np.hstack(columns), names, "point", limits)


def read_waypoints(path: Path, limits: MotionLimits = LIMITS) -> Reference:
    """The reference through the points in a CSV file of columns x, y and, optionally, yaw and v: see `waypoints`.

    The header may be left out if there are only x and y.

    Raises:
        ReferenceFileError: if the file cannot be read or driven; names the row, counted from 1 without the header, and
            the column.
    """
    try:
        lines = io.StringIO(read_text(path), newline="")
        rows = [row for row in csv.reader(lines) if any(text.strip() for text in row)]
        names = [text.strip().lower() for text in rows[0]] if rows else []
        if names and not _is_number(names[0]):
            known = set(COLUMNS[:2]) <= set(names) <= set(COLUMNS) and len(set(names)) == len(names)
            require(known, "columns", ",".join(rows[0]), "x,y[,yaw][,v]")
            rows = rows[1:]
        else:
            names = list(COLUMNS[:2])
        table = np.array([_numbers(row, names, f"row {k}") for k, row in enumerate(rows, 1)], float)
        order = sorted(range(len(names)), key=lambda k: COLUMNS.index(names[k]))
        return _through(table.reshape(-1, len(names))[:, order], [names[k] for k in order], "row", limits)
    except FileNotFoundError:
        raise ReferenceFileError(f"{path}: no such file") from None
    except OSError as error:
        raise ReferenceFileError(f"{path}: {error.strerror}") from error
    except (InvalidValueError, csv.Error, UnicodeError) as error:
        raise ReferenceFileError(f"{path}: {first_line(error)}") from error


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _numbers(row: list[str], names: Sequence[str], label: str) -> list[float]:
    require(len(row) == len(names), f"{label}, number of columns", len(row), f"{len(names)}: {', '.join(names)}")
    for name, text in zip(names, row, strict=True):
        require(_is_number(text), f"{label}, column {name}", text, "a number")
    return [float(text) for text in row]


def _through(table: Array, names: Sequence[str], label: str, limits: MotionLimits) -> Reference:
    """The reference through the rows of a table (N, columns), called `label` in errors."""
    count, points = len(table), table[:, :2]
    require(MIN_POINTS <= count <= MAX_POINTS, "number of waypoints", count, f"from {MIN_POINTS} to {MAX_POINTS}")
    far = np.argwhere(~(np.abs(table) <= MAX_COORDINATE))  # NaN is too
    if far.size:
        row, column = far[0]
        allowed = f"from {-MAX_COORDINATE:g} to {MAX_COORDINATE:g}" + (" m" if column < 2 else "")
        raise InvalidValueError(f"{label} {row + 1}, column {names[column]}", float(table[row, column]), allowed)
    chords = np.diff(points, axis=0)
    lengths = np.hypot(*chords.T)
    if lengths.min() < MIN_SPACING:
        k = int(np.argmin(lengths))
        raise InvalidValueError(
            f"{label} {k + 2}", tuple(points[k + 1].tolist()), f"at least {MIN_SPACING:g} m from {label} {k + 1}"
        )
    if lengths.sum() > MAX_LENGTH:
        raise InvalidValueError("way through all points", float(lengths.sum().round(3)), f"at most {MAX_LENGTH:g} m")
    yaw, speed = (table[:, names.index(name)] if name in names else None for name in COLUMNS[2:])
    directions = np.ones(count - 1, int)
    if yaw is not None:
        headings = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
        means = headings[:-1] + headings[1:]
        along = np.sum(means * chords, axis=1) / (np.hypot(*means.T) * lengths + np.finfo(float).tiny)
        if np.abs(along).min() < _ALONG:
            row = int(np.argmin(np.abs(along))) + 1
            allowed = f"within 45 deg of the way from {label} {row}, forwards or in reverse"
            raise InvalidValueError(f"{label} {row + 1}, column yaw", float(yaw[row]), allowed)
        directions = np.sign(along).astype(int)
    elif speed is not None and speed.min() < 0:
        row = int(np.argmin(speed))
        raise InvalidValueError(f"{label} {row + 1}, column v", float(speed[row]), "at least 0 without a column yaw")
    ends = [0, *(np.flatnonzero(np.diff(directions)) + 1).tolist(), count - 1]
    stretches = [slice(first, last + 1) for first, last in pairwise(ends)]
    signs = [int(directions[stretch.start]) for stretch in stretches]
    references = [
        _stretch(points[s], None if yaw is None else yaw[s], None if speed is None else speed[s], sign, limits)
        for s, sign in zip(stretches, signs, strict=True)
    ]
    return references[0] if signs == [1] else Stretches(references, signs)


def _stretch(
    points: Array, yaw: Array | None, speed: Array | None, direction: int, limits: MotionLimits
) -> ProfiledReference:
    """The reference through points (N, 2) that are driven in one direction, from rest to rest."""
    parameter = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    ends = "natural" if yaw is None else tuple((1, direction * np.exp(1j * end)) for end in (yaw[0], yaw[-1]))
    path = ParametricPath(scipy.interpolate.CubicSpline(parameter, points @ [1, 1j], bc_type=ends), parameter)
    if speed is None:
        return ProfiledReference(path, limits)
    return ProfiledReference(path, limits, lambda s: np.sqrt(np.interp(path.parameter(s), parameter, speed**2)))
