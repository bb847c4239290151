"""A reference through waypoints from an array or a CSV file."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import ArrayLike

from trackslip.errors import InvalidValueError, ReferenceFileError, first_line
from trackslip.kinematics import Array
from trackslip.trajectory.path import MAX_LENGTH, ParametricPath
from trackslip.trajectory.profile import LIMITS, Limits, ProfiledReference

COLUMNS = ("x", "y")
MIN_POINTS, MAX_POINTS = 3, 10_000
"""Allowed number of waypoints."""
MAX_COORDINATE = 100.0
"""Maximum absolute coordinate of a waypoint [m]."""
MIN_SPACING = 1e-3
"""Minimum distance between neighbouring waypoints [m]."""


def waypoints(points: ArrayLike, limits: Limits = LIMITS) -> ProfiledReference:
    """A smooth reference through all points in order: a natural cubic spline parametrised by chord length.

    The curvature is continuous and zero at both ends. Among the usual parameters, chord length gives the widest bends
    for unevenly spaced points.

    Args:
        points: (N, 2) in the world [m].

    Raises:
        InvalidValueError: if there are too few points, points too far away or too close, or bends too tight to drive.
    """
    points = np.asarray(points, float)
    if points.ndim != 2 or points.shape[1] != 2:
        raise InvalidValueError("shape of the way points", points.shape, "(N, 2): columns x and y")
    return _through(points, "point", limits)


def read_waypoints(path: Path, limits: Limits = LIMITS) -> ProfiledReference:
    """The reference through the points in a CSV file of columns x and y [m]; a header is optional.

    Raises:
        ReferenceFileError: if the file cannot be read or driven; names the row, counted from 1 without the header, and
            the column.
    """
    try:
        if not path.is_file():
            raise ReferenceFileError(f"{path}: no such file")
        with path.open(encoding="utf-8-sig", newline="") as file:
            points = np.array(list(_parse(file, path)), float).reshape(-1, 2)
        return _through(points, "row", limits)
    except InvalidValueError as error:
        raise ReferenceFileError(f"{path}: {error}") from error
    except (OSError, csv.Error, UnicodeError) as error:
        raise ReferenceFileError(f"{path}: {first_line(error)}") from error


def _parse(lines: Iterator[str], path: Path) -> Iterator[list[float]]:
    rows = ([text.strip() for text in row] for row in csv.reader(lines) if any(text.strip() for text in row))
    number = 0
    for row in rows:
        if number == 0 and tuple(text.lower() for text in row) == COLUMNS:
            continue
        number += 1
        if number > MAX_POINTS:
            raise ReferenceFileError(f"{path}: more than {MAX_POINTS} rows")
        if len(row) != len(COLUMNS):
            raise ReferenceFileError(f"{path}: row {number}: has {len(row)} columns, must have x and y")
        yield [_number(text, f"{path}: row {number}, column {name}") for name, text in zip(COLUMNS, row, strict=True)]


def _number(text: str, place: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ReferenceFileError(f"{place}: {text!r} is not a number") from None
    if not np.isfinite(value):
        raise ReferenceFileError(f"{place}: {text!r} is not a finite number")
    return value


def _through(points: Array, label: str, limits: Limits) -> ProfiledReference:
    """The reference; errors call the points `label`."""
    if not MIN_POINTS <= len(points) <= MAX_POINTS:
        raise InvalidValueError("number of way points", len(points), f"from {MIN_POINTS} to {MAX_POINTS}")
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
