"""The page on a training: its learning curve, and how many courses the policy crosses."""

import shlex
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure

from experiments.common import style
from experiments.common.chart import WIDE, Chart, Curve
from experiments.common.colours import BLUE, GREY
from experiments.common.manifest import command_line
from experiments.common.page import Answer, Block, Page, Plot, Section
from experiments.common.table import number
from experiments.train.config import TRAVERSE, Config
from experiments.train.crossing import crossing_table
from trackslip.errors import counted

_SMOOTH: Final = 7  # number of points in a running mean of the curve
_ENOUGH: Final = 10  # the usual number of steps over the least for which a policy can be judged
_CURVE: Final = (
    "Mean reward per control period of all robots, in each update, and its running mean over "
    f"{_SMOOTH} updates."
)
_RATES: Final = (
    "Share of unseen courses that are crossed, with its 95 % interval, by the scripted controller "
    "alone and corrected by the policy."
)


def page(
    config: Config,
    steps: int,
    curve: Sequence[Mapping[str, float]],
    rates: Sequence[Mapping[str, Any]],
    notes: Sequence[str],
    manifest: Mapping[str, Any],
) -> Page:
    """The page on a training of `steps` control periods, with its learning `curve`, the `rates`
    from `crossing_rates`, and `notes` on the robot and the training.
    """
    learned = Plot("learning_curve", learning_chart(curve), "Learning curve", _CURVE)
    success: list[Block] = []
    if rates:
        crossed = Plot("success_per_course", success_figure(rates), "Success per course", _RATES)
        title = f"Unseen courses, {config.trials} in each row"
        success = [crossed, crossing_table(title, rates)]
    sections = [Section("Training", [learned]), Section("Success per course", success)]
    title = "A policy for following paths"
    if config.env == TRAVERSE:
        title = "A policy for crossing courses"
    answer = _answer(config, steps, curve, rates, notes)
    return Page(title, command_line("train"), manifest, sections, answer=answer)


def _answer(
    config: Config,
    steps: int,
    curve: Sequence[Mapping[str, float]],
    rates: Sequence[Mapping[str, Any]],
    notes: Sequence[str],
) -> Answer:
    """The answer: the reward before and after training, and whether the training was long
    enough to judge.
    """
    first = number(curve[0]["reward"], 3)
    last = number(curve[-1]["reward"], 3)
    heading = f"Reward per step {first} → {last} in {steps:,} steps"
    alarms = [line] if (line := smoke_test(steps)) else []
    facts = [("reward per step", f"{first} → {last}")] if alarms else []
    facts += [("robots", str(config.robots)), ("updates", str(len(curve)))]
    if rates:
        for controller in ("scripted", "policy"):
            mine = [row for row in rates if row["controller"] == controller]
            crossed = sum(row["crossed"] for row in mine)
            courses = sum(row["courses"] for row in mine)
            facts.append((f"courses crossed, {controller}", f"{crossed} of {courses}"))
    lines = [f"{note[0].upper()}{note[1:]}." for note in notes]
    out = shlex.quote(str(config.out))
    following = f"trackslip benchmark --controllers linear ppo:{out}"
    if config.env == TRAVERSE:
        following = f"trackslip drive --policy {out}"
    return Answer(heading, facts, lines, (), alarms, [following])


def smoke_test(steps: int) -> str:
    """A line on a training that is too short for its policy to be judged; empty if it isn't."""
    usual = Config.steps
    if steps * _ENOUGH >= usual:
        return ""
    return (
        f"{steps:,} steps are a smoke test: they show that training works, not what it learns; the "
        f"documented results take {usual:,}"
    )


def learning_chart(curve: Sequence[Mapping[str, float]]) -> Chart:
    """The reward over training steps, with a running mean if there are enough updates."""
    steps, reward = np.array([(point["steps"] / 1000, point["reward"]) for point in curve]).T
    curves = [Curve(steps, reward, "update", GREY, 0.6, marker="o", size=3.0)]
    if len(curve) >= _SMOOTH:
        window = np.ones(_SMOOTH) / _SMOOTH
        smooth_steps = np.convolve(steps, window, "valid")
        smooth_reward = np.convolve(reward, window, "valid")
        curves.append(Curve(smooth_steps, smooth_reward, "running mean", BLUE))
    title = f"{counted(len(curve), 'update')} of the policy"
    label = "steps of all robots [thousand]"
    return Chart(title, label, "reward per step [–]", curves, 3.2, WIDE)


@style.styled
def success_figure(rates: Sequence[Mapping[str, Any]]) -> Figure:
    """The shares of courses crossed by the scripted controller and by the policy, with their
    intervals.
    """
    kinds = list(dict.fromkeys((row["course"], row["difficulty"]) for row in rates))
    height = 1.1 + 0.45 * len(kinds)
    figure, axes = style.panel("", "courses crossed [%]", "", height)
    looks = {"scripted": (GREY, "s", -0.12), "policy": (BLUE, "o", 0.12)}
    for row in rates:
        colour, marker, aside = looks[row["controller"]]
        place = kinds.index((row["course"], row["difficulty"])) + aside
        ends = 100 * np.array([row["low"], row["high"]])
        axes.plot(ends, [place, place], color=colour, lw=1.2)
        axes.plot(100 * row["rate"], place, marker, color=colour, ms=6)
    names = [f"{course}, difficulty {difficulty:.3g}" for course, difficulty in kinds]
    axes.set_yticks(range(len(kinds)), names)
    axes.set_ylim(len(kinds) - 0.5, -0.5)
    axes.set_xlim(-3, 103)
    keys = [
        style.key(name, color=colour, marker=marker, ls="none")
        for name, (colour, marker, _) in looks.items()
    ]
    style.legend_below(figure, keys)
    return figure
