"""Everything that a validation measured, and its numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.validation.convergence import Convergence
from experiments.validation.energy import Energy
from experiments.validation.standing import ANGLES, REFERENCE_ANGLE, Creep, Loads, Slide
from experiments.validation.turning import Turns
from sim.ground.ground import Ground
from sim.robot.parameters import RobotParameters
from trackslip.kinematics import Array


@dataclass(frozen=True)
class Validation:
    """Everything that was measured."""

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
    """To the side after 10 m straight on [m]."""
    convergence: Convergence
    energy: Energy


def summarise(found: Validation) -> dict[str, Any]:
    """The numbers of a validation."""
    at_reference = int(np.argmin(np.abs(ANGLES - REFERENCE_ANGLE)))
    sliding = found.slide.acceleration / found.slide.expected - 1
    return {
        "icr_error": _extent(found.turns.icr_error),
        "naive_icr_error": _extent(found.naive_turns.icr_error),
        "slip_error": _extent(found.turns.slip_error),
        "naive_slip_error": _extent(found.naive_turns.slip_error),
        "lateral_speed_error_mm_per_s": 1e3 * _extent(found.turns.lateral - found.turns.expected_lateral)["worst"],
        "turns": len(found.turns.radius),
        "pad_load_spread": np.abs(found.loads.load - found.loads.expected).max(),
        "naive_pad_load_spread": np.abs(found.naive_loads.load - 1).max(),
        "sink_mm": 1e3 * found.loads.sink.mean(),
        "roll_deg": np.degrees(np.abs(found.loads.roll).max()),
        "pitch_deg": np.degrees(np.abs(found.loads.pitch).max()),
        "creep_angle_deg": np.degrees(found.creep.angle[:, at_reference].min()),
        "creep_mm_per_s": 1e3 * found.creep.speed[:, at_reference].max(),
        "sliding_acceleration_error": np.abs(sliding).max(),
        "straight_drift_mm": 1e3 * found.drift,
        "solver_difference_mm": 1e3 * found.convergence.solver_difference,
        "timestep": [
            {"dt": step, "position_error_mm": 1e3 * error} for step, error in found.convergence.step_error.items()
        ],
        "energy_residual": found.energy.residual,
        "friction_loss_error": found.energy.coulomb_error,
    }


def _extent(error: Array) -> dict[str, float]:
    size = np.abs(error)
    return {"worst": float(size.max()), "median": float(np.median(size))}
