"""Figures on an identification: slip against speed and radius with the laws, and paths of
drives.
"""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap

from experiments.common import style
from experiments.common.chart import WIDE, Chart, dots, law_curve
from experiments.common.colours import BLACK, GREY
from experiments.identify.turns import TRACKS, Turns
from trackslip.identification.result import Identification
from trackslip.identification.steady import SteadyComparison
from trackslip.kinematics import Array
from trackslip.laws.exponential import PUBLISHED
from trackslip.laws.file import NO_SLIP
from trackslip.odometry.evaluation import Trajectory, moved, trajectory_of
from trackslip.odometry.identified import identified_law, no_slip

# ratio of the largest to the smallest radius above which the axis is logarithmic
_WIDE: Final = 8.0
# least radius of curves, and least upper end of the radius axis [m]
_LEAST_RADIUS: Final = 1e-3
_LEAST_SPAN: Final = 0.5
_POLE: Final = 1.0  # slip above which a law is near its pole [-]
_RUN: Final = "#444444"
_FEWEST: Final = 10  # number of positions that are too few for a figure
_PIECES: Final = 6  # approximate number of pieces of a drive that are predicted
AHEAD: Final = 10.0
"""Duration of a piece of a drive that is predicted [s]."""
_SHADES: Final = ListedColormap([style.shade(style.RADII_SHADES, k / 31) for k in range(32)])
_BARS: Final[dict[str, Any]] = {"fmt": "none", "ecolor": GREY, "lw": 0.8}


@style.styled
def slip_against_speed(turns: Turns) -> style.Panels:
    """Slip of the inner and outer track against speed, coloured by observed radius (the paper's
    Fig. 5).
    """
    panels = []
    for track, name in enumerate(TRACKS):
        figure, axes = style.panel(
            f"{name.capitalize()} track", "measured speed [m/s]", "slip i [–]"
        )
        slip = turns.slip[:, track]
        if turns.slip_error is not None:
            axes.errorbar(turns.speed, slip, turns.slip_error[:, track], **_BARS)
        points = axes.scatter(turns.speed, slip, c=turns.radius, cmap=_SHADES, s=20, zorder=4)
        fastest = max(float(turns.speed.max()), 1e-3)
        axes.set(xlim=(0.0, 1.1 * fastest), ylim=_limits(slip))
        figure.colorbar(points, label="observed radius R [m]", aspect=30)
        panels.append(figure)
    return tuple(panels)


@style.styled
def fitted_laws(turns: Turns, comparison: SteadyComparison, names: Sequence[str]) -> style.Panels:
    """Slip against observed radius, with the fitted laws `names`, which include the best, and the
    published law (the paper's Fig. 6).
    """
    laws = {name: comparison.laws[name].law for name in names} | {"published": PUBLISHED}
    looks = _law_lines(laws, comparison.best)
    radius = curve_radii(turns)
    panels = []
    for track, side in enumerate(TRACKS):
        figure, axes = style.panel(f"{side.capitalize()} track", "", "slip i [–]", height=4.6)
        slip = turns.slip[:, track]
        axes.plot(turns.radius, slip, "o", color=_RUN, ms=4, mew=0, zorder=6, label="runs")
        if turns.slip_error is not None:
            error = turns.slip_error[:, track]
            axes.errorbar(turns.radius, slip, error, turns.radius_error, **_BARS)
        for name, look in looks.items():
            for curve in turns.curves(laws[name], radius):
                by_law = curve[:, track]
                drawn = np.where(np.abs(by_law) < _POLE, by_law, np.nan)
                axes.plot(radius, drawn, **look)
                look = look | {"label": ""}
        axes.set_ylim(_limits(slip))
        show_radii(axes, turns)
        style.legend_below(figure, axes.get_legend_handles_labels()[0], handlelength=3.2)
        panels.append(figure)
    return tuple(panels)


def _law_lines(names: Iterable[str], best: str) -> dict[str, dict[str, Any]]:
    """Line keywords by law; the best law's line is thick, and comes first so that it lies below the
    others.
    """
    looks = {name: style.law_line(name, lw=1.2, label=name) for name in names}
    looks_of_best = looks.pop(best) | {"lw": 3.0, "label": f"{best} (best)"}
    return {best: looks_of_best, **looks}


def _limits(values: Array) -> tuple[float, float]:
    """Limits of an axis that shows values (n,) and zero."""
    low = min(0.0, float(values.min()))
    high = max(0.0, float(values.max()))
    room = 0.15 * (high - low) + 1e-4
    return low - room, high + room


def _is_wide(turns: Turns) -> bool:
    """Whether the radii need a logarithmic axis; False if there are turns on the spot."""
    return bool(0 < turns.radius.min() < turns.radius.max() / _WIDE)


def curve_radii(turns: Turns) -> Array:
    """Radii (m,) [m] for curves of laws, slightly beyond the runs' radii at both ends."""
    least = max(0.85 * float(turns.radius.min()), _LEAST_RADIUS)
    most = max(1.08 * float(turns.radius.max()), _LEAST_SPAN)
    return np.geomspace(least, most, 300) if _is_wide(turns) else np.linspace(least, most, 300)


def show_radii(axes: Axes, turns: Turns) -> None:
    """Set up the radius axis: linear from zero, or logarithmic if the radii differ much."""
    radius = curve_radii(turns)
    axes.set_xlabel("observed radius R [m]")
    if _is_wide(turns):
        axes.set(xscale="log", xlim=(radius[0], radius[-1]))
        style.log_ticks(axes.xaxis)
    else:
        axes.set_xlim(-0.04 * radius[-1], radius[-1])


def predicted_paths(result: Identification, names: Sequence[str]) -> Chart | None:
    """Measured positions of the longest drive, and pieces predicted without slip and by the laws
    `names`.

    None if no log has more than a few positions.
    """
    assert result.drive is not None
    drives = {drive.name for drive in result.drive.look.drives}
    logs = [log for log in result.logs if log.run in drives and log.has_place.sum() > _FEWEST]
    log = max(logs, key=lambda log: np.ptp(log.time), default=None)
    if log is None:
        return None
    measured = log.pose[log.has_place, :2]
    best = identified_law(result, result.drive.best)
    assert best.mounting is not None
    laws = {NO_SLIP: no_slip(result.geometry)}
    laws |= {name: identified_law(result, name) for name in names if name != NO_SLIP}
    curves = [dots(measured[style.thin(len(measured), 1500)], "measured")]
    starts: Array = np.empty((0, 2))
    for name, law in laws.items():
        mounting = law.mounting or best.mounting
        clock = best.clock_offset if law.clock_offset is None else law.clock_offset
        drive = trajectory_of(log, law.odometry(), mounting, clock or 0.0)
        path, starts = _predicted_pieces(drive)
        curves.append(law_curve(path[:, 0], path[:, 1], name, width=1.8))
    curves.append(dots(starts, "start of a prediction", BLACK, 4.0))
    return Chart("", "x [m]", "y [m]", curves, 5.4, WIDE, is_map=True)


def _predicted_pieces(drive: Trajectory) -> tuple[Array, Array]:
    """Predicted positions (n, 2) of some pieces of a drive, each from the measured pose at its
    begin and separated by NaN, and the positions (p, 2) at their begins [m].
    """
    gap = np.full((1, 2), np.nan)
    parts = [gap]
    starts = [gap]
    for rows in _pieces(drive):
        first = rows.start
        turn = float(drive.heading[first] - drive.estimated[first, 2])
        begin = drive.estimated[first, :2]
        path = moved(drive.estimated[rows], turn, begin, drive.measured[first, :2])[:, :2]
        parts += [path, gap]
        starts.append(path[:1])
    return np.concatenate(parts), np.concatenate(starts)


def _pieces(drive: Trajectory) -> list[slice]:
    """Rows of a few pieces of a drive, each of duration AHEAD and starting at a pose with a known
    heading.
    """
    times = np.arange(drive.time[0], drive.time[-1] + AHEAD / 2, AHEAD)
    edges = np.searchsorted(drive.time, times)
    pieces = [
        slice(a, b) for a, b in pairwise(edges.tolist()) if b > a and np.isfinite(drive.heading[a])
    ]
    return pieces[:: max(1, len(pieces) // _PIECES)]
