"""Plots over time and the layout of the viewer: 3-D view and plan on the left, plots on the right.

The viewer draws a panel's entities, and lists them in its legend, in alphabetical order; later
entities lie on top.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from experiments.recorder.model import GROUND
from experiments.recorder.stream import CAMERA, TIMELINE, Recording
from trackslip.kinematics import Array

# tracks in every panel; all colours are from Okabe and Ito's palette
LEFT, RIGHT = "#56B4E9", "#E69F00"
# viewpoint and target, relative to the entity CAMERA [m]
_EYE, _TARGET = [-1.4, -1.2, 1.3], [0.0, 0.0, 0.2]
_LEGEND = 1.25  # plot width over data width, which leaves room for the legend beside the data
_ASPECT = 1.9  # width over height of the plan
_BACKGROUND = (30, 32, 36)
# percentiles of the values that an axis shows, and relative margin [-]
_COMMON, _MARGIN = (1.0, 99.0), 0.1


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
    space = rrb.Spatial3DView(
        origin=f"/{CAMERA}",
        contents=["+ /**"],
        name="Robot and field",
        background=_BACKGROUND,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind="Orbital", position=_EYE, look_target=_TARGET, eye_up=[0, 0, 1]
        ),
    )
    middle = (within.min(axis=0) + within.max(axis=0)) / 2
    wide, high = np.ptp(within, axis=0)
    above = [*middle, max(wide / _ASPECT, high) + 1.0]
    plan = rrb.Spatial3DView(
        origin="/",
        contents=["+ /**", f"- /{GROUND}/**"],
        name="Plan [grid: 1 m]",
        background=_BACKGROUND,
        line_grid=rrb.LineGrid3D(visible=True, spacing=1.0, color=(90, 90, 90, 120)),
        eye_controls=rrb.EyeControls3D(
            kind="Orbital", position=above, look_target=[*middle, 0.0], eye_up=[0, 1, 0]
        ),
    )
    views: rrb.Container = rrb.Vertical(space, plan, row_shares=[1.2, 1])
    if tabs := _tabs(recording, roots, panels):
        views = rrb.Horizontal(
            views, rrb.Tabs(*tabs) if len(tabs) > 1 else tabs[0], column_shares=[1, 1.1]
        )
    time = rrb.TimePanel(
        timeline=TIMELINE, state="collapsed", play_state="playing", loop_mode="all"
    )
    folded = rrb.BlueprintPanel(state="collapsed"), rrb.SelectionPanel(state="collapsed")
    recording.stream.send_blueprint(
        rrb.Blueprint(views, time, *folded, auto_views=False, auto_layout=False)
    )


def _tabs(
    recording: Recording, roots: Sequence[str], panels: Sequence[Panel]
) -> list[rrb.Container]:
    """Tabs with the panels that have lines in the recording; for several runs, only the first panel
    has a legend.
    """
    plotted = recording.plotted
    span = [
        rr.TimeRangeBoundary.absolute(seconds=seconds)
        for seconds in (0.0, recording.duration * _LEGEND)
    ]
    tabs: dict[str, list[tuple[float, rrb.TimeSeriesView]]] = {}
    for panel in panels:
        entities = [
            f"{root}/{name}"
            for root in roots
            for name in panel.entities
            if f"{root}/{name}" in plotted
        ]
        if not entities:
            continue
        axis = None
        if panel.has_outliers:
            values = np.concatenate([[0.0], *(plotted[entity].ravel() for entity in entities)])
            low, high = np.nanpercentile(values, _COMMON)
            margin = _MARGIN * (high - low) + 1e-3
            axis = rrb.ScalarAxis(range=(low - margin, high + margin), zoom_lock=False)
        view = rrb.TimeSeriesView(
            origin="/",
            contents=[f"+ /{entity}" for entity in entities],
            name=panel.title,
            axis_x=rrb.TimeAxis(view_range=rr.TimeRange(*span)),
            axis_y=axis,
            plot_legend=rrb.PlotLegend(
                corner=rrb.Corner2D.RightTop, visible=len(roots) == 1 or not tabs
            ),
        )
        tabs.setdefault(panel.tab, []).append((panel.height, view))
    return [
        rrb.Vertical(
            *(view for _, view in inside), name=name, row_shares=[height for height, _ in inside]
        )
        for name, inside in tabs.items()
    ]
