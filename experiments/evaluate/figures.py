"""Figures of predictions: the errors of all models, and paths."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.common import style
from experiments.common.colours import BLACK, GREEN, GREY, RED
from experiments.common.laws import shown
from experiments.evaluate.models import CALIBRATED, GAINS, ROBOT, TODAY
from experiments.evaluate.prediction import Prediction, best, decisive
from trackslip.odometry.trajectory_errors import Trajectory, absolute_errors

_LOOKS: dict[str, tuple[str, dict[str, Any]]] = {
    TODAY: ("no slip, as today", {"color": RED, "linestyle": (0, (12, 1.5))}),
    GAINS: ("two gains", {"color": GREY, "linestyle": (0, (6, 2))}),
    ROBOT: ("simulated robot", {"color": GREEN, "linestyle": "--"}),
    CALIBRATED: ("simulated robot, calibrated", {"color": GREEN, "lw": 2.4}),
}
"""Titles and lines of the models that aren't laws."""
_POINTS = 1500  # poses drawn
_WIDTH = 4.6  # of a panel, about a phone's [in]


def title(one: Prediction) -> str:
    """Name of a model on a page."""
    name = _LOOKS[one.name][0] if one.name in _LOOKS else shown(one.name).label
    return one.label.replace(one.name, name) if one.name in one.label else f"{name} {one.label}"


def _look(one: Prediction) -> dict[str, Any]:
    return _LOOKS[one.name][1] if one.name in _LOOKS else style.law_line(one.name)


@style.styled
def errors_ahead(found: Sequence[Prediction]) -> style.Panels:
    """Median errors at the decisive length, with lines to the errors that 90 % stay below."""
    length, unit = decisive(found)
    figures = []
    for what, sign, factor in (("position", "m", 1.0), ("heading", "°", np.degrees(1.0))):
        figure = Figure(figsize=(_WIDTH, 0.9 + 0.28 * len(found)), layout="constrained")
        axis = figure.subplots()
        for k, one in enumerate(found):
            errors = getattr(one.ahead(length, unit), what, None)
            if errors is not None:
                axis.plot([factor * errors.median, factor * errors.p90], [k, k], color=_look(one)["color"], lw=1.5)
                axis.plot(factor * errors.median, k, "o", color=_look(one)["color"], ms=6)
        axis.set(title=what.capitalize(), xlabel=f"error after {length:g} {unit} [{sign}]", xscale="log")
        style.log_ticks(axis.xaxis)
        axis.set_yticks(range(len(found)), map(title, found))
        axis.set_ylim(len(found) - 0.5, -0.5)
        figures.append(figure)
    return tuple(figures)


@style.styled
def paths(found: Sequence[Prediction]) -> style.Panels:
    """A typical drive: paths from its first measured pose, and their errors over the way."""
    figures = [Figure(figsize=(_WIDTH, 4.6), layout="constrained") for _ in range(2)]
    left, right = (figure.subplots() for figure in figures)
    drive = typical(found)
    shown = style.thin(len(drive.time), _POINTS)
    left.plot(*drive.measured[shown, :2].T, ".", color=BLACK, ms=4, mew=0, label="measured poses")
    for one in found:
        path = one.drive(drive.name)
        left.plot(*path.placed[shown, :2].T, label=title(one), **_look(one))
        error = np.hypot(*(path.placed - path.measured)[shown, :2].T)
        way = (path.way - path.way[0])[shown]
        right.plot(way, np.where(error > 0, error, np.nan), label=title(one), **_look(one))
    style.plane(left, adjustable="datalim", title="Paths")
    right.set(xlabel="distance [m]", ylabel="error of position [m]", yscale="log")
    right.set_title("Error from the first pose on" if drive.has_heading else "Error, fitted to all positions")
    style.log_ticks(right.yaxis)
    for figure, axis in zip(figures, (left, right), strict=True):
        figure.legend(handles=axis.lines, loc="outside lower center", ncols=2, handlelength=3.2)
    return tuple(figures)


def typical(found: Sequence[Prediction]) -> Trajectory:
    """The drive with the median error of the best model, of those of the half that goes farthest that turn most."""
    drives = list(best(found).errors.trajectories)
    for size in (_way, _turn):
        drives = sorted(drives, key=size)[len(drives) // 2 :]
    errors = [float(np.max(absolute_errors(drive, not drive.has_heading)[0])) for drive in drives]
    return drives[int(np.argsort(errors)[len(drives) // 2])]


def _way(drive: Trajectory) -> float:
    return float(drive.way[-1] - drive.way[0])


def _turn(drive: Trajectory) -> float:
    return float(np.ptp(drive.estimated[:, 2]))
