"""Evaluation of a training: its curve, and unseen courses that the policy and the scripted controller cross."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import binomtest

from experiments.report.colours import BLUE, GREY, ORANGE
from experiments.report.figures.style import styled, subplots
from experiments.report.formats import number
from experiments.report.table import Table
from sim.seeds import generator
from sim.task import from_options
from sim.traverse.config import TraverseConfig
from sim.traverse.outcome import Outcome
from sim.traverse.policy import CrossingPolicy
from sim.traverse.task import Crossing
from trackslip.kinematics import Array

SCRIPTED, POLICY = "scripted", "policy"
_HEADER = ("controller", "difficulty", "crossed [%]", "95 % interval", "tipped", "stuck", "other", "time [s]")
_RESAMPLES = 10_000
_SMOOTH = 7  # points of the curve in a running mean
_LOOKS = {SCRIPTED: (ORANGE, "s", -0.004), POLICY: (BLUE, "o", 0.004)}  # colour, marker, distance from its difficulty


@dataclass(frozen=True)
class CrossingRate:
    """Courses of one difficulty crossed by one controller."""

    controller: str
    difficulty: float
    """Of the courses [-]."""
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
    """Difference between the rates of the policy and of the scripted controller, over all difficulties."""

    gain: float
    """Difference of the rates [-]."""
    low: float
    high: float
    """Ends of its 95 % interval, from resampling courses [-]."""
    only_policy: int
    only_scripted: int
    """Number of courses that one of the two alone crosses."""


def compare(
    policy: CrossingPolicy, difficulty: tuple[float, float], courses: int, seed: int, threads: int = 0
) -> tuple[list[CrossingRate], CrossingGain]:
    """Let both cross `courses` courses of the lowest, the middle and the highest difficulty.

    The courses have two obstacles of all kinds, and are drawn with seeds that no training with `seed` uses.
    """
    config = from_options(TraverseConfig, policy.options)
    task = Crossing(config, courses, threads)
    rates, crossed = [], []
    low, high = difficulty
    for level in dict.fromkeys((low, (low + high) / 2, high)):
        for controller in (SCRIPTED, POLICY):
            task.set_difficulty(level, level)
            everyone = range(courses)
            unseen = [generator(seed, f"unseen course {level:g} {k}") for k in everyone]
            task.begin(everyone, [task.draw(one, {}) for one in unseen])
            ended = _drive(task, policy if controller == POLICY else None)
            rates.append(crossing_rate(controller, level, ended, task.world.time))
            crossed.append(ended == Outcome.REACHED)
    scripted, learnt = np.concatenate(crossed[0::2]), np.concatenate(crossed[1::2])
    return rates, crossing_gain(scripted, learnt, generator(seed, "resampled courses"))


def crossing_gain(scripted: NDArray[np.bool_], policy: NDArray[np.bool_], rng: np.random.Generator) -> CrossingGain:
    """The difference between two controllers that crossed the same courses (C,) or not."""
    more = policy.astype(float) - scripted
    means = rng.choice(more, (_RESAMPLES, len(more))).mean(axis=1)
    low, high = np.quantile(means, [0.025, 0.975])
    return CrossingGain(float(more.mean()), float(low), float(high), int((more > 0).sum()), int((more < 0).sum()))


def crossing_table(title: str, rates: Sequence[CrossingRate]) -> Table:
    """A row per controller and difficulty."""
    rows = [
        (
            *(one.controller, f"{one.difficulty:.3g}", f"{100 * one.rate:.1f}"),
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
    return f"{POLICY} - {SCRIPTED}: {rate}; {alone}"


def _drive(task: Crossing, policy: CrossingPolicy | None) -> NDArray[np.int_]:
    """Outcomes (N,) of all episodes of `task`; without a policy, the scripted controller is not corrected."""
    while (task.outcome == Outcome.DRIVING).any():
        action = np.zeros((task.size, len(task.commanded))) if policy is None else policy.action(task.observation())
        task.step(action)
    return task.outcome.copy()


def crossing_rate(controller: str, difficulty: float, ended: NDArray[np.int_], time: Array) -> CrossingRate:
    """The rate of episodes that ended with these outcomes (N,) at these times (N,) [s]."""
    crossed, tipped, stuck = (int((ended == one).sum()) for one in (Outcome.REACHED, Outcome.TIPPED, Outcome.STUCK))
    total = len(ended)
    low, high = binomtest(crossed, total).proportion_ci(0.95, "wilson")
    mean = float(time[ended == Outcome.REACHED].mean()) if crossed else None
    counts = (tipped, stuck, total - crossed - tipped - stuck)
    return CrossingRate(
        controller, difficulty, total, crossed, crossed / total, float(low), float(high), *counts, time=mean
    )


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
