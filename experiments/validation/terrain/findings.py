"""Everything that is measured of one robot with one preset."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from experiments.validation.terrain.engine import Speed, belt_error, differing_numbers, speed
from experiments.validation.terrain.obstacles import RISE, Sinking, rough, stairs
from experiments.validation.terrain.slopes import Angle, climbing_limits, creep, tipping
from experiments.validation.terrain.steps import BOXES, Step, step
from experiments.validation.terrain.subjects import Box, Subject
from experiments.validation.terrain.turning import Turning, turning
from sim.seeds import generator
from trackslip.kinematics import Array

STAGES = 6
"""Stages of the measurements of one robot with one preset."""


@dataclass(frozen=True)
class Findings:
    """What was measured of one robot with one preset."""

    robot: str
    preset: str
    on_plane: Turning
    on_box: Turning
    climb_on_plane: tuple[Angle, ...]
    climb_on_box: tuple[Angle, ...]
    creep: Array  # (H,) of parked robots in several directions [m/s]
    steps: tuple[Step, ...]
    tips_sideways: Angle
    tips_backwards: Angle
    stairs: Sinking
    descent: Sinking
    """Down the same stairs."""
    rough: Sinking
    speed: Speed
    differing: int
    """Numbers of the states of a batch's rows that differ from those of robots alone."""
    belt_error: float
    """Of the sliding velocity of belts on moving bodies [m/s]."""


@dataclass(frozen=True)
class ByDefault:
    """The same robot with MuJoCo's default contact, for comparison."""

    robot: str
    turning: Turning
    stairs: Sinking
    descent: Sinking


@dataclass(frozen=True)
class TerrainValidation:
    """Everything that was measured."""

    findings: tuple[Findings, ...]
    by_default: tuple[ByDefault, ...]

    @property
    def presets(self) -> list[str]:
        """The presets, each once."""
        return list(dict.fromkeys(one.preset for one in self.findings))

    def of_preset(self, preset: str) -> list[Findings]:
        """One per robot."""
        return [one for one in self.findings if one.preset == preset]


def measure(subject: Subject, preset: str, seed: int, threads: int, done: Callable[[float], None]) -> Findings:
    """Make all measurements; `done` is called after each of STAGES with 1."""
    rng = generator(seed, f"{subject.name} {preset}")
    on_plane, on_box = (turning(subject, preset, boxed, threads) for boxed in (False, True))
    done(1.0)
    climb_on_plane, climb_on_box = (climbing_limits(subject, preset, boxed, threads) for boxed in (False, True))
    creeping = creep(subject, preset, True, threads)
    tips_sideways, tips_backwards = (tipping(subject, preset, sideways, threads) for sideways in (True, False))
    done(1.0)
    steps = tuple(step(robot, preset, friction, threads) for robot, friction in _step_cases(subject))
    done(1.0)
    on_stairs, descent = (stairs(subject, preset, threads, rise=rise) for rise in (RISE, -RISE))
    done(1.0)
    on_rough = rough(subject, preset, rng, threads)
    done(1.0)
    found = Findings(
        robot=subject.name,
        preset=preset,
        on_plane=on_plane,
        on_box=on_box,
        climb_on_plane=climb_on_plane,
        climb_on_box=climb_on_box,
        creep=creeping,
        steps=steps,
        tips_sideways=tips_sideways,
        tips_backwards=tips_backwards,
        stairs=on_stairs,
        descent=descent,
        rough=on_rough,
        speed=speed(subject, preset),
        differing=differing_numbers(subject, preset, rng),
        belt_error=belt_error(subject, preset, rng),
    )
    done(1.0)
    return found


def _step_cases(subject: Subject) -> Iterator[tuple[Subject, float]]:
    if isinstance(subject, Box):
        yield from BOXES
    else:
        yield subject, 0.8


def by_default(subject: Subject, threads: int) -> ByDefault:
    """The turns and the stairs with MuJoCo's default contact."""
    turns = turning(subject, "accurate", False, threads, by_default=True)
    up, down = (stairs(subject, "accurate", threads, by_default=True, rise=rise) for rise in (RISE, -RISE))
    return ByDefault(subject.name, turns, up, down)


def summary_of(found: TerrainValidation) -> dict[str, Any]:
    """What summary.json says beside the checks: everything measured but every single depth."""
    return {
        "robots": [_without_depths(one) for one in found.findings],
        "default_contact": [_without_depths(one) for one in found.by_default],
    }


def _without_depths(one: Findings | ByDefault) -> dict[str, Any]:
    depths = {"depth", "typical", "largest"}
    return {
        name: {"p99_m": value.typical, "largest_m": value.largest}
        | {key: number for key, number in vars(value).items() if key not in depths}
        if isinstance(value, Sinking)
        else value
        for name, value in vars(one).items()
    }
