"""Plots over time and the layout of the viewer: 3-D view and plan on the left, plots on the right.

The viewer draws a panel's entities, and lists them in its legend, in alphabetical order; later
entities lie on top.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from experiments.recorder.model import GROUND
from experiments.recorder.stream import CAMERA, TIMELINE, Recording
from trackslip.kinematics import Array

# tracks in every panel; all colours are from Okabe and Ito's palette
LEFT: Final = "#56B4E9"
RIGHT: Final = "#E69F00"
# slips of the tracks as measured, which lie over the true ones
LEFT_MEASURED: Final = "#009E73"
RIGHT_MEASURED: Final = "#CC79A7"
# viewpoint and target, relative to the entity CAMERA [m]
_EYE: Final = (-1.4, -1.2, 1.3)
_TARGET: Final = (0.0, 0.0, 0.2)
# plot width over data width, which leaves room for the legend beside the data
_LEGEND: Final = 1.25
_ASPECT: Final = 1.9  # width over height of the plan
_BACKGROUND: Final = (30, 32, 36)
_COMMON: Final = (1.0, 99.0)  # percentiles of the values that an axis shows
_MARGIN: Final = 0.1  # relative margin of an axis around these values [-]


@dataclass(frozen=True)
class Panel:
    """A plot over time."""

    title: str
    entities: Sequence[str]
    height: float = 1.0  # height relative to the other panels
    tab: str = "Slip and errors"  # the tab with the panel, if there are several tabs
    has_outliers: bool = False  # if true, the axis shows most values rather than all of them


def send_layout(
    recording: Recording, roots: Sequence[str], panels: Sequence[Panel], within: Array
) -> None:
    """Send the layout of the viewer for runs below the entities `roots`.

    Panels without lines in the recording are left out. The plan shows the points `within` (n, 2)
    [m].
    """
    views: rrb.Container = rrb.Vertical(_space(), _plan(within), row_shares=[1.2, 1])
    tabs = _tabs(recording, roots, panels)
    if tabs:
        plots = rrb.Tabs(*tabs) if len(tabs) > 1 else tabs[0]
        views = rrb.Horizontal(views, plots, column_shares=[1, 1.1])
    time = rrb.TimePanel(
        timeline=TIMELINE, state="collapsed", play_state="playing", loop_mode="all"
    )
    blueprint = rrb.Blueprint(
        views,
        time,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )
    recording.stream.send_blueprint(blueprint)


def _space() -> rrb.Spatial3DView:
    """A view of robot and field that follows the robot."""
    eye = rrb.EyeControls3D(kind="Orbital", position=_EYE, look_target=_TARGET, eye_up=[0, 0, 1])
    return rrb.Spatial3DView(
        origin=f"/{CAMERA}",
        contents=["+ /**"],
        name="Robot and field",
        background=_BACKGROUND,
        line_grid=False,
        eye_controls=eye,
    )


def _plan(within: Array) -> rrb.Spatial3DView:
    """A view from above that shows the points `within` (n, 2) [m]."""
    middle = (within.min(axis=0) + within.max(axis=0)) / 2
    width, height = np.ptp(within, axis=0)
    above = [*middle, max(width / _ASPECT, height) + 1.0]
    eye = rrb.EyeControls3D(
        kind="Orbital", position=above, look_target=[*middle, 0.0], eye_up=[0, 1, 0]
    )
    grid = rrb.LineGrid3D(visible=True, spacing=1.0, color=(90, 90, 90, 120))
    return rrb.Spatial3DView(
        origin="/",
        contents=["+ /**", f"- /{GROUND}/**"],
        name="Plan [grid: 1 m]",
        background=_BACKGROUND,
        line_grid=grid,
        eye_controls=eye,
    )


def _tabs(
    recording: Recording, roots: Sequence[str], panels: Sequence[Panel]
) -> list[rrb.Container]:
    """Tabs with the panels that have lines in the recording; for several runs, only the first panel
    has a legend.
    """
    tabs: dict[str, list[tuple[float, rrb.TimeSeriesView]]] = {}
    for panel in panels:
        names = [f"{root}/{entity}" for root in roots for entity in panel.entities]
        plotted = [name for name in names if name in recording.plotted]
        if plotted:
            has_legend = len(roots) == 1 or not tabs
            view = _panel_view(recording, panel, plotted, has_legend)
            tabs.setdefault(panel.tab, []).append((panel.height, view))

    containers: list[rrb.Container] = []
    for name, inside in tabs.items():
        heights = [height for height, _ in inside]
        views = [view for _, view in inside]
        containers.append(rrb.Vertical(*views, name=name, row_shares=heights))
    return containers


def _panel_view(
    recording: Recording, panel: Panel, entities: Sequence[str], has_legend: bool
) -> rrb.TimeSeriesView:
    """The view of a panel with these lines."""
    begin = rr.TimeRangeBoundary.absolute(seconds=0.0)
    end = rr.TimeRangeBoundary.absolute(seconds=recording.duration * _LEGEND)
    axis = None
    if panel.has_outliers:
        axis = _axis([recording.plotted[entity] for entity in entities])
    return rrb.TimeSeriesView(
        origin="/",
        contents=[f"+ /{entity}" for entity in entities],
        name=panel.title,
        axis_x=rrb.TimeAxis(view_range=rr.TimeRange(begin, end)),
        axis_y=axis,
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.RightTop, visible=has_legend),
    )


def _axis(lines: Sequence[Array]) -> rrb.ScalarAxis:
    """An axis that shows zero and most of the lines' values."""
    values = np.concatenate([[0.0], *(line.ravel() for line in lines)])
    low, high = np.nanpercentile(values, _COMMON)
    margin = _MARGIN * (high - low) + 1e-3
    return rrb.ScalarAxis(range=(low - margin, high + margin), zoom_lock=False)
