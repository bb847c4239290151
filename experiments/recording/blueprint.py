"""Layout of the viewer: 3-D and plan on the left, plots over time on the right, around the moment of interest."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from experiments.recording.columns import TIMELINE
from experiments.recording.field import FIELD
from experiments.recording.robot import CAMERA, ROBOT
from experiments.recording.series import Panel
from trackslip.kinematics import Array

_BEHIND = np.array([-1.25, -1.1, 1.0])  # camera position relative to a robot [m]
_FARTHER = 1.4  # factor on it for several robots
_BEFORE, _LOOP = 1.0, 6.0  # start of the loop before the moment of interest, and length of the loop [s]
_ASPECT = 1.9  # width over height of the plan
_LEGEND = 1.25  # width of a plot over that of its data: the legend stands beside the data
_BACKGROUND = (30, 32, 36)


def begin_of_loop(moment: float, duration: float) -> float:
    """Just before the moment of interest, in runs of that duration [s]."""
    return max(0.0, min(moment - _BEFORE, duration - _LOOP))


def blueprint(
    roots: Sequence[str], panels: Sequence[Panel], sent: Sequence[str], within: Array, begin: float, duration: float
) -> rrb.Blueprint:
    """The layout of the viewer for runs of a `duration` [s] below the entities `roots`.

    Panels without any entity among those `sent` are left out. The plan shows the points `within` (n, 2) [m]; `begin` is
    the start of the loop that the viewer plays [s].
    """
    plots = [
        (panel, entities)
        for panel in panels
        if (entities := [f"{root}/{name}" for root in roots for name in panel.entities if f"{root}/{name}" in sent])
    ]
    if plots and not any(panel.legend for panel, _ in plots):
        plots[0] = (replace(plots[0][0], legend=True), plots[0][1])
    target, one = np.array([0.0, 0.0, 0.2]), len(roots) == 1
    eye = target + (_BEHIND if one else _FARTHER * _BEHIND)
    space = rrb.Spatial3DView(
        origin=f"/{CAMERA}",
        contents=["+ /**"],
        name="Robot and field" if one else "Robots and field",
        background=_BACKGROUND,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(kind="Orbital", position=eye, look_target=target, eye_up=[0, 0, 1]),
    )
    middle = (within.min(axis=0) + within.max(axis=0)) / 2
    wide, high = within.max(axis=0) - within.min(axis=0)
    above = [*middle, max(wide / _ASPECT, high) + 1.0]
    left_out = [f"- /{FIELD}/ground/**", *(f"- /{root}/{ROBOT}/contact_forces/**" for root in roots)]
    plan = rrb.Spatial3DView(
        origin="/",
        contents=["+ /**", *left_out],
        name="Plan [grid: 1 m]",
        background=_BACKGROUND,
        line_grid=rrb.LineGrid3D(visible=True, spacing=1.0, color=(90, 90, 90, 120)),
        eye_controls=rrb.EyeControls3D(kind="Orbital", position=above, look_target=[*middle, 0.0], eye_up=[0, 1, 0]),
    )
    views: rrb.Container = rrb.Vertical(space, plan)
    if plots:
        left = rrb.Vertical(space, plan, row_shares=[1.2, 1])
        views = rrb.Horizontal(left, _tabs(plots, duration), column_shares=[1, 1.1])
    return rrb.Blueprint(
        views,
        rrb.TimePanel(
            timeline=TIMELINE,
            state="collapsed",
            play_state="playing",
            loop_mode="selection",
            time_selection=rrb.components.AbsoluteTimeRange(min=round(1e9 * begin), max=round(1e9 * (begin + _LOOP))),
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )


def _tabs(plots: Sequence[tuple[Panel, Sequence[str]]], duration: float) -> rrb.Container:
    """Panels with their entities below each other, in tabs if there is more than one."""
    tabs = []
    for name in dict.fromkeys(panel.tab for panel, _ in plots):
        inside = [(panel, entities) for panel, entities in plots if panel.tab == name]
        views = [_plot(panel, entities, duration) for panel, entities in inside]
        tabs.append(rrb.Vertical(*views, name=name, row_shares=[panel.height for panel, _ in inside]))
    return rrb.Tabs(*tabs) if len(tabs) > 1 else tabs[0]


def _plot(panel: Panel, entities: Sequence[str], duration: float) -> rrb.TimeSeriesView:
    begin, end = (rr.TimeRangeBoundary.absolute(seconds=seconds) for seconds in (0.0, duration * _LEGEND))
    return rrb.TimeSeriesView(
        origin="/",
        contents=[f"+ /{entity}" for entity in entities],
        name=panel.title,
        axis_x=rrb.TimeAxis(view_range=rr.TimeRange(begin, end)),
        axis_y=None if panel.range is None else rrb.ScalarAxis(range=panel.range, zoom_lock=False),
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.RightTop, visible=panel.legend),
    )
