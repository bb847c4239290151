"""Unseen courses that the policy and the scripted controller cross."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

from experiments.common.table import Table, number
from sim.seeds import generator
from sim.task import from_options
from sim.traverse.config import TraverseConfig
from sim.traverse.outcome import Outcome
from sim.traverse.policy import CrossingPolicy
from sim.traverse.task import Crossing
from trackslip.kinematics import Array


def crossing_rates(
    policy: CrossingPolicy, difficulty: tuple[float, float], trials: int, seed: int, threads: int = 0
) -> list[dict[str, Any]]:
    """Let the scripted controller and the policy cross `trials` courses of each kind; a row for each.

    Courses of a single kind are of the lowest, the middle and the highest difficulty, those of several of any. They
    are drawn with seeds that no training with `seed` uses; random ones have two obstacles of all kinds.
    """
    config = from_options(TraverseConfig, policy.options)
    task, everyone = Crossing(config, trials, threads), range(trials)
    low, high = difficulty
    levels = [(low, high)]
    if len(config.courses) == 1:
        levels = [(level, level) for level in dict.fromkeys((low, (low + high) / 2, high))]
    rows = []
    for course in config.courses:
        for level in levels:
            middle = sum(level) / 2
            for controller in ("scripted", "policy"):
                task.set_difficulty(*level)
                unseen = [generator(seed, f"unseen course {middle:g} {k}") for k in everyone]
                task.begin(everyone, [task.draw(rng, {"course": course}) for rng in unseen])
                while (task.outcome == Outcome.DRIVING).any():
                    no_correction = np.zeros((trials, len(task.commanded)))
                    task.step(policy.action(task.observation()) if controller == "policy" else no_correction)
                about = {"course": course if isinstance(course, str) else "own", "controller": controller}
                rows.append(about | {"difficulty": middle} | crossing_rate(task.outcome, task.world.time))
    return rows


def crossing_rate(ended: NDArray[np.int_], time: Array) -> dict[str, Any]:
    """Counts of episodes that ended with these outcomes (N,) at these times (N,) [s].

    `rate` is the share of courses crossed, `low` and `high` the ends of its 95 % interval (Wilson), `time` the mean
    time of the crossings [s].
    """
    crossed, tipped, stuck = (int((ended == end).sum()) for end in (Outcome.REACHED, Outcome.TIPPED, Outcome.STUCK))
    low, high = binomtest(crossed, len(ended)).proportion_ci(0.95, "wilson")
    counts = {"courses": len(ended), "crossed": crossed, "tipped": tipped, "stuck": stuck}
    rate = {"rate": crossed / len(ended), "low": float(low), "high": float(high)}
    other = len(ended) - crossed - tipped - stuck
    return counts | rate | {"other": other, "time": float(time[ended == Outcome.REACHED].mean()) if crossed else None}


def crossing_table(title: str, rows: Sequence[dict[str, Any]]) -> Table:
    """A row per course, difficulty and controller."""
    header = ("course", "controller", "difficulty", "crossed [%]", "95 % interval", "tipped", "stuck", "other")
    cells = [
        (
            *(row["course"], row["controller"], f"{row['difficulty']:.3g}", f"{100 * row['rate']:.1f}"),
            f"{100 * row['low']:.1f} to {100 * row['high']:.1f}",
            *(str(row[name]) for name in ("tipped", "stuck", "other")),
            number(row["time"], 1),
        )
        for row in rows
    ]
    return Table(title, (*header, "time [s]"), cells)
