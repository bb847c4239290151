"""Evaluation of a training: its curve, and unseen courses that the policy and the scripted controller cross."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import binomtest

from experiments.common.colours import BLUE, GREY, ORANGE
from experiments.common.formats import number
from experiments.common.style import legend_below, margin_for, styled, subplots
from experiments.common.table import Table
from sim.seeds import generator
from sim.task import from_options
from sim.traverse.config import TraverseConfig
from sim.traverse.outcome import Outcome
from sim.traverse.policy import CrossingPolicy
from sim.traverse.task import Crossing
from sim.traverse.world import Command
from trackslip.kinematics import Array

SCRIPTED, POLICY = "scripted", "policy"
STRAIGHT = {"straight, flat": 0.0, "straight, raised": 1.2}
"""Flipper angles of robots that drive straight on, tips up [rad]."""
_HEADER = ("course", "controller", "difficulty", "crossed [%]", "95 % interval", "tipped", "stuck", "other", "time [s]")
_SMOOTH = 7  # points of the curve in a running mean
_LOOKS = {  # colour, marker, place beside the others in a group
    SCRIPTED: (ORANGE, "s", -0.5),
    POLICY: (BLUE, "o", 0.5),
    **{name: (GREY, marker, place) for name, marker, place in zip(STRAIGHT, "D^", (-1.5, 1.5), strict=True)},
}


@dataclass(frozen=True)
class CrossingRate:
    """Courses of one kind and difficulty crossed by one controller."""

    course: str
    """Its name."""
    controller: str
    difficulty: float
    """Of the courses, the middle of the range from which it is drawn [-]."""
    courses: int
    crossed: int
    """Number of courses that it crossed."""
    rate: float
    """Share of those [-]."""
    low: float
    high: float
    """Ends of the rate's 95 % interval (Wilson) [-]."""
    tipped: int
    stuck: int
    """Number of runs that ended tipped over, or stuck."""
    other: int
    """Number of those that ended otherwise: fallen, exploded, out of time."""
    time: float | None
    """Mean time of the crossings [s]; None without any."""


@dataclass(frozen=True)
class CrossingGain:
    """Difference between the rates of the policy and of the scripted controller on a kind of course."""

    course: str
    """Its name."""
    gain: float
    """Difference of the rates [-]."""
    low: float
    high: float
    """Ends of its 95 % interval (Agresti and Min, for pairs) [-]."""
    only_policy: int
    only_scripted: int
    """Number of courses that one of the two alone crosses."""


def compare(
    policy: CrossingPolicy, difficulty: tuple[float, float], trials: int, seed: int, threads: int = 0
) -> tuple[list[CrossingRate], list[CrossingGain]]:
    """Let the policy, the scripted controller and robots that drive straight on cross `trials` courses of each kind.

    Courses of a single kind are of the lowest, the middle and the highest difficulty, those of several of any. They
    are drawn with seeds that no training with `seed` uses; random ones have two obstacles of all kinds.
    """
    config = from_options(TraverseConfig, policy.options)
    task, everyone = Crossing(config, trials, threads), range(trials)
    low, high = difficulty
    levels = [(low, high)]
    if len(config.courses) == 1:
        levels = [(level, level) for level in dict.fromkeys((low, (low + high) / 2, high))]
    rates, gains = [], []
    for course in config.courses:
        name, crossed = course if isinstance(course, str) else "own", defaultdict(list)
        for level in levels:
            middle = sum(level) / 2
            for controller in _LOOKS:
                task.set_difficulty(*level)
                unseen = [generator(seed, f"unseen course {middle:g} {k}") for k in everyone]
                task.begin(everyone, [task.draw(one, {"course": course}) for one in unseen])
                ended = _drive(task, controller, policy)
                rates.append(crossing_rate(name, controller, middle, ended, task.world.time))
                crossed[controller].append(ended == Outcome.REACHED)
        scripted, learnt = (np.concatenate(crossed[controller]) for controller in (SCRIPTED, POLICY))
        gains.append(crossing_gain(name, scripted, learnt))
    return rates, gains


def crossing_gain(course: str, scripted: NDArray[np.bool_], policy: NDArray[np.bool_]) -> CrossingGain:
    """The difference between two controllers that crossed the same courses (C,) or not.

    Its interval is Wald's with half a course more in each cell of the 2 x 2 table (Agresti and Min, Statistics in
    Medicine 24, 2005), which has a width even where the two cross the same courses.
    """
    more, fewer = int((policy & ~scripted).sum()), int((scripted & ~policy).sum())
    total = len(policy) + 2
    middle = (more - fewer) / total
    half = 1.96 * math.sqrt(((more + fewer + 1) / total - middle**2) / total)
    return CrossingGain(
        course, (more - fewer) / len(policy), max(middle - half, -1.0), min(middle + half, 1.0), more, fewer
    )


def crossing_table(title: str, rates: Sequence[CrossingRate]) -> Table:
    """A row per course, difficulty and controller."""
    rows = [
        (
            *(one.course, one.controller, f"{one.difficulty:.3g}", f"{100 * one.rate:.1f}"),
            f"{100 * one.low:.1f} to {100 * one.high:.1f}",
            *(str(count) for count in (one.tipped, one.stuck, one.other)),
            number(one.time, 1),
        )
        for one in rates
    ]
    return Table(title, _HEADER, rows)


def gain_text(gain: CrossingGain) -> str:
    """A sentence on the difference between two controllers."""
    rate = f"{100 * gain.gain:+.1f} points, 95 % interval {100 * gain.low:+.1f} to {100 * gain.high:+.1f}"
    alone = f"{gain.only_policy} courses are crossed by the {POLICY} alone, {gain.only_scripted} by the {SCRIPTED} one"
    return f"{gain.course}, {POLICY} - {SCRIPTED}: {rate}; {alone}"


def _drive(task: Crossing, controller: str, policy: CrossingPolicy) -> NDArray[np.int_]:
    """Outcomes (N,) of all episodes of `task`; the scripted controller is one that is not corrected."""
    still = np.zeros((task.size, len(task.commanded)))
    while (task.outcome == Outcome.DRIVING).any():
        if controller in STRAIGHT:
            angle = np.full(task.world.servo.angle.shape, STRAIGHT[controller])
            task.world.step(Command(np.full((task.size, 2), task.config.scripted.speed), angle))
        else:
            task.step(policy.action(task.observation()) if controller == POLICY else still)
    return task.outcome.copy()


def crossing_rate(
    course: str, controller: str, difficulty: float, ended: NDArray[np.int_], time: Array
) -> CrossingRate:
    """The rate of episodes that ended with these outcomes (N,) at these times (N,) [s]."""
    crossed, tipped, stuck = (int((ended == one).sum()) for one in (Outcome.REACHED, Outcome.TIPPED, Outcome.STUCK))
    total = len(ended)
    low, high = binomtest(crossed, total).proportion_ci(0.95, "wilson")
    mean = float(time[ended == Outcome.REACHED].mean()) if crossed else None
    counts = (tipped, stuck, total - crossed - tipped - stuck)
    return CrossingRate(
        course, controller, difficulty, total, crossed, crossed / total, float(low), float(high), *counts, time=mean
    )


@styled
def learning_curve(curve: Sequence[Mapping[str, float]], rates: Sequence[CrossingRate] = ()) -> Figure:
    """Reward over the training's steps; with `rates`, also the share of courses crossed, in training and afterwards."""
    several = len({one.course for one in rates}) > 1
    labels = [one.course if several else f"difficulty {one.difficulty:g}" for one in rates if one.controller == POLICY]
    figure, ((*panels,),) = subplots(2.9, 1, 3 if rates else 1, across=margin_for(labels), squeeze=False)
    steps = np.array([point["steps"] for point in curve]) / 1000
    _line(panels[0], "reward per step", steps, np.array([point["reward"] for point in curve]))
    if rates:
        known = [(k, 100 * point["crossed"]) for k, point in zip(steps, curve, strict=True) if "crossed" in point]
        _line(panels[1], "crossed in training [%]", *np.array(known).reshape(-1, 2).T)
        for name, (colour, marker, beside) in _LOOKS.items():
            own = [one for one in rates if one.controller == name]
            middle = 100 * np.array([one.rate for one in own])
            ends = np.abs(100 * np.array([(one.low, one.high) for one in own]).T - middle)
            place, look = np.arange(len(own)) + 0.18 * beside, {"color": colour, "marker": marker, "ms": 4.5}
            panels[2].errorbar(middle, place, xerr=ends, ls="none", elinewidth=1.2, label=name, **look)
        panels[2].set_yticks(range(len(labels)), labels)
        panels[2].invert_yaxis()
        panels[2].set(title="crossed afterwards [%]", xlim=(-3, 103))
        legend_below(figure, panels[2].get_legend_handles_labels()[0], ncols=4)
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
