"""Plots over time and the layout of the viewer: 3-D and plan on the left, plots on the right.

The viewer draws the entities of a panel, and lists them in its legend, by the alphabet: what comes later lies on top.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from experiments.recorder.model import GROUND, ROBOT
from experiments.recorder.stream import CAMERA, TIMELINE, rgb, send
from trackslip.kinematics import Array

LEFT, RIGHT = "#56B4E9", "#E69F00"  # tracks in every panel; all colours are from Okabe and Ito's palette
_EYE = np.array([-1.25, -1.1, 1.0])  # camera position relative to a robot [m]
_FARTHER = 1.4  # factor on it for several robots
_BEFORE, _LOOP = 1.0, 6.0  # start of the loop before the moment of interest, and length of the loop [s]
_ASPECT = 1.9  # width over height of the plan
_LEGEND = 1.25  # width of a plot over that of its data: the legend stands beside the data
_BACKGROUND = (30, 32, 36)


@dataclass(frozen=True)
class Series:
    """Lines of a panel."""

    entity: str
    values: Array  # (T, n), NaN for a gap
    names: tuple[str, ...]  # (n,)
    colours: tuple[str, ...]  # n or more are used in turn
    width: float = 1.5  # [px]


@dataclass(frozen=True)
class Panel:
    """A plot over time."""

    title: str
    entities: tuple[str, ...]
    range: tuple[float, float] | None = None  # by default that of the data
    height: float = 1.0  # relative to the other panels
    tab: str = "Slip and errors"  # the tab with the panel, if there are several


def send_series(stream: rr.RecordingStream, root: str, time: Array, series: Sequence[Series]) -> list[str]:
    """Send lines over time with their names and colours; returns their entities, below `root`."""
    for line in series:
        count, entity = len(line.names), f"{root}/{line.entity}"
        colours = [rgb(line.colours[k % len(line.colours)]) for k in range(count)]
        stream.log(entity, rr.SeriesLines(names=line.names, colors=colours, widths=[line.width] * count), static=True)
        columns = rr.Scalars.columns(scalars=line.values.ravel())
        send(stream, entity, time, columns.partition(np.full(len(time), count)))
    return [f"{root}/{line.entity}" for line in series]


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
    plan = rrb.Spatial3DView(
        origin="/",
        contents=["+ /**", f"- /{GROUND}/**", *(f"- /{root}/{ROBOT}/chassis/contact_forces/**" for root in roots)],
        name="Plan [grid: 1 m]",
        background=_BACKGROUND,
        line_grid=rrb.LineGrid3D(visible=True, spacing=1.0, color=(90, 90, 90, 120)),
        eye_controls=rrb.EyeControls3D(
            kind="Orbital",
            position=[*middle, max(wide / _ASPECT, high) + 1.0],
            look_target=[*middle, 0.0],
            eye_up=[0, 1, 0],
        ),
    )
    views: rrb.Container = rrb.Vertical(space, plan, row_shares=[1.2, 1])
    if tabs := _tabs(roots, panels, sent, duration):
        views = rrb.Horizontal(views, rrb.Tabs(*tabs) if len(tabs) > 1 else tabs[0], column_shares=[1, 1.1])
    loop = rrb.components.AbsoluteTimeRange(min=round(1e9 * begin), max=round(1e9 * (begin + _LOOP)))
    time = rrb.TimePanel(
        timeline=TIMELINE, state="collapsed", play_state="playing", loop_mode="selection", time_selection=loop
    )
    folded = rrb.BlueprintPanel(state="collapsed"), rrb.SelectionPanel(state="collapsed")
    return rrb.Blueprint(views, time, *folded, auto_views=False, auto_layout=False)


def _tabs(roots: Sequence[str], panels: Sequence[Panel], sent: Sequence[str], duration: float) -> list[rrb.Container]:
    """The panels that have any of the entities `sent`, in their tabs; one legend is enough for several runs."""
    tabs: dict[str, list[tuple[float, rrb.TimeSeriesView]]] = {}
    span = [rr.TimeRangeBoundary.absolute(seconds=seconds) for seconds in (0.0, duration * _LEGEND)]
    for panel in panels:
        entities = [f"{root}/{name}" for root in roots for name in panel.entities]
        if not set(entities) & set(sent):
            continue
        view = rrb.TimeSeriesView(
            origin="/",
            contents=[f"+ /{entity}" for entity in entities],
            name=panel.title,
            axis_x=rrb.TimeAxis(view_range=rr.TimeRange(*span)),
            axis_y=None if panel.range is None else rrb.ScalarAxis(range=panel.range, zoom_lock=False),
            plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.RightTop, visible=len(roots) == 1 or not tabs),
        )
        tabs.setdefault(panel.tab, []).append((panel.height, view))
    return [
        rrb.Vertical(*(view for _, view in inside), name=name, row_shares=[height for height, _ in inside])
        for name, inside in tabs.items()
    ]
