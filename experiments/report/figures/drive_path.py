"""Figure of a drive's path: measured poses, estimated trajectory, and pieces predicted by laws."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from experiments.report.colours import BLUE, GREY, RED
from experiments.report.drives import longest, title_of
from experiments.report.figures.style import law_line, legend_below, styled, subplots, thin
from trackslip.identification.drive.comparison import DriveComparison
from trackslip.identification.drive.fit import Fit
from trackslip.identification.drive.prediction import Predictions
from trackslip.identification.drive.reckoning import rotated
from trackslip.identification.drive.residuals import Nodes
from trackslip.kinematics import Array

_PIECES = 5
_POINTS = 1500  # poses drawn
_LINE = "#555555"


@styled
def path_and_predictions(found: DriveComparison) -> Figure:
    """The longest drive: measured poses and trajectory on the left, predicted pieces on the right."""
    fit, which = found.laws[found.best].fit, longest(found)
    rows = slice(fit.nodes.first[which], fit.nodes.first[which + 1])
    state, pose = fit.states[rows], fit.nodes.pose[rows]
    used = fit.nodes.weight[rows, 0] > 0
    measured = Nodes.of(fit.nodes.drives).weight[rows, 0] > 0
    low, high = _limits(state[:, :2], pose[used, :2])
    height, width = high[1] - low[1], high[0] - low[0]
    figure, (left, right) = subplots(
        float(np.clip(4.2 * height / width, 1.6, 6.2)) + 0.8, 1, 2, sharex=True, sharey=True, across=0.3
    )
    left.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    seen = np.flatnonzero(used)[thin(int(used.sum()), _POINTS)]
    left.plot(*pose[seen, :2].T, ".", color=GREY, ms=5, mew=0, label="measured poses")
    out = measured & ~used
    for axis in (left, right):
        shown = thin(len(state), _POINTS)
        # broken where the poses jump lastingly, as the robot did not drive there
        line = np.where(_broken(fit, rows)[:, None], np.nan, state[:, :2])[shown]
        axis.plot(*line.T, color=BLUE if axis is left else _LINE, lw=1.0, label="estimated trajectory")
        axis.set(aspect="equal", xlabel="x [m]")
    if out.any():
        left.plot(*pose[out, :2].T, "x", color=RED, ms=5, mew=1.0, label="left out as outlying")
    left.set(ylabel="y [m]", title="Measured and estimated")
    names = compared(found)
    _draw_pieces(right, found, names, rows)
    handles = [*left.get_legend_handles_labels()[0]]
    handles += [Line2D([], [], lw=1.8, label=title_of(name), **law_line(name)) for name in names]
    legend_below(figure, handles, handlelength=3.2)
    return figure


def compared(found: DriveComparison) -> list[str]:
    """Laws whose predictions are drawn: the best, one of constant ICRs, and none."""
    return [name for name in dict.fromkeys([found.best, "icr_radius", "none"]) if name in found.laws]


def predicted_path(fit: Fit, predictions: Predictions, k: int) -> Array:
    """Positions (m, 2) of the sensor at the nodes from the start of prediction `k` to its end [m]."""
    nodes = fit.nodes
    start, horizon = int(predictions.start[k]), float(predictions.horizon[k])
    which = int(np.searchsorted(nodes.first, start, side="right")) - 1
    drive, node = nodes.drives[which], start - int(nodes.first[which])
    end = int(np.searchsorted(drive.time, drive.time[node] + horizon - drive.interval / 2))
    path = fit.model.sensor_path(predictions.values[predictions.part[k]], drive)[node : end + 1]
    turned = np.full(len(path), predictions.heading[k] - path[0, 2])
    return np.asarray(nodes.pose[start, :2] + rotated(turned, path[:, :2] - path[0, :2]))


def _draw_pieces(axis: Axes, found: DriveComparison, names: Sequence[str], rows: slice) -> None:
    """Draw predictions from a few starts in the rows of a drive, over the longest horizon there is."""
    first = found.predictions[names[0]]
    there = (first.start >= rows.start) & (first.start < rows.stop)
    if not there.any():
        axis.set_title("No prediction: the drive is too short")
        return
    horizon = float(first.horizon[there].max())
    starts = first.start[there & (first.horizon == horizon)]
    time = found.laws[names[0]].fit.nodes.time
    chosen: list[int] = []
    for wanted in np.linspace(time[starts[0]], time[starts[-1]], _PIECES):
        near = int(starts[np.abs(time[starts] - wanted).argmin()])
        if not chosen or time[near] - time[chosen[-1]] >= horizon:
            chosen.append(near)
    for name in reversed(names):
        predictions = found.predictions[name]
        for k in np.flatnonzero(np.isin(predictions.start, chosen) & (predictions.horizon == horizon)):
            path = predicted_path(found.laws[name].fit, predictions, int(k))
            axis.plot(*path.T, lw=1.8, **law_line(name))
            axis.plot(*path[-1], "s", ms=4, color=law_line(name)["color"])
    axis.plot(*found.laws[names[0]].fit.nodes.pose[chosen, :2].T, "ok", ms=4, zorder=6)
    axis.set_title(f"Predicted {horizon:g} s ahead, from the dots")


def _broken(fit: Fit, rows: slice) -> np.ndarray:
    """(k,) bool: whether the poses of a drive jump lastingly on the way to each of its nodes."""
    link = np.append(1.0, fit.nodes.link)[rows]
    link[0] = 1.0
    return np.asarray(link == 0)


def _limits(*points: Array) -> tuple[Array, Array]:
    """Lower left and upper right corner (2,) of axes that show all points (n, 2), with some room around them."""
    every = np.concatenate(points)
    low, high = every.min(axis=0), every.max(axis=0)
    room = 0.06 * float((high - low).max()) + 0.02
    return low - room, high + room
