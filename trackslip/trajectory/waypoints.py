"""A reference through waypoints from an array or a CSV file."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import ArrayLike

from trackslip.errors import InvalidValueError, ReferenceFileError, first_line, require
from trackslip.files import read_text
from trackslip.kinematics import Array
from trackslip.trajectory.path import MAX_LENGTH, ParametricPath
from trackslip.trajectory.profile import LIMITS, MotionLimits, ProfiledReference

COLUMNS = ("x", "y")
MIN_POINTS, MAX_POINTS = 3, 10_000
"""Allowed number of waypoints."""
MAX_COORDINATE = 100.0
"""Maximum absolute coordinate of a waypoint [m]."""
MIN_SPACING = 1e-3
"""Minimum distance between neighbouring waypoints [m]."""


def waypoints(points: ArrayLike, limits: MotionLimits = LIMITS) -> ProfiledReference:
    """A smooth reference through all points in order: a natural cubic spline parametrised by chord length.

    The curvature is continuous and zero at both ends. Among the usual parameters, chord length gives the widest bends
    for unevenly spaced points.

    Args:
        points: (N, 2) in the world [m].

    Raises:
        InvalidValueError: if there are too few points, points too far away or too close, or bends too tight to drive.
    """
    points = np.asarray(points, float)
    table = points.ndim == 2 and points.shape[1] == 2
    require(table, "shape of the waypoints", points.shape, "(N, 2): columns x and y")
    return _through(points, "point", limits)


def read_waypoints(path: Path, limits: MotionLimits = LIMITS) -> ProfiledReference:
    """The reference through the points in a CSV file of columns x and y [m]; a header is optional.

    Raises:
        ReferenceFileError: if the file cannot be read or driven; names the row, counted from 1 without the header, and
            the column.
    """
    try:
        lines = io.StringIO(read_text(path), newline="")
        rows = [row for row in csv.reader(lines) if any(text.strip() for text in row)]
        if rows and tuple(text.strip().lower() for text in rows[0]) == COLUMNS:
            rows = rows[1:]
        points = np.array([_point(row, f"row {k}") for k, row in enumerate(rows, 1)], float).reshape(-1, 2)
        return _through(points, "row", limits)
    except FileNotFoundError:
        raise ReferenceFileError(f"{path}: no such file") from None
    except OSError as error:
        raise ReferenceFileError(f"{path}: {error.strerror}") from error
    except (InvalidValueError, csv.Error, UnicodeError) as error:
        raise ReferenceFileError(f"{path}: {first_line(error)}") from error


def _point(row: list[str], label: str) -> list[float]:
    require(len(row) == len(COLUMNS), f"{label}, number of columns", len(row), "2: x and y")
    point = []
    for name, text in zip(COLUMNS, row, strict=True):
        try:
            point.append(float(text))
        except ValueError:
            raise InvalidValueError(f"{label}, column {name}", text, "a number") from None
    return point


def _through(points: Array, label: str, limits: MotionLimits) -> ProfiledReference:
    """The reference through points (N, 2), called `label` in errors."""
    count = len(points)
    require(MIN_POINTS <= count <= MAX_POINTS, "number of waypoints", count, f"from {MIN_POINTS} to {MAX_POINTS}")
    far = np.argwhere(~(np.abs(points) <= MAX_COORDINATE))  # NaN is too
    if far.size:
        row, column = far[0]
        allowed = f"from {-MAX_COORDINATE:g} to {MAX_COORDINATE:g} m"
        raise InvalidValueError(f"{label} {row + 1}, column {COLUMNS[column]}", float(points[row, column]), allowed)
    chords = np.hypot(*np.diff(points, axis=0).T)
    if chords.min() < MIN_SPACING:
        k = int(np.argmin(chords))
        raise InvalidValueError(
            f"{label} {k + 2}", tuple(points[k + 1].tolist()), f"at least {MIN_SPACING:g} m from {label} {k + 1}"
        )
    if chords.sum() > MAX_LENGTH:
        raise InvalidValueError("way through all points", float(chords.sum().round(3)), f"at most {MAX_LENGTH:g} m")
    parameter = np.concatenate([[0.0], np.cumsum(chords)])
    spline = scipy.interpolate.CubicSpline(parameter, points[:, 0] + 1j * points[:, 1], bc_type="natural")
    return ProfiledReference(ParametricPath(spline, parameter), limits)
