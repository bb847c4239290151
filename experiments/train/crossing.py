"""Tests of the policy and the scripted controller on unseen courses."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.stats import binomtest

from experiments.common.table import Table, number
from sim.common.seeds import generator
from sim.common.settings import from_options
from sim.policy import Policy
from sim.traverse.config import TraverseConfig
from sim.traverse.outcome import Outcome
from sim.traverse.task import Crossing


def crossing_rates(
    policy: Policy, difficulty: tuple[float, float], trials: int, seed: int, threads: int = 0
) -> list[dict[str, Any]]:
    """Let the scripted controller and the policy cross `trials` unseen courses of each kind;
    returns rows of results.

    A single kind is tested at the lowest, middle and highest difficulty; several kinds at any
    difficulty in the range.
    """
    config = from_options(TraverseConfig, policy.options)
    task = Crossing(config, trials, threads)
    everyone = range(trials)
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
                # both controllers cross the same courses
                unseen = [generator(seed, f"unseen course {middle:g} {k}") for k in everyone]
                draws = [task.draw(rng, {"course": course}) for rng in unseen]
                task.begin(everyone, draws)
                _cross(task, policy if controller == "policy" else None)
                row = {
                    "course": course if isinstance(course, str) else "own",
                    "controller": controller,
                    "difficulty": middle,
                    "courses": trials,
                }
                rows.append(row | _rate(task))
    return rows


def _cross(task: Crossing, policy: Policy | None) -> None:
    """Drive until every robot has an outcome, corrected by the policy, if there is one."""
    none = np.zeros((len(task.outcome), len(task.commanded)))
    while (task.outcome == Outcome.DRIVING).any():
        task.step(none if policy is None else policy.action(task.observation()))


def _rate(task: Crossing) -> dict[str, Any]:
    """Counts of outcomes, the share of courses crossed with its 95 % interval (Wilson), and the
    mean crossing time.
    """
    crossed = task.outcome == Outcome.REACHED
    count = int(crossed.sum())
    interval = binomtest(count, len(crossed)).proportion_ci(0.95, "wilson")
    times = task.world.time[crossed]
    return {
        "crossed": count,
        "tipped": int((task.outcome == Outcome.TIPPED).sum()),
        "stuck": int((task.outcome == Outcome.STUCK).sum()),
        "rate": float(crossed.mean()),
        "low": float(interval.low),
        "high": float(interval.high),
        "time": float(times.mean()) if len(times) else None,
    }


def crossing_table(title: str, rows: Sequence[Mapping[str, Any]]) -> Table:
    """A table with a row per course, difficulty and controller."""
    header = (
        "course",
        "controller",
        "difficulty",
        "crossed [%]",
        "95 % interval",
        "tipped",
        "stuck",
        "time [s]",
    )
    return Table(title, header, [_cells(row) for row in rows])


def _cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    low = 100 * row["low"]
    high = 100 * row["high"]
    return (
        row["course"],
        row["controller"],
        f"{row['difficulty']:.3g}",
        f"{100 * row['rate']:.1f}",
        f"{low:.1f} to {high:.1f}",
        str(row["tipped"]),
        str(row["stuck"]),
        number(row["time"], 1),
    )
