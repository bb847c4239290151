"""Held-out prediction: how far open-loop dead reckoning by a law is off, some seconds ahead of measured poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from trackslip.identification.drive.fit import Fit, fit
from trackslip.identification.drive.residuals import Nodes
from trackslip.kinematics import Array, wrap_angle
from trackslip.metrics import rms
from trackslip.se2 import rotate

HORIZONS = (1.0, 2.0, 5.0, 10.0)
"""How far ahead is predicted [s]."""
_MAX_FOLDS = 5
_TRAIL = 10.0  # time over which positions give the heading at the start, without headings [s]
_MIN_TRAIL = 5  # number of those positions
_MIN_WAY = 0.3  # that the positions span [m]


@dataclass(frozen=True)
class Errors:
    """Errors of predictions for one horizon."""

    count: int
    """Number of predictions, which overlap."""
    position_rms: float
    """Root mean square error of the position [m]."""
    position_median: float
    """Median error of the position [m]."""
    heading_rms: float | None
    """Root mean square error of the heading [rad]; None without headings."""
    heading_median: float | None
    """Median absolute error of the heading [rad]; None without headings."""


@dataclass(frozen=True)
class Predictions:
    """Predictions of held-out driving by a law."""

    start: np.ndarray  # (n,) nodes to predict from
    heading: Array  # (n,) of the robot there [rad]
    horizon: Array  # (n,) [s]
    error: Array  # (n, 3) predicted minus measured, in the frame of the start [m, m, rad]
    """NaN headings where none were measured."""
    part: np.ndarray  # (n,) index of the fit that predicts
    values: Array  # (F, p) parameter values of those fits

    def errors(self) -> dict[float, Errors]:
        """Errors by horizon [s], of those that the drives are long enough for."""
        found = {}
        for horizon in HORIZONS:
            error = self.error[self.horizon == horizon]
            if not len(error):
                continue
            position, heading = np.hypot(error[:, 0], error[:, 1]), error[np.isfinite(error[:, 2]), 2]
            found[horizon] = Errors(
                len(error),
                rms(position),
                float(np.median(position)),
                rms(heading) if len(heading) else None,
                float(np.median(np.abs(heading))) if len(heading) else None,
            )
        return found


def held_out(found: Fit) -> Predictions:
    """Predictions of driving that the law was not fitted to.

    With several drives, each is predicted by a fit to the others (in at most five groups); of a single one, the second
    half by a fit to the first. The fits start from `found`, whose outlying poses are left out everywhere.
    """
    folds = _folds(found)
    parts = [_predicted(refitted, found, rows) for refitted, rows in folds]
    start, heading, horizon, error = (np.concatenate(column) for column in zip(*parts, strict=True))
    part = np.repeat(np.arange(len(parts)), [len(found[0]) for found in parts])
    return Predictions(start, heading, horizon, error, part, np.array([refitted.values for refitted, _ in folds]))


def _folds(found: Fit) -> list[tuple[Fit, np.ndarray]]:
    """Fits to a part of the drives, and bool (K,) of the nodes that they were not fitted to."""
    nodes, first = found.nodes, found.nodes.first
    count = len(nodes.drives)
    if count == 1:
        fitted = np.arange(len(nodes.pose)) < len(nodes.pose) // 2
        return [(_refitted(found, fitted), ~fitted)]
    label = np.repeat(np.arange(count) * min(count, _MAX_FOLDS) // count, np.diff(first))
    return [(_refitted(found, label != one), label == one) for one in np.unique(label)]


def _refitted(found: Fit, rows: np.ndarray) -> Fit:
    """The fit to the nodes `rows` (K,) bool alone."""
    nodes, drives = found.nodes, []
    for drive, begin in zip(nodes.drives, nodes.first, strict=False):
        kept = rows[begin : begin + len(drive.time)]
        if kept.sum() > 1:
            drives.append(drive.kept(kept))
    whole = Nodes.of(drives)
    link = np.append(nodes.link, 0.0)[rows][:-1] * whole.link
    part = replace(whole, weight=nodes.weight[rows], link=link)
    return fit(
        found.model,
        part,
        found.states[rows],
        found.values,
        found.noise,
        found.free,
        found.mean,
        gated=False,
        quiet=True,
    )


def _predicted(law: Fit, whole: Fit, rows: np.ndarray) -> tuple[np.ndarray, Array, Array, Array]:
    """Start, heading, horizon and error of predictions from and to nodes `rows` (K,) bool by the law of a fit."""
    nodes = whole.nodes
    found = []
    for drive, begin in zip(nodes.drives, nodes.first, strict=False):
        inside = slice(begin, begin + len(drive.time))
        usable = np.flatnonzero(rows[inside] & (nodes.weight[inside, 0] > 0))
        if len(usable) < 2:
            continue
        breaks = np.concatenate([[0.0], np.cumsum(1 - nodes.link[begin : begin + len(drive.time) - 1])])
        path = law.model.sensor_path(law.values, drive)
        pose = drive.pose.copy()
        pose[nodes.weight[inside, 1] == 0, 2] = np.nan
        yaw = law.values[law.model.index("sensor_yaw")]
        heading = pose[:, 2] - yaw
        if not drive.has_heading:
            heading[usable] = trailing_heading(drive.time[usable], pose[usable, :2], path[usable])
        for horizon in HORIZONS:
            start, end = _pairs(drive.time, usable, horizon, drive.interval)
            whole_way = (breaks[start] == breaks[end]) & np.isfinite(heading[start])
            start, end = start[whole_way], end[whole_way]
            turned = heading[start] - path[start, 2]
            moved = rotate(turned, path[end, :2] - path[start, :2])
            missed = rotate(-heading[start], pose[start, :2] + moved - pose[end, :2])
            turn = (
                wrap_angle(turned + path[end, 2] + yaw - pose[end, 2])
                if drive.has_heading
                else np.full(len(end), np.nan)
            )
            found.append((begin + start, heading[start], np.full(len(start), horizon), np.column_stack([missed, turn])))
    if not found:
        return np.zeros(0, int), np.zeros(0), np.zeros(0), np.zeros((0, 3))
    start, headings, horizons, errors = (np.concatenate(column) for column in zip(*found, strict=True))
    return start, headings, horizons, errors


def _pairs(time: Array, usable: np.ndarray, horizon: float, interval: float) -> tuple[np.ndarray, np.ndarray]:
    """Nodes out of `usable`, and those that follow them after the horizon [s], within half an interval."""
    times = time[usable]
    near = np.clip(np.searchsorted(times, times + horizon - interval / 2), 0, len(times) - 1)
    hit = np.abs(times[near] - times - horizon) <= interval / 2 + 1e-9
    return usable[hit], usable[near[hit]]


def trailing_heading(time: Array, position: Array, path: Array) -> Array:
    """Headings (n,) at which dead reckoning fits the positions measured in the last seconds; NaN where these are few.

    `position` (n, 2) is measured at `time` (n,), where dead reckoning from anywhere gives `path` (n, 3).
    """
    z, c = position[:, 0] + 1j * position[:, 1], path[:, 0] + 1j * path[:, 1]
    sums = np.concatenate([np.zeros((4, 1)), np.cumsum([np.ones(len(z)), z, c, z * c.conj()], axis=1)], axis=1)
    spread = np.concatenate([[0.0], np.cumsum(np.abs(c - c[0]) ** 2)])
    offset = np.concatenate([[0.0], np.cumsum(c - c[0])])
    low, high = np.searchsorted(time, time - _TRAIL), np.arange(1, len(time) + 1)
    number, a, b, product = sums[:, high] - sums[:, low]
    number = number.real
    size = (spread[high] - spread[low]) / number - np.abs((offset[high] - offset[low]) / number) ** 2
    turned = np.angle(product - a * b.conj() / number)
    known = (number >= _MIN_TRAIL) & (size > (_MIN_WAY / 2) ** 2)
    return np.asarray(np.where(known, turned + path[:, 2], np.nan))


def score(errors: Mapping[str, Mapping[float, Errors]], names: Sequence[str]) -> dict[str, float]:
    """Mean over horizons, positions and headings of each law's rms error, relative to the smallest of any law [-]."""
    ratios: dict[str, list[float]] = {name: [] for name in names}
    for horizon in HORIZONS:
        for key in ("position_rms", "heading_rms"):
            values = {name: float(getattr(errors[name].get(horizon), key, None) or np.nan) for name in names}
            if not np.isfinite(list(values.values())).all():
                continue
            least = min(values.values())
            for name in names:
                ratios[name].append(values[name] / least)
    return {name: float(np.mean(ratio)) if ratio else np.nan for name, ratio in ratios.items()}
