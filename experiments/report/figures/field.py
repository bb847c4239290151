"""The field as a scanner beside it sees it: background, way of the plate."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from experiments.report.colours import BLACK, BLUE, GREY
from experiments.report.figures.style import styled, subplots, thin
from trackslip.kinematics import Array
from trackslip.ros.scanned import ScannedDrive

_POINTS = 3000  # poses drawn of a drive
_ROOM = 0.6  # around the ways, within which the background is drawn [m]


@styled
def field(drives: Sequence[ScannedDrive]) -> Figure:
    """All drives in the frame of their poses."""
    figure, axes = subplots(6.0)
    ways, stands = [], []
    for drive in drives:
        valid = drive.log.is_valid
        way = drive.log.pose[valid, :2][thin(int(valid.sum()), _POINTS)]
        axes.plot(*_background(drive).T, ".", color=GREY, ms=2, mew=0)
        axes.plot(*way.T, ".", color=BLUE, ms=3, mew=0)
        ways.append(way)
        stands.append(drive.stand.mount)
    mounts = np.array(stands)
    axes.plot(mounts[:, 0], mounts[:, 1], "^", color=BLACK, ms=7)
    axes.quiver(*mounts[:, :2].T, np.cos(mounts[:, 2]), np.sin(mounts[:, 2]), color=BLACK, width=0.004, scale=12)
    shown = np.concatenate([*ways, mounts[:, :2]])
    low, high = shown.min(axis=0) - _ROOM, shown.max(axis=0) + _ROOM
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x [m]", ylabel="y [m]")
    axes.set_title("Way of the plate (blue), background (grey), scanner (triangle)")
    return figure


def _background(drive: ScannedDrive) -> Array:
    """Points (n, 2) of the background in the frame of the poses."""
    series, level = drive.seen.series, drive.seen.background.level
    x, y, phi = drive.stand.mount
    direction = phi + series.bearings
    points = np.column_stack([x + level * np.cos(direction), y + level * np.sin(direction)])
    return np.asarray(points[np.isfinite(level)])
