"""What a validation measured, and its summary."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Self

import numpy as np

from experiments.validation.convergence import Convergence, converge
from experiments.validation.energy import Energy, account
from experiments.validation.standing import (
    ANGLES,
    REFERENCE_ANGLE,
    Creep,
    Loads,
    Slide,
    creep,
    loads,
    slide,
    straight_drift,
)
from experiments.validation.turning import Turns, turn
from sim.ground.ground import Ground
from sim.robot.parameters import RobotParameters
from sim.seeds import generator
from sim.stopwatch import Stopwatch
from trackslip.kinematics import Array

Showing = Callable[[str, float, str], AbstractContextManager[Callable[[float], None]]]
"""Shows the progress of a stage of some total and unit, for a block."""


@dataclass(frozen=True)
class Validation:
    """All measurements."""

    parameters: RobotParameters
    ground: Ground
    turns: Turns
    naive_turns: Turns
    """The same with MuJoCo's default contact."""
    loads: Loads
    naive_loads: Loads
    creep: Creep
    slide: Slide
    drift: float
    """Sideways after 10 m straight on [m]."""
    convergence: Convergence
    energy: Energy


@dataclass(frozen=True)
class Extent:
    """Absolute errors [unit of the quantity]."""

    worst: float
    median: float

    @classmethod
    def of(cls, error: Array) -> Self:
        """Of errors of any shape."""
        size = np.abs(error)
        return cls(float(size.max()), float(np.median(size)))


@dataclass(frozen=True)
class StepError:
    """Error of a physics step after the random commands."""

    dt: float
    """[s]"""
    position_error_mm: float
    """Largest distance from where the reference step leads [mm]."""


@dataclass(frozen=True)
class ValidationSummary:
    """The numbers of a validation; "naive" is MuJoCo's default contact."""

    icr_error: Extent
    """Of half the distance between the ICRs, relative [-]."""
    naive_icr_error: Extent
    slip_error: Extent
    """Of both tracks [-]."""
    naive_slip_error: Extent
    lateral_speed_error_mm_per_s: float
    """Largest [mm/s]."""
    turns: int
    """Number of steady turns."""
    pad_load_spread: float
    """Largest deviation of a contact point's load from theory, relative to the mean load [-]."""
    naive_pad_load_spread: float
    """Largest deviation from the mean load, relative [-]."""
    sink_mm: float
    """Mean sink on level ground [mm]."""
    roll_deg: float
    """Largest in turns [deg]."""
    pitch_deg: float
    """Largest in turns [deg]."""
    creep_angle_deg: float
    """Slope on which creep is reported [deg]."""
    creep_mm_per_s: float
    """Largest on that slope [mm/s]."""
    sliding_acceleration_error: float
    """Largest, relative to Coulomb's law [-]."""
    straight_drift_mm: float
    """Sideways after 10 m straight on [mm]."""
    solver_difference_mm: float
    """Distance between the solvers CG and Newton after the random commands [mm]."""
    timestep: tuple[StepError, ...]
    energy_residual: float
    """Energy not accounted for, relative to the largest energy stored [-]."""
    friction_loss_error: float
    """Relative difference of the friction loss from Coulomb's law [-]."""

    @classmethod
    def of(cls, found: Validation) -> Self:
        """The numbers of everything that was measured."""
        at_reference = int(np.argmin(np.abs(ANGLES - REFERENCE_ANGLE)))
        turns = found.turns
        return cls(
            icr_error=Extent.of(turns.icr_error),
            naive_icr_error=Extent.of(found.naive_turns.icr_error),
            slip_error=Extent.of(turns.slip_error),
            naive_slip_error=Extent.of(found.naive_turns.slip_error),
            lateral_speed_error_mm_per_s=1e3 * Extent.of(turns.lateral - turns.expected_lateral).worst,
            turns=len(turns.radius),
            pad_load_spread=Extent.of(found.loads.load - found.loads.expected).worst,
            naive_pad_load_spread=Extent.of(found.naive_loads.load - 1).worst,
            sink_mm=1e3 * float(found.loads.sink.mean()),
            roll_deg=float(np.degrees(np.abs(found.loads.roll).max())),
            pitch_deg=float(np.degrees(np.abs(found.loads.pitch).max())),
            creep_angle_deg=float(np.degrees(found.creep.angle[:, at_reference].min())),
            creep_mm_per_s=1e3 * float(found.creep.speed[:, at_reference].max()),
            sliding_acceleration_error=Extent.of(found.slide.acceleration / found.slide.expected - 1).worst,
            straight_drift_mm=1e3 * found.drift,
            solver_difference_mm=1e3 * found.convergence.solver_difference,
            timestep=tuple(StepError(dt, 1e3 * error) for dt, error in found.convergence.step_error.items()),
            energy_residual=found.energy.residual,
            friction_loss_error=found.energy.coulomb_error,
        )


def measure(
    parameters: RobotParameters, ground: Ground, seed: int, threads: int, watch: Stopwatch, progress: Showing
) -> Validation:
    """Make all measurements; `watch` takes the time of each stage, and `progress` shows it."""

    @contextmanager
    def stage(name: str) -> Iterator[Callable[[float], None]]:
        with watch.stage(name), progress(name, 1.0, "of the stage") as report:
            yield report

    world = parameters, ground
    with stage("turning") as report:
        turns = turn(*world, threads, False, report)
    with stage("turning, default contact") as report:
        naive_turns = turn(*world, threads, True, report)
    with stage("standing"):
        weights, naive_weights = (loads(*world, threads, default) for default in (False, True))
        creeping, sliding = creep(*world, threads), slide(*world, threads)
        drift = straight_drift(*world, threads)
    with stage("convergence") as report:
        convergence = converge(*world, generator(seed, "convergence"), threads, report)
    with stage("energy"):
        energy = account(*world, generator(seed, "energy"), threads)
    return Validation(*world, turns, naive_turns, weights, naive_weights, creeping, sliding, drift, convergence, energy)
