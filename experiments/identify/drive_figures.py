"""Figures of laws identified from whole drives: path and predictions, residuals, the clock, correlations."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.common import style
from experiments.common.colours import BLUE, GREEN, GREY, ORANGE, RED
from experiments.common.laws import prediction_title, symbol
from experiments.identify.law_figures import draw_matrix
from trackslip.identification.comparison import DriveComparison
from trackslip.identification.drive_fit import TrajectoryFit
from trackslip.identification.drive_law import DriveFit
from trackslip.identification.drive_prediction import HORIZONS, DrivePredictions
from trackslip.identification.drive_residuals import Nodes
from trackslip.kinematics import Array, wrap_angle
from trackslip.se2 import rotate

_PIECES = 5  # of a drive that are predicted
_POSES = 1500  # drawn of a path
_POINTS = 1200  # of a panel of residuals
_LINE = "#555555"
_WITHIN = 1.96  # standard deviations of 95 % of normal residuals
_RISE = 3.84  # of -2 log likelihood at the ends of a 95 % interval


def longest(found: DriveComparison) -> int:
    """Index of the drive that lasts longest."""
    return int(np.argmax([drive.time[-1] - drive.time[0] for drive in found.drives]))


@style.styled
def path_and_predictions(found: DriveComparison) -> Figure:
    """The longest drive: measured poses and trajectory on the left, predicted pieces on the right."""
    fit, which = found.laws[found.best].fit, longest(found)
    rows = slice(fit.nodes.first[which], fit.nodes.first[which + 1])
    state, pose = fit.states[rows, :2], fit.nodes.pose[rows, :2]
    used = fit.nodes.weight[rows, 0] > 0
    out = (Nodes.of(fit.nodes.drives).weight[rows, 0] > 0) & ~used
    jump = np.append(1.0, fit.nodes.link)[rows] == 0  # lasting, on the way to a node: the robot did not drive there
    jump[0] = False
    line = np.where(jump[:, None], np.nan, state)[style.thin(len(state), _POSES)]
    figure, (left, right) = style.subplots(4.8, 1, 2, across=0.3, sharex=True, sharey=True)
    left.plot(*pose[used][style.thin(int(used.sum()), _POSES)].T, ".", color=GREY, ms=5, mew=0, label="measured poses")
    for axis, colour in ((left, BLUE), (right, _LINE)):
        axis.plot(*line.T, color=colour, lw=1.0, label="estimated trajectory")
        style.plane(axis)
    left.set(title="Measured and estimated", xlim=left.get_xlim(), ylim=left.get_ylim())  # whatever follows
    if out.any():
        left.plot(*pose[out].T, "x", color=RED, ms=5, mew=1.0, label="left out as outlying")
    right.set_ylabel("")
    names = compared(found)
    _draw_pieces(right, found, names, rows)
    laws = [style.key(prediction_title(name), **style.law_line(name, lw=1.8)) for name in names]
    style.legend_below(figure, [*left.get_legend_handles_labels()[0], *laws], handlelength=3.2)
    return figure


def compared(found: DriveComparison) -> list[str]:
    """Laws whose predictions are drawn: the best, one of constant ICRs, and none."""
    return [name for name in dict.fromkeys([found.best, "icr_radius", "none"]) if name in found.laws]


def predicted_path(fit: TrajectoryFit, predictions: DrivePredictions, k: int) -> Array:
    """Positions (m, 2) of the sensor at the nodes from the start of prediction `k` to its end [m]."""
    nodes = fit.nodes
    start, horizon = int(predictions.start[k]), float(predictions.horizon[k])
    which = int(np.searchsorted(nodes.first, start, side="right")) - 1
    drive, node = nodes.drives[which], start - int(nodes.first[which])
    end = int(np.searchsorted(drive.time, drive.time[node] + horizon - drive.interval / 2))
    path = fit.model.sensor_path(predictions.values[predictions.part[k]], drive)[node : end + 1]
    turned = predictions.heading[k] - path[0, 2]
    return np.asarray(nodes.pose[start, :2] + rotate(turned, path[:, :2] - path[0, :2]))


def _draw_pieces(axes: Axes, found: DriveComparison, names: Sequence[str], rows: slice) -> None:
    """Draw predictions from a few starts in the rows of a drive, over the longest horizon there is."""
    first, nodes = found.predictions[names[0]], found.laws[names[0]].fit.nodes
    there = (first.start >= rows.start) & (first.start < rows.stop)
    if not there.any():
        axes.set_title("No prediction: the drive is too short")
        return
    horizon = float(first.horizon[there].max())
    starts = first.start[there & (first.horizon == horizon)]
    chosen = [int(starts[0])]
    for start in starts[np.linspace(0, len(starts) - 1, _PIECES).astype(int)]:
        if nodes.time[start] >= nodes.time[chosen[-1]] + horizon:
            chosen.append(int(start))
    for name in reversed(names):
        predictions, look = found.predictions[name], style.law_line(name)
        for k in np.flatnonzero(np.isin(predictions.start, chosen) & (predictions.horizon == horizon)):
            path = predicted_path(found.laws[name].fit, predictions, int(k))
            axes.plot(*path.T, lw=1.8, **look)
            axes.plot(*path[-1], "s", ms=4, color=look["color"])
    axes.plot(*nodes.pose[chosen, :2].T, "ok", ms=4, zorder=6)
    axes.set_title(f"Predicted {horizon:g} s ahead, from the dots")


@style.styled
def residuals_over_time(law: DriveFit) -> Figure:
    """Residuals of poses and steps, drive after drive."""
    fit = law.fit
    lengths = [drive.time[-1] - drive.time[0] for drive in fit.nodes.drives]
    begins = np.cumsum([0.0, *lengths])
    joined = zip(fit.nodes.drives, begins, strict=False)
    time = np.concatenate([drive.time - drive.time[0] + begin for drive, begin in joined])
    (pose, kept), (step, linked) = pose_residuals(fit), step_residuals(fit)
    headings = bool(np.isfinite(pose[:, 2]).any())
    figure, axes = style.subplots(4.2 + 1.9 * headings, 2 + headings, down=0.4, sharex=True)
    parts: list[tuple[str, str, float, Array, Sequence[str]]] = [
        ("position", "position [mm]", 1e3, pose[:, :2], ("x", "y")),
        ("heading", "heading [°]", np.degrees(1.0), pose[:, 2:], ("",)),
    ]
    for axis, (name, label, factor, values, names) in zip(axes[:-1], parts, strict=False):
        _residual_panel(axis, time, factor * values, kept, names)
        band = _WITHIN * factor * law.noise[name]
        axis.axhspan(-band, band, color=style.BAND, lw=0, zorder=0)
        axis.set_ylabel(label)
    _residual_panel(axes[-1], (time[1:] + time[:-1]) / 2, step, linked, ("forwards", "sideways", "in turning"))
    for axis in axes:
        for begin in begins[1:-1]:
            axis.axvline(begin, color=GREY, lw=0.8, ls=":")
    axes[0].set(title="Poses: trajectory − measured", xlim=(0, time[-1]))
    axes[-1].set(title="Steps: motion − law, in standard deviations", ylabel="slip of a step [–]")
    axes[-1].set_xlabel("time, drive after drive [s]")
    handles = [style.key("95 % of normal residuals", color=style.BAND, lw=7)]
    handles.append(style.key("left out (at the edge if beyond)", ls="none", marker="x", ms=5, color=RED))
    style.legend_below(figure, handles, ncols=2)
    return figure


def pose_residuals(fit: TrajectoryFit) -> tuple[Array, np.ndarray]:
    """Trajectory minus measured poses (K, 3) [m, m, rad], NaN where not measured; and whether each was kept (K,)."""
    measured = Nodes.of(fit.nodes.drives)
    error = fit.states - fit.nodes.pose
    error[:, 2] = wrap_angle(error[:, 2] + fit.values[fit.model.index("sensor_yaw")])
    return error, fit.nodes.weight[:, 0] == measured.weight[:, 0]


def step_residuals(fit: TrajectoryFit) -> tuple[Array, np.ndarray]:
    """Slip of each step (K - 1, 3) [standard deviations], NaN between drives; and whether each was kept (K - 1,)."""
    measured = Nodes.of(fit.nodes.drives)
    scaled = fit.residuals.step / (np.sqrt(fit.residuals.distance) * fit.noise.of_steps)
    return np.where(measured.link[:, None] > 0, scaled, np.nan), fit.nodes.link == measured.link


def _residual_panel(axes: Axes, time: Array, values: Array, used: np.ndarray, names: Sequence[str]) -> None:
    """Draw residuals (n, m), thinned out; those left out as crosses, at the edge where they lie beyond."""
    finite = np.isfinite(values).all(axis=1)
    rows = np.flatnonzero(finite & used)
    rows = rows[style.thin(len(rows) * len(names), _POINTS)]
    for column, (name, colour) in enumerate(zip(names, (BLUE, ORANGE, GREEN), strict=False)):
        axes.plot(time[rows], values[rows, column], ".", color=colour, ms=2.6, mew=0, label=name)
    edge = 1.15 * float(np.abs(values[finite & used]).max(initial=1e-9))
    out = np.flatnonzero(finite & ~used)[:_POINTS]
    if len(out):
        worst = values[out, np.abs(values[out]).argmax(axis=1)]
        axes.plot(time[out], np.clip(worst, -edge, edge), "x", color=RED, ms=4.5, mew=1.0, zorder=5)
    axes.set_ylim(-1.1 * edge, 1.1 * edge)
    if len(names) > 1:
        style.legend_beside_title(axes, axes.get_legend_handles_labels()[0], markerscale=3.0)


@style.styled
def clock_offset(found: DriveComparison) -> Figure:
    """Rise of -2 log likelihood with the clock offset, and the 95 % interval; raises ValueError if it was held."""
    if found.clock is None:
        raise ValueError("the clock offset was held")
    figure, axes = style.subplots(3.2)
    axes.plot(1e3 * found.clock.offset, np.maximum(found.clock.rise, 0.0), "o-", color=BLUE, ms=4)
    axes.axhline(_RISE, color=RED, ls="--", lw=1.2, label=f"rise of {_RISE}: 95 % by the likelihood")
    low, high = found.laws[found.best].interval95["clock_offset"]
    axes.axvspan(1e3 * low, 1e3 * high, color=style.BAND, lw=0, zorder=0, label="95 % interval, wider where slip lasts")
    axes.set(xlabel="encoder clock − pose clock τ [ms]", ylabel="rise of −2 log L [–]", title="Clock offset")
    axes.set_ylim(bottom=0)
    style.legend_below(figure, axes.get_legend_handles_labels()[0], ncols=2)
    return figure


@style.styled
def drive_correlations(law: DriveFit) -> Figure:
    """Correlation matrix of all parameters fitted."""
    figure, axes = style.subplots(1.2 + 0.38 * len(law.free))
    draw_matrix(axes, law.correlation, [symbol(law.name, name) for name in law.free], prediction_title(law.name))
    return figure


@style.styled
def prediction_errors(found: DriveComparison) -> Figure:
    """Errors of prediction against the horizon, by law; position, and heading where it was measured."""
    looks = {name: style.law_line(name, lw=2.2 if name == found.best else 1.2) for name in found.ranking}
    kinds = [
        ("position_rms", 1.0, "Position", "rms error [m]"),
        ("heading_rms", np.degrees(1.0), "Heading", "rms error [°]"),
    ]
    panels = []
    for error, factor, title, label in kinds[: 1 + any(drive.has_heading for drive in found.drives)]:
        lines = [
            ([(h, factor * value) for h, e in found.errors[name].items() if (value := getattr(e, error))], look)
            for name, look in sorted(looks.items(), key=lambda item: item[0] != found.best)  # the best, thick, is below
        ]
        panels.append((title, label, lines))
    figure = style.errors_ahead(panels, HORIZONS, "time ahead [s]")
    best = {found.best: " – best"}
    handles = [style.key(prediction_title(name) + best.get(name, ""), **look) for name, look in looks.items()]
    style.legend_below(figure, handles, handlelength=3.2)
    return figure
