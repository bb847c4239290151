"""Figures of predictions of real robots: measured against predicted, errors ahead, tracks, D by kind of turn."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.common import style
from experiments.common.colours import BLACK, BLUE, GREEN, GREY, ORANGE, RED
from experiments.common.laws import prediction_title
from experiments.evaluate.reality import (
    CALIBRATED,
    DATA_SHEET,
    LAW_TRANSFERRED,
    MEASURED,
    SCATTER,
    TRANSFERRED,
    Findings,
)
from sim.robot.named import load_parameters
from trackslip.identification.drive_prediction import GAINS, TODAY
from trackslip.kinematics import Array

_ROWS: dict[str, tuple[str, dict[str, Any]]] = {
    TODAY: ("no slip, as today", {"color": RED, "linestyle": (0, (12, 1.5))}),
    GAINS: ("two gains", {"color": GREY, "linestyle": (0, (6, 2))}),
    DATA_SHEET: ("simulator, data sheet", {"color": GREEN, "linestyle": "--"}),
    CALIBRATED: ("simulator, calibrated", {"color": GREEN, "lw": 2.4}),
    TRANSFERRED: ("simulator, other ground", {"color": GREEN, "linestyle": ":"}),
    LAW_TRANSFERRED: ("law of the other ground", {"color": ORANGE, "linestyle": ":"}),
    SCATTER: ("scatter of the data", {"color": BLACK}),
    MEASURED: ("measured", {"color": BLACK, "linestyle": "none", "marker": "o", "ms": 4}),
}
_TURNING = 0.2  # yaw rate above which D is drawn [rad/s]
_WIDEST = 4.0  # radius, over the half gauge


def title(row: str) -> str:
    """Name of a row in tables and figures."""
    return _ROWS[row][0] if row in _ROWS else prediction_title(row)


@style.styled
def steady(found: Findings) -> Figure | None:
    """Measured against predicted speed and yaw rate, by the best law and the simulator; None for drives."""
    if found.samples is None:
        return None
    figure, axes = style.subplots(4.0, 1, 2)
    for k, (axis, name, unit) in enumerate(zip(axes, ("v", "w"), ("m/s", "rad/s"), strict=True)):
        measured = found.samples.twist[:, k]
        for row, look in _points(found).items():
            axis.plot(found.twists[row][:, k], measured, **look)
        axis.axline((0, 0), slope=1, **style.THEORY)
        axis.set(xlabel=f"predicted {name} [{unit}]", ylabel=f"measured {name} [{unit}]")
    axes[0].set_title("Speed")
    axes[1].set_title("Yaw rate")
    style.legend_below(figure, [style.key(title(row), **look) for row, look in _points(found).items()])
    return figure


@style.styled
def turning(found: Findings) -> Figure | None:
    """D over the radius that the belts' speeds demand, measured and predicted; None for drives and without turns."""
    if found.samples is None:
        return None
    geometry, (left, right) = load_parameters(found.data.robot)[0].geometry, found.samples.omega.T
    turns = np.abs(found.samples.twist[:, 1]) > _TURNING
    if not turns.any():
        return None
    radius = np.abs((left + right)[turns] / (right - left)[turns])

    def offset(twist: Array) -> Array:
        belts = geometry.sprocket_radius * (right - left)[turns] / 2
        return np.asarray(1e3 * (belts / twist[turns, 1] - geometry.half_gauge))

    figure, axis = style.subplots(4.0)
    measured = offset(found.samples.twist)
    kinds = {"opposite belts": (radius < 1 - 1e-6, (0, 1)), "arcs": (radius > 1 + 1e-6, (1, _WIDEST))}
    kinds = {kind: (rows, ends) for kind, (rows, ends) in kinds.items() if rows.any()}
    for rows, ends in kinds.values():
        axis.plot(ends, [np.median(measured[rows])] * 2, color=BLACK, lw=2)
    looks = {MEASURED: {"ls": "none", "marker": ".", "color": GREY, "ms": 5}} | _points(found)
    handles = [style.key("measured median", color=BLACK, lw=2)]
    for row, look in looks.items():
        values = measured if row == MEASURED else offset(found.twists[row])
        axis.plot(radius, values, **look)
        medians = " and ".join(f"{np.median(values[rows]):.0f} mm" for rows, _ in kinds.values())
        handles.append(style.key(f"{title(row)}: {medians}", **look))
    axis.axvline(1, color=GREY, lw=0.8, ls=":")
    low, high = np.quantile(measured, [0.02, 0.98])
    axis.set(xlabel="radius without slip over half gauge [–]: below 1, the belts run against each other")
    axis.set(ylabel="D [mm]", title="D by kind of turn", xlim=(0, _WIDEST), ylim=(low - 20, high + 20))
    style.legend_below(figure, handles)
    return figure


@style.styled
def ahead(found: Findings) -> Figure | None:
    """Median errors of position and heading over the time ahead; None for steady driving."""
    if found.samples is not None:
        return None
    panels = []
    for name, label, factor in (
        ("Position", "median error [m]", 1.0),
        ("Heading", "median error [°]", np.degrees(1.0)),
    ):
        lines = []
        for row, errors in found.rows.items():
            values = {at: getattr(one, f"{name.lower()}_median") for at, one in errors.items()}
            lines.append(([(at, factor * x) for at, x in values.items() if x is not None], _look(row)))
        panels.append((name, label, lines))
    figure = style.errors_ahead(panels, [*found.rows[TODAY]], "time ahead [s]")
    style.legend_below(figure, [style.key(title(row), **_look(row)) for row in found.rows], handlelength=3.2)
    return figure


@style.styled
def tracks(found: Findings) -> Figure | None:
    """The sensor's path in one window."""
    if not found.tracks:
        return None
    figure, axis = style.subplots(4.0)
    for row, path in found.tracks.items():
        axis.plot(*path[:, :2].T, **_look(row))
    style.plane(axis, adjustable="datalim", title="One window")
    style.legend_below(figure, [style.key(title(row), **_look(row)) for row in found.tracks], handlelength=3.2)
    return figure


def _look(row: str) -> dict[str, Any]:
    return _ROWS[row][1] if row in _ROWS else style.law_line(row)


def _points(found: Findings) -> dict[str, dict[str, Any]]:
    """Looks of points of the best law and of the simulator."""
    rows = {found.best: (BLUE, "o"), DATA_SHEET: (GREEN, "^"), CALIBRATED: (ORANGE, "s")}
    look = {"ls": "none", "ms": 3.5, "mew": 0.7, "mfc": "none"}
    return {row: {"color": c, "marker": m, **look} for row, (c, m) in rows.items() if row in found.twists}
