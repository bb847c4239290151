"""A benchmark's names resolved to objects: robot, grounds, laws, references, controllers."""

import importlib.util
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from experiments.driving.closed_loop import ClosedLoopRun, drive_closed_loops
from experiments.driving.lookup import compensation, controller, reference
from experiments.driving.world import World
from experiments.options.benchmark import BenchmarkConfig, Case
from sim.ground.ground import Ground
from sim.ground.named import load_ground
from sim.seeds import generator
from trackslip.controllers.base import Controller
from trackslip.errors import InvalidValueError
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog
from trackslip.slip.compensation import Compensation
from trackslip.trajectory.base import Reference

_PAPER_OFFSET = (-0.2, -0.3, -np.pi / 6)  # forward, left, heading: Sec. IV-C, (0.3, -0.2, pi/3) from (0, 0, pi/2)
_MAX_OFFSET, _MAX_ROTATION = 0.15, np.radians(20)  # of a random start [m, rad]


@dataclass(frozen=True)
class Setup:
    """The world of a benchmark."""

    config: BenchmarkConfig
    world: World

    @classmethod
    def of(cls, config: BenchmarkConfig) -> Self:
        """The setup of a configuration; raises TrackslipError for a file or name that does not exist."""
        return cls(config, World.of(config.simulation()))

    def check(self, cases: Sequence[Case]) -> None:
        """Raise TrackslipError for an unknown name, before anything is driven."""
        look_ups: dict[str, Callable[[str], object]] = {
            "controller": self.controller, "compensation": self.compensation,
            "reference": reference, "ground": self.ground,
        }  # fmt: skip
        for field, look_up in look_ups.items():
            for name in dict.fromkeys(getattr(case, field) for case in cases):
                try:
                    look_up(name)
                except InvalidValueError as error:
                    if error.field == field:  # the options' names are plural
                        raise InvalidValueError(f"{field}s", error.value, error.allowed) from error
                    raise

    def ground(self, name: str) -> Ground:
        """A ground by name or from a file; `robot` is the ground in the robot's file."""
        return self.world.ground if name == "robot" else load_ground(name)

    def controller(self, name: str) -> Controller:
        """A new controller by name."""
        return controller(name, self.world.robot.geometry, self.config.drive.top_speed)

    def compensation(self, name: str) -> Compensation:
        """A new compensation by name."""
        return compensation(name, self.world.robot.geometry, self.config.laws)

    def drive(self, cases: Sequence[Case]) -> list[RunLog]:
        """Drive cases that share a reference, as one fleet."""
        path = reference(cases[0].reference)
        runs = [
            ClosedLoopRun(
                name=case.run,
                key=f"benchmark {_key(case.reference)}",
                seed=case.seed,
                controller=case.controller,
                compensation=case.compensation,
                start=start(case, path),
                ground=self.ground(case.ground),
                metadata={"reference": case.reference, "ground_name": case.ground, "start": case.start},
            )
            for case in cases
        ]
        config = self.config
        return drive_closed_loops(runs, self.world, path, config.localization, self.compensation, config.preview)


def _key(reference_name: str) -> str:
    """What a reference's random numbers depend on: its name, without the folder of its file."""
    return Path(reference_name).stem


def start(case: Case, path: Reference) -> Array:
    """Start pose (3,) of a case [m, m, rad]."""
    offset = np.zeros(3)
    if case.start == "paper":
        offset = np.array(_PAPER_OFFSET)
    elif case.start == "random":
        rng = generator(case.seed, f"start {_key(case.reference)}")
        away, bearing = _MAX_OFFSET * np.sqrt(rng.uniform()), rng.uniform(-np.pi, np.pi)
        offset = np.array([away * np.cos(bearing), away * np.sin(bearing), rng.uniform(-_MAX_ROTATION, _MAX_ROTATION)])
    pose = path.pose(0.0)
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return pose + np.array([cos * offset[0] - sin * offset[1], sin * offset[0] + cos * offset[1], offset[2]])


def without_missing(config: BenchmarkConfig) -> tuple[list[Case], list[str]]:
    """The cases of a configuration without a suite's controllers whose library is missing, and a note on each of these.

    A controller named explicitly is not left out; `Setup.check` refuses it.
    """
    cases = config.cases()
    rest = [case for case in cases if case.controller != "mpc"]
    if len(rest) == len(cases) or "mpc" in (config.controllers or ()) or importlib.util.find_spec("casadi") is not None:
        return cases, []
    return rest, ['mpc is left out: CasADi is not installed; pip install "trackslip[mpc]"']
