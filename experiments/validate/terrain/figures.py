"""Figures of a validation of tracks on terrain: simulated against theory, and penetration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.common.colours import BLUE, GREEN, ORANGE, RED
from experiments.common.style import THEORY, Panels, make_room, panel, styled
from experiments.validate.terrain.turning import TrackTurns, Turning
from trackslip.kinematics import Array

if TYPE_CHECKING:
    from experiments.validate.terrain.suite import ByDefault, TerrainMeasurements

Bounds = Mapping[str, tuple[float, float]]
"""Of both presets, by quantity."""

_COLOURS = {"accurate": BLUE, "fast": ORANGE}
_ROBOT_COLOURS = (BLUE, ORANGE, GREEN, "#CC79A7")
_MARKERS = "os^D"
_DEFAULT: dict[str, Any] = {"color": RED, "mfc": "none", "mew": 1.2, "ls": "none"}
_CASES = ("slow", "pivot at 0.5 m/s", "centre of mass off")
_SMALLEST = 0.01  # error that is drawn [%]


@styled
def turns(found: Sequence[TerrainMeasurements], naive: Sequence[ByDefault], bounds: Bounds) -> Figure:
    """Errors of the ICRs' half width in every turn, with MuJoCo's default contact for comparison, and their bounds."""
    figure, axes = panel("Half width of the ICRs", "", "size of the error [%]")
    shift = np.linspace(-0.3, 0.3, len(found) + len(naive))
    for offset, one, marker in zip(shift, found, _markers(found), strict=False):
        style: dict[str, Any] = {"color": _COLOURS[one.preset], "marker": marker, "ls": "none", "ms": 4.5}
        _errors(axes, offset, (one.on_plane, one.on_box), f"{one.robot}, {one.preset}", style)
    for offset, default, marker in zip(shift[len(found) :], naive, _MARKERS, strict=False):
        _errors(
            axes,
            offset,
            (default.turning,),
            f"{default.robot}, default contact",
            _DEFAULT | {"marker": marker, "ms": 5},
        )
    for k, case in enumerate(_CASES):
        for colour, bound in zip(_COLOURS.values(), bounds[case], strict=True):
            if np.isfinite(bound):
                axes.hlines(100 * bound, k - 0.4, k + 0.4, color=colour, lw=1.0, ls="--")
    axes.set_xticks(range(len(_CASES)), _CASES)
    axes.grid(visible=False, axis="x")
    axes.set(yscale="log")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.set_ylim(bottom=_SMALLEST, top=3e3)
    axes.legend(loc="upper center", ncols=2)
    return figure


def _errors(axes: Axes, offset: float, grounds: Sequence[Turning], name: str, style: dict[str, Any]) -> None:
    for k in range(len(_CASES)):
        several: list[TrackTurns] = [(one.slow, one.pivot, one.offset)[k] for one in grounds]
        error = 100 * np.abs(np.concatenate([one.error for one in several]))
        label = name if k == 0 else None
        axes.plot(np.full(len(error), k + offset), np.maximum(error, _SMALLEST), **style, label=label)


@styled
def slopes(found: Sequence[TerrainMeasurements]) -> Figure:
    """The steepest slopes that robots climb, and those on which they tip over, against theory."""
    figure, axes = panel("Steepest slope", "by theory [°]", "simulated [°]")
    for one, marker in zip(found, _markers(found), strict=True):
        climbed = [*one.climb_on_plane, *one.climb_on_box]
        tipped = [one.tips_sideways, one.tips_backwards]
        style: dict[str, Any] = {"color": _COLOURS[one.preset], "marker": marker, "ls": "none", "ms": 5}
        for angles, face, name in ((climbed, style["color"], "climbed"), (tipped, "none", "tips over")):
            expected, simulated = np.degrees([(angle.expected, angle.found) for angle in angles]).T
            axes.plot(expected, simulated, mfc=face, label=f"{one.robot}, {one.preset}: {name}", **style)
    _one_to_one(axes)
    return figure


@styled
def steps(found: Sequence[TerrainMeasurements]) -> Figure:
    """The highest steps that robots climb, against statics; open symbols by tipping over alone."""
    figure, axes = panel("Highest step", "by statics [mm]", "simulated [mm]")
    for one, marker in zip(found, _markers(found), strict=True):
        expected, simulated = 1e3 * np.array([(step.expected, step.found) for step in one.steps]).T
        style: dict[str, Any] = {"color": _COLOURS[one.preset], "marker": marker, "ls": "none", "ms": 5}
        axes.plot(expected, simulated, label=f"{one.robot}, {one.preset}", **style)
    limited = [step for one in found for step in one.steps if step.tips_over > 1.01 * step.expected]
    if limited:
        over = 1e3 * np.array([(step.tips_over, step.found) for step in limited]).T
        axes.plot(*over, "x", color=GREEN, label="by tipping over alone")
    _one_to_one(axes)
    return figure


@styled
def depths(found: Sequence[TerrainMeasurements], naive: Sequence[ByDefault], bounds: Bounds) -> Panels:
    """Share of the time with a deeper penetration, per preset, on stairs and rough ground."""
    return tuple(_depths(found, naive, bounds, preset) for preset in dict.fromkeys(one.preset for one in found))


def _depths(found: Sequence[TerrainMeasurements], naive: Sequence[ByDefault], bounds: Bounds, preset: str) -> Figure:
    figure, axes = panel(f"Penetration, {preset}", "depth [mm]", "tracks that are deeper [%]")
    for one, colour in zip([one for one in found if one.preset == preset], _ROBOT_COLOURS, strict=False):
        for name, sinking, dash in (
            ("stairs", one.stairs, "-"),
            ("stairs down", one.descent, ":"),
            ("rough ground", one.rough, "--"),
        ):
            axes.plot(*_deeper(sinking.depth), color=colour, ls=dash, lw=1.3, label=f"{one.robot}, {name}")
    for by_default, dash in zip(naive, ("-", ":", "-.", "--"), strict=False):
        label = f"{by_default.robot}, stairs, default"
        axes.plot(*_deeper(by_default.stairs.depth), color=RED, ls=dash, lw=1.0, label=label)
    typical, largest = (1e3 * bounds[name][[*_COLOURS].index(preset)] for name in ("99th percentile", "largest"))
    axes.plot(typical, 1.0, "k_", ms=12)
    axes.axvline(largest, color="#555555", ls=":", lw=1.0)
    axes.plot(typical, 1.0, "kv", ms=6, label="bounds: p99, largest")
    axes.set(yscale="log", xlim=(0, 12), ylim=(1e-3, 150))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.legend(loc="upper right")
    return figure


def _deeper(depth: Array) -> tuple[Array, Array]:
    """Depths [mm] and the shares that are deeper [%]."""
    ordered = np.quantile(depth, shares := 1 - np.geomspace(1.0, 1e-5, 300))
    return 1e3 * ordered, 100 * (1 - shares)


def _one_to_one(axes: Axes) -> None:
    ends = [0.95 * min(axes.get_xlim()[0], axes.get_ylim()[0]), 1.05 * max(axes.get_xlim()[1], axes.get_ylim()[1])]
    axes.plot(ends, ends, **THEORY, zorder=1, label="theory")
    axes.set(xlim=ends, ylim=ends)
    make_room(axes, 0.3)
    axes.legend(loc="upper left", ncols=2, fontsize=6.5)


def _markers(found: Sequence[TerrainMeasurements]) -> list[str]:
    """A marker per robot."""
    robots = list(dict.fromkeys(one.robot for one in found))
    return [_MARKERS[robots.index(one.robot) % len(_MARKERS)] for one in found]
