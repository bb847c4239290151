"""Starting values of a law from a trajectory that is already known well."""

from __future__ import annotations

import numpy as np

from trackslip import se2
from trackslip.identification.drive.drives import Drive
from trackslip.identification.drive.fit import Fit
from trackslip.identification.solver import least_squares
from trackslip.kinematics import Array, track_speeds
from trackslip.slip.families import FAMILIES

_PIECE = 0.5  # time over which motion is averaged [s]
_MAX_PIECES = 600


def law_start(name: str, reference: Fit) -> Array:
    """Values (p,) of a law that fit the mean twists of pieces of the reference's trajectory in least squares."""
    model, family = reference.model, FAMILIES[name]
    if not family.names:
        return np.zeros(0)
    omega, twist = pieces(reference)
    geometry = model.geometry
    starts = family.starts(geometry.half_gauge)
    low, high, scale = family.limits(geometry.half_gauge)
    measured = track_speeds(twist, geometry.half_gauge)

    def residual(values: Array, rows: np.ndarray) -> Array:
        del rows
        found = track_speeds(family.law(values[:, None, :], geometry).twist(omega, geometry), geometry.half_gauge)
        return (found - measured).reshape(len(values), -1)

    reached = least_squares(residual, starts, low, high, scale)
    return reached.values[int(reached.cost.argmin())]


def pieces(fit: Fit) -> tuple[Array, Array]:
    """Mean sprocket speeds (n, 2) [rad/s] and twists (n, 2) of the robot in pieces of about half a second."""
    model, values = fit.model, fit.values
    lever = values[[model.index("sensor_x"), model.index("sensor_y")]]
    offset = values[model.index("clock_offset")]
    found = []
    for drive, begin in zip(fit.nodes.drives, fit.nodes.first, strict=False):
        stride = max(1, round(_PIECE / drive.interval), len(drive.time) * len(fit.nodes.drives) // _MAX_PIECES)
        rows = np.arange(0, len(drive.time), stride)
        broken = np.concatenate([[0.0], np.cumsum(1 - fit.nodes.link[begin : begin + len(drive.time) - 1])])
        state, step = fit.states[begin + rows], np.diff(drive.time[rows])
        robot = np.column_stack([se2.to_world(state, -lever), state[:, 2]])
        twist = se2.log(se2.steps(robot))[:, ::2] / step[:, None]
        turned = _turned(drive, drive.time[rows] + offset)
        whole = (np.diff(broken[rows]) == 0) & (step < 3 * _PIECE + 3 * drive.interval)
        found.append((np.diff(turned, axis=0) / step[:, None], twist, whole))
    omega, twist, whole = (np.concatenate(part) for part in zip(*found, strict=True))
    whole &= np.abs(omega).max(axis=1) > 0
    return omega[whole], twist[whole]


def _turned(drive: Drive, time: Array) -> Array:
    """Angles (K, 2) of the sprockets at encoder times [rad]."""
    angle = np.concatenate([np.zeros((1, 2)), np.cumsum(drive.omega * np.diff(drive.edges)[:, None], axis=0)])
    return np.column_stack([np.interp(time, drive.edges, angle[:, side]) for side in range(2)])
