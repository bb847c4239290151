"""Figure of a training: reward over its steps, and the share of courses that policy and scripted controller cross."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.learning.crossing import POLICY, SCRIPTED, CrossingRate
from experiments.report.colours import BLUE, GREY, ORANGE
from experiments.report.figures.style import styled, subplots
from trackslip.kinematics import Array

_SMOOTH = 7  # points of the curve in a running mean
_LOOKS = {SCRIPTED: (ORANGE, "s", -0.004), POLICY: (BLUE, "o", 0.004)}  # colour, marker, distance from its difficulty


@styled
def learning_curve(curve: Sequence[Mapping[str, float]], rates: Sequence[CrossingRate] = ()) -> Figure:
    """Reward over the training's steps; with `rates`, also the share of courses crossed, in training and afterwards."""
    figure, ((*panels,),) = subplots(2.9, 1, 3 if rates else 1, across=0.5, squeeze=False)
    steps = np.array([point["steps"] for point in curve]) / 1000
    _line(panels[0], "reward per step", steps, np.array([point["reward"] for point in curve]))
    if rates:
        known = [(k, 100 * point["crossed"]) for k, point in zip(steps, curve, strict=True) if "crossed" in point]
        _line(panels[1], "crossed in training [%]", *np.array(known).reshape(-1, 2).T)
        for name, (colour, marker, beside) in _LOOKS.items():
            own = [one for one in rates if one.controller == name]
            middle = 100 * np.array([one.rate for one in own])
            ends = np.abs(100 * np.array([(one.low, one.high) for one in own]).T - middle)
            place = np.array([one.difficulty for one in own]) + beside
            panels[2].errorbar(place, middle, ends, color=colour, marker=marker, ms=5, lw=1.2, capsize=2, label=name)
        panels[2].set(title="unseen courses crossed [%]", xlabel="difficulty [–]")
        panels[2].legend(loc="lower left")
    return figure


def _line(axes: Axes, title: str, steps: Array, values: Array) -> None:
    """Values and their running mean."""
    axes.plot(steps, values, ".", color=GREY, ms=3)
    axes.set(title=title, xlabel="steps of all robots [thousand]")
    width = min(_SMOOTH, len(values))
    if width:
        mean = np.convolve(values, np.ones(width) / width, "valid")
        at = np.interp((width - 1) / 2 + np.arange(len(mean)), np.arange(len(steps)), steps)
        axes.plot(at, mean, color=BLUE)
