"""What a benchmark's names stand for: robots, grounds, laws, references, controllers."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.driving.grid_runs import make_locator
from experiments.driving.lookup import compensation, controller, reference
from experiments.driving.world import World
from experiments.options.benchmark import BenchmarkConfig, Case
from experiments.storage.plain_json import plain
from sim.fleet import Fleet
from sim.ground.file import load_ground
from sim.ground.ground import Ground
from sim.run_recorder import Description
from sim.runs import Pilot, closed_loop
from sim.seeds import generator
from trackslip.controllers.base import Controller
from trackslip.errors import InvalidValueError
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog
from trackslip.slip.compensation import Compensation
from trackslip.trajectory.base import Reference

_PAPER_OFFSET = (-0.2, -0.3, -np.pi / 6)  # ahead, to the left, turned: Sec. IV-C, (0.3, -0.2, pi/3) from (0, 0, pi/2)
_MAX_OFFSET, _MAX_TURNED = 0.15, np.radians(20)  # of a random start [m, rad]


@dataclass(frozen=True)
class Setup:
    """A benchmark's world."""

    config: BenchmarkConfig
    world: World

    @classmethod
    def of(cls, config: BenchmarkConfig) -> Setup:
        """The world of a configuration; raises TrackslipError for files and names that aren't there."""
        return cls(config, World.of(config.simulation()))

    def check(self, cases: Sequence[Case]) -> None:
        """Raise TrackslipError for a name that stands for nothing, before anything is driven."""
        try:
            self._look_up(cases)
        except InvalidValueError as error:
            if error.field in ("controller", "compensation", "reference", "ground"):  # the options are plural
                raise InvalidValueError(f"{error.field}s", error.value, error.allowed) from error
            raise

    def _look_up(self, cases: Sequence[Case]) -> None:
        for name in dict.fromkeys(case.controller for case in cases):
            self.controller(name)
        for name in dict.fromkeys(case.compensation for case in cases):
            self.compensation(name)
        for name in dict.fromkeys(case.reference for case in cases):
            reference(name)
        for name in dict.fromkeys(case.ground for case in cases):
            self.ground(name)

    def ground(self, name: str) -> Ground:
        """A ground by name or from a file; `robot` is that of the robot's own file."""
        return self.world.ground if name == "robot" else load_ground(name)

    def controller(self, name: str) -> Controller:
        """A new controller of that name."""
        return controller(name, self.world.robot.geometry, self.config.drive.top_speed)

    def compensation(self, name: str) -> Compensation:
        """A new compensation of that name."""
        return compensation(name, self.world.robot.geometry, self.config.laws)

    def drive(self, cases: Sequence[Case]) -> list[RunLog]:
        """Cases that share a reference, driven as one fleet."""
        path = reference(cases[0].reference)
        grounds = [self.ground(case.ground) for case in cases]
        world = self.world
        fleet = Fleet(
            world.robot,
            np.array([start(case, path) for case in cases]),
            grounds,
            world.radius_error,
            self.config.drive,
            threads=1,
        )
        feed = world.feed(fleet, [generator(case.seed, f"benchmark {_key(case.reference)}") for case in cases])
        steered: dict[tuple[str, str], list[int]] = {}
        for k, case in enumerate(cases):
            steered.setdefault((case.controller, case.compensation), []).append(k)
        pilots = [
            Pilot(self.controller(pilot), robots, self.compensation(law), self.config.preview)
            for (pilot, law), robots in steered.items()
        ]
        locator = None if self.config.localization == "truth" else make_locator(self.config.localization, world.robot)
        common = world.metadata(self.config.localization)
        descriptions = [
            Description(case.run, common | vars(case) | {"ground": plain(on), "ground_name": case.ground})
            for case, on in zip(cases, grounds, strict=True)
        ]
        return closed_loop(fleet, pilots, path, feed, locator, descriptions)


def _key(reference_name: str) -> str:
    """What a reference's random numbers depend on: its name, however the path to its file is written."""
    return Path(reference_name).stem


def start(case: Case, path: Reference) -> Array:
    """Where the robot of a case is set down (3,)."""
    offset = np.zeros(3)
    if case.start == "paper":
        offset = np.array(_PAPER_OFFSET)
    elif case.start == "random":
        rng = generator(case.seed, f"start {_key(case.reference)}")
        away, bearing = _MAX_OFFSET * np.sqrt(rng.uniform()), rng.uniform(-np.pi, np.pi)
        offset = np.array([away * np.cos(bearing), away * np.sin(bearing), rng.uniform(-_MAX_TURNED, _MAX_TURNED)])
    pose = path.pose(0.0)
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return pose + np.array([cos * offset[0] - sin * offset[1], sin * offset[0] + cos * offset[1], offset[2]])


def without_missing(config: BenchmarkConfig) -> tuple[list[Case], list[str]]:
    """A configuration's cases but for a suite's controllers whose library isn't installed, and a line on each of those.

    A controller that is asked for by name isn't left out: it is refused.
    """
    cases, notes = config.cases(), []
    if "mpc" not in (config.controllers or ()) and importlib.util.find_spec("casadi") is None:
        rest = [case for case in cases if case.controller != "mpc"]
        if len(rest) < len(cases):
            notes.append('mpc is left out: CasADi is not installed; pip install "trackslip[mpc]"')
        cases = rest
    return cases, notes
