"""What is known about each run of a sweep. The metadata of the fields hold units and meanings, for the table."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Self

from trackslip.logs.schema import NO_UNIT, PURE, Column


def _column(unit: str, meaning: str) -> Any:
    return field(default=None, metadata={"unit": unit, "meaning": meaning})


@dataclass(frozen=True)
class RunRow:
    """A run: what it is and what was measured of it, in left turns; None for what it doesn't have."""

    run: str = field(metadata={"unit": NO_UNIT, "meaning": "name of the run: its log in runs.parquet"})
    id: str = field(metadata={"unit": NO_UNIT, "meaning": "hash of all that the run is: options, robot, ground, seed"})
    axes: Mapping[str, Any]
    """What varies in the sweep, by name: the run's values."""
    error: str | None = _column(NO_UNIT, "why there is no run; null where there is one")
    omega_l: float | None = _column("rad/s", "measured speed of the left sprocket")
    omega_r: float | None = _column("rad/s", "measured speed of the right sprocket")
    v: float | None = _column("m/s", "measured forward speed")
    w: float | None = _column("rad/s", "measured yaw rate")
    observed_radius: float | None = _column("m", "measured radius, positive to the left")
    slip_l: float | None = _column(PURE, "measured slip of the left track")
    slip_r: float | None = _column(PURE, "measured slip of the right track")
    true_slip_l: float | None = _column(PURE, "true slip of the left track")
    true_slip_r: float | None = _column(PURE, "true slip of the right track")
    note: str | None = _column(NO_UNIT, "what of the run could not be used, and why; null where all could")
    rmse_x: float | None = _column("m", "root mean square error of the poses along x")
    rmse_y: float | None = _column("m", "root mean square error of the poses along y")
    rmse_heading: float | None = _column("rad", "root mean square error of the headings")
    valid_fraction: float | None = _column(PURE, "share of the scans that gave a pose")
    saturated: float | None = _column(PURE, "share of the time with a motor at its limit, the worse track")
    made_by: str | None = _column(
        NO_UNIT, "digest of the code, models and libraries that drove it, listed in summary.json"
    )

    def to_json(self) -> dict[str, Any]:
        """As summary.json has it: the axes among the fields; of a run that failed, only what it is and why."""
        row = {name: getattr(self, name) for name in COLUMNS if self.error is None or name in _OF_FAILED}
        return {"run": row.pop("run"), "id": row.pop("id"), **self.axes, **row}

    @classmethod
    def from_json(cls, row: Mapping[str, Any]) -> Self:
        """A row as it was stored."""
        axes = {name: value for name, value in row.items() if name not in COLUMNS}
        return cls(**{name: row.get(name) for name in COLUMNS}, axes=axes)  # type: ignore[arg-type]


COLUMNS = {
    f.name: Column(f.name, f.metadata["unit"], f.metadata["meaning"]) for f in dataclasses.fields(RunRow) if f.metadata
}
"""Besides the axes of the sweep, which come after `id`."""
_OF_FAILED = ("run", "id", "error", "made_by")


def is_row(row: Mapping[str, Any]) -> bool:
    """Whether a stored row has numbers where numbers belong, and texts where texts do."""
    kinds = {name: (str,) if column.unit == NO_UNIT else (int, float) for name, column in COLUMNS.items()}
    return all(row.get(name) is None or type(row[name]) in kind for name, kind in kinds.items())
