"""Laws identified from drives as content of a summary.json."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from trackslip.identification.drive.comparison import DriveComparison
from trackslip.identification.drive.estimate import DriveFit


def drive_to_json(found: DriveComparison) -> dict[str, Any]:
    """Everything known of the laws, in SI units, but for trajectories."""
    return {
        "best": found.best,
        "drives": [drive.name for drive in found.drives],
        "laws": {name: _law(law) | {"score": found.score[name]} for name, law in found.laws.items()},
        "clock_profile": None
        if found.clock is None
        else {"offset": found.clock.offset.tolist(), "rise": found.clock.rise.tolist()},
        "warnings": list(found.warnings),
    }


def prediction_to_json(found: DriveComparison) -> dict[str, dict[str, Any]]:
    """Errors of held-out prediction by law and horizon, "2" being 2 s."""
    return {
        name: {f"{horizon:g}": asdict(errors) for horizon, errors in by_horizon.items()}
        for name, by_horizon in found.errors.items()
    }


def _law(law: DriveFit) -> dict[str, Any]:
    return {
        "values": law.values,
        "extras": law.extras,
        "stderr": law.stderr,
        "interval95": law.interval95,
        "held": law.held,
        "correlation": law.correlation.tolist(),
        "noise": law.noise,
        "deviance": law.deviance,
        "poses": law.poses,
        "left_out": law.left_out,
        "breaks": law.breaks,
        "converged": law.converged,
    }
