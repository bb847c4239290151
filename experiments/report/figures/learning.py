"""Figures of a training: what was learnt over time, and what the policy crosses beside the scripted controller."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.measuring.crossing import POLICY, SCRIPTED, CrossingRate
from experiments.report.colours import BLUE, GREY, ORANGE
from experiments.report.figures.style import styled, subplots
from trackslip.kinematics import Array

_SMOOTH = 7  # points of the curve in a running mean
_LOOKS = {SCRIPTED: (ORANGE, "s", -1.0), POLICY: (BLUE, "o", 1.0)}  # colour, marker, side of its difficulty
_APART = 0.004  # of two markers from their difficulty [-]


@styled
def learning_curve(curve: Sequence[Mapping[str, float]], rates: Sequence[CrossingRate] = ()) -> Figure:
    """Reward over the training's steps; with `rates`, also the share of courses crossed, in training and afterwards."""
    figure, ((*panels,),) = subplots(2.9, 1, 3 if rates else 1, across=0.5, squeeze=False)
    steps = np.array([point["steps"] for point in curve]) / 1000
    _line(panels[0], steps, np.array([point["reward"] for point in curve]))
    panels[0].set(title="reward per step", xlabel="steps of all robots [thousand]")
    if rates:
        known = [(k, 100 * point["crossed"]) for k, point in zip(steps, curve, strict=True) if "crossed" in point]
        _line(panels[1], *np.array(known).reshape(-1, 2).T)
        panels[1].set(title="crossed in training [%]", xlabel="steps of all robots [thousand]")
        for name, (colour, marker, side) in _LOOKS.items():
            own = [one for one in rates if one.controller == name]
            middle = 100 * np.array([one.rate for one in own])
            ends = np.abs(100 * np.array([(one.low, one.high) for one in own]).T - middle)
            place = np.array([one.difficulty for one in own]) + side * _APART
            panels[2].errorbar(place, middle, ends, color=colour, marker=marker, ms=5, lw=1.2, capsize=2, label=name)
        panels[2].set(title="unseen courses crossed [%]", xlabel="difficulty")
        panels[2].legend(loc="lower left")
    return figure


def _line(axis: Axes, steps: Array, values: Array) -> None:
    """Values and their running mean."""
    axis.plot(steps, values, ".", color=GREY, ms=3)
    width = min(_SMOOTH, len(values))
    if width:
        mean = np.convolve(values, np.ones(width) / width, "valid")
        first = (width - 1) / 2
        at = np.interp(first + np.arange(len(mean)), np.arange(len(steps)), steps)
        axis.plot(at, mean, color=BLUE)
