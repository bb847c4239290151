"""Tests of the policy and the scripted controller on unseen courses."""

from collections.abc import Sequence
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
                    task.step(
                        policy.action(task.observation())
                        if controller == "policy"
                        else no_correction
                    )
                row = {
                    "course": course if isinstance(course, str) else "own",
                    "controller": controller,
                }
                rows.append(row | {"difficulty": middle, "courses": trials} | _rate(task))
    return rows


def _rate(task: Crossing) -> dict[str, Any]:
    """Counts of outcomes, the share of courses crossed with its 95 % interval (Wilson), and the
    mean crossing time.
    """
    crossed, tipped, stuck = (
        task.outcome == end for end in (Outcome.REACHED, Outcome.TIPPED, Outcome.STUCK)
    )
    row: dict[str, Any] = {
        "crossed": int(crossed.sum()),
        "tipped": int(tipped.sum()),
        "stuck": int(stuck.sum()),
    }
    low, high = binomtest(row["crossed"], len(crossed)).proportion_ci(0.95, "wilson")
    row |= {"rate": float(crossed.mean()), "low": float(low), "high": float(high)}
    return row | {"time": float(task.world.time[crossed].mean()) if crossed.any() else None}


def crossing_table(title: str, rows: Sequence[dict[str, Any]]) -> Table:
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
    cells = [
        (
            *(
                row["course"],
                row["controller"],
                f"{row['difficulty']:.3g}",
                f"{100 * row['rate']:.1f}",
            ),
            f"{100 * row['low']:.1f} to {100 * row['high']:.1f}",
            *(str(row["tipped"]), str(row["stuck"]), number(row["time"], 1)),
        )
        for row in rows
    ]
    return Table(title, header, cells)
