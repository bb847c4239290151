"""Plots over time and the layout of the viewer: 3-D and plan on the left, plots on the right.

The viewer draws the entities of a panel, and lists them in its legend, by the alphabet: what comes later lies on top.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from experiments.recorder.model import GROUND, ROBOT
from experiments.recorder.stream import CAMERA, TIMELINE, Recording
from trackslip.kinematics import Array

LEFT, RIGHT = "#56B4E9", "#E69F00"  # tracks in every panel; all colours are from Okabe and Ito's palette
_EYE = np.array([-1.25, -1.1, 1.0])  # camera position relative to a robot [m]
_FARTHER = 1.4  # factor on it for several robots
_BEFORE, _LOOP = 1.0, 6.0  # start of the loop before the moment of interest, and length of the loop [s]
_ASPECT = 1.9  # width over height of the plan
_LEGEND = 1.25  # width of a plot over that of its data: the legend stands beside the data
_BACKGROUND = (30, 32, 36)
_COMMON = (5.0, 95.0)  # percentiles of values within the range of an axis
_MARGIN = 0.25  # around them, relative to their span


@dataclass(frozen=True)
class Panel:
    """A plot over time."""

    title: str
    entities: Sequence[str]
    height: float = 1.0  # relative to the other panels
    tab: str = "Slip and errors"  # the tab with the panel, if there are several
    has_outliers: bool = False  # show most values rather than all of them


def common_range(values: Sequence[Array]) -> tuple[float, float]:
    """Range of an axis with zero and most of some values, NaN where there is none."""
    every = np.concatenate([part.ravel() for part in values])
    low, high = np.percentile([0.0, *every[np.isfinite(every)]], _COMMON)
    low, high = min(low, 0.0), max(high, 0.0)
    margin = _MARGIN * (high - low) + 1e-3
    return float(low - margin), float(high + margin)


def send_layout(
    recording: Recording, roots: Sequence[str], panels: Sequence[Panel], within: Array, moment: float, duration: float
) -> None:
    """Send the layout of the viewer for runs of a `duration` [s] below the entities `roots`.

    Panels without lines in the recording are left out. The plan shows the points `within` (n, 2) [m]; the viewer loops
    around a `moment` [s].
    """
    many = len(roots) > 1
    target, eye = np.array([0.0, 0.0, 0.2]), _EYE * (_FARTHER if many else 1.0)
    space = rrb.Spatial3DView(
        origin=f"/{CAMERA}",
        contents=["+ /**"],
        name="Robots and field" if many else "Robot and field",
        background=_BACKGROUND,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(kind="Orbital", position=target + eye, look_target=target, eye_up=[0, 0, 1]),
    )
    middle = (within.min(axis=0) + within.max(axis=0)) / 2
    wide, high = np.ptp(within, axis=0)
    above = [*middle, max(wide / _ASPECT, high) + 1.0]
    plan = rrb.Spatial3DView(
        origin="/",
        contents=["+ /**", f"- /{GROUND}/**", *(f"- /{root}/{ROBOT}/chassis/contact_forces/**" for root in roots)],
        name="Plan [grid: 1 m]",
        background=_BACKGROUND,
        line_grid=rrb.LineGrid3D(visible=True, spacing=1.0, color=(90, 90, 90, 120)),
        eye_controls=rrb.EyeControls3D(kind="Orbital", position=above, look_target=[*middle, 0.0], eye_up=[0, 1, 0]),
    )
    views: rrb.Container = rrb.Vertical(space, plan, row_shares=[1.2, 1])
    if tabs := _tabs(roots, panels, recording.plotted, duration):
        views = rrb.Horizontal(views, rrb.Tabs(*tabs) if len(tabs) > 1 else tabs[0], column_shares=[1, 1.1])
    begin = max(0.0, min(moment - _BEFORE, duration - _LOOP))
    loop = rrb.components.AbsoluteTimeRange(min=round(1e9 * begin), max=round(1e9 * (begin + _LOOP)))
    time = rrb.TimePanel(
        timeline=TIMELINE, state="collapsed", play_state="playing", loop_mode="selection", time_selection=loop
    )
    folded = rrb.BlueprintPanel(state="collapsed"), rrb.SelectionPanel(state="collapsed")
    recording.stream.send_blueprint(rrb.Blueprint(views, time, *folded, auto_views=False, auto_layout=False))


def _tabs(
    roots: Sequence[str], panels: Sequence[Panel], plotted: Mapping[str, Array], duration: float
) -> list[rrb.Container]:
    """The panels that have any of the entities `plotted`, in their tabs; one legend is enough for several runs."""
    tabs: dict[str, list[tuple[float, rrb.TimeSeriesView]]] = {}
    span = [rr.TimeRangeBoundary.absolute(seconds=seconds) for seconds in (0.0, duration * _LEGEND)]
    for panel in panels:
        entities = [f"{root}/{name}" for root in roots for name in panel.entities if f"{root}/{name}" in plotted]
        if not entities:
            continue
        shown = common_range([plotted[entity] for entity in entities]) if panel.has_outliers else None
        view = rrb.TimeSeriesView(
            origin="/",
            contents=[f"+ /{entity}" for entity in entities],
            name=panel.title,
            axis_x=rrb.TimeAxis(view_range=rr.TimeRange(*span)),
            axis_y=None if shown is None else rrb.ScalarAxis(range=shown, zoom_lock=False),
            plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.RightTop, visible=len(roots) == 1 or not tabs),
        )
        tabs.setdefault(panel.tab, []).append((panel.height, view))
    return [
        rrb.Vertical(*(view for _, view in inside), name=name, row_shares=[height for height, _ in inside])
        for name, inside in tabs.items()
    ]
