"""What theory says about a tracked robot on soft soil, as tables and as entries of summaries."""

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from experiments.common.table import MISSING, Table, number
from sim.robot.parameters import TRACKS, RobotParameters
from trackslip.errors import require
from trackslip.kinematics import Array
from trackslip.skid_theory import (
    Contact,
    DrawbarCurve,
    Load,
    Soil,
    drawbar_curve,
    most_slope,
    slip_for,
)
from trackslip.skid_theory import Tracks as TracksOnSoil

_GRAVITY: Final = 9.81  # [m/s^2]
STEEP_TRIM: Final = math.radians(3.0)
"""Pitch beyond which simulation and theory of rigid tracks were seen to differ [rad]."""
_SHOWN: Final = (0.01, 0.02, 0.03, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0)  # slips in the table
_LABELS: Final = {
    "k_c": "k_c",
    "k_phi": "k_phi",
    "n": "n",
    "n1": "growth n1 of the exponent with slip",
    "cohesion": "cohesion",
    "friction_angle": "friction angle",
    "shear": "shear modulus",
    "unit_weight": "unit weight",
}
_UNITS: Final = {
    "cohesion": (1e-3, "kPa"),
    "friction_angle": (math.degrees(1.0), "°"),
    "shear": (1e3, "mm"),
    "unit_weight": (1e-3, "kN/m³"),
}


@dataclass(frozen=True)
class OnSoil:
    """A tracked robot on soft soil, with its load."""

    robot: RobotParameters
    soil: Soil
    load: Load

    def __post_init__(self) -> None:
        allowed = f'"{TRACKS}": what soft soil does under wheels is not predicted'
        require(self.robot.contact == TRACKS, "robot.contact", self.robot.contact, allowed)
        require(self.load.uphill == 0, "uphill", self.load.uphill, "0 on soft soil: straight up")

    @property
    def tracks(self) -> TracksOnSoil:
        """The tracks, for the theory."""
        robot = self.robot
        return TracksOnSoil(
            length=robot.contact_length,
            width=robot.track_width,
            weight=robot.mass * _GRAVITY,
            com_x=robot.com_x,
            com_height=robot.com_height,
        )

    @property
    def sinkage(self) -> float:
        """Sinkage under an even pressure, without slip [m]."""
        return float(self.soil.sinkage(self.tracks.pressure, self.tracks.width))

    @property
    def resistance(self) -> float:
        """Resistance of compaction under an even pressure, without slip [N]."""
        tracks = self.tracks
        return float(2 * tracks.width * self.soil.work(self.sinkage, tracks.width))

    def curve(self) -> DrawbarCurve:
        """The drawbar-slip curve on the level, with the pull at the load's hitch."""
        return drawbar_curve(self.soil, self.tracks, hitch_height=self.load.hitch_height)

    def turning(self) -> tuple[Contact, Load]:
        """Contact and load that make `steady_turns` a theory of turning in soil.

        Cohesion and bulldozing under the mean pressure are friction, the resistance is a pull.
        """
        tracks = self.tracks
        along, across = self.soil.friction(tracks.pressure, self.sinkage, tracks.width).tolist()
        contact = self.robot.contact_theory(along, across)
        load = self.load
        pull = load.pull + self.resistance / tracks.weight
        return contact, Load(load.slope, load.uphill, pull, load.hitch_height)

    def slip(self) -> float:
        """Slip straight ahead under the load, NaN for a robot that is immobilised [-]."""
        pull = self.load.pull * self.tracks.weight
        return slip_for(self.soil, self.tracks, pull, self.load.slope, self.load.hitch_height)

    def summary(self, curve: DrawbarCurve) -> dict[str, Any]:
        """Entries of a command's summary."""
        return {
            "soil": self.soil,
            "track_width": self.tracks.width,
            "pressure": self.tracks.pressure,
            "sinkage": self.sinkage,
            "resistance": self.resistance,
            "drawbar": {name: getattr(curve, name) for name in curve.__dataclass_fields__},
            "most_pull": {"pull": curve.pull[curve.most], "slip": curve.slip[curve.most]},
            "most_efficiency": {
                "efficiency": curve.efficiency[curve.best],
                "slip": curve.slip[curve.best],
            },
            "most_slope": most_slope(self.soil, self.tracks),
            "slip_under_load": self.slip(),
        }

    def print(self, curve: DrawbarCurve) -> None:
        """Print what the robot does on this soil, and its drawbar-slip curve."""
        tracks = self.tracks
        weight = tracks.weight
        most = curve.most
        best = curve.best
        most_pull = float(curve.pull[most])
        rows = [
            ("soil", self.soil.source or "as given"),
            *assumptions(self.soil),
            ("track", f"{number(1e3 * tracks.width, 0, 'mm')} wide"),
            ("pressure", number(1e-3 * tracks.pressure, 2, "kPa")),
            ("sinkage, level and without slip", number(1e3 * self.sinkage, 2, "mm")),
            ("resistance", of_weight(self.resistance, weight)),
            ("largest pull", f"{of_weight(most_pull, weight)}, at slip {curve.slip[most]:.2f}"),
            (
                "largest tractive efficiency",
                f"{number(float(curve.efficiency[best]), 2)}, at slip {curve.slip[best]:.3f}, "
                f"pull {of_weight(float(curve.pull[best]), weight)}",
            ),
            ("steepest slope", number(math.degrees(most_slope(self.soil, tracks)), 1, "°")),
        ]
        Table("Soft soil: theory of rigid tracks", ("quantity", "value"), rows).print()
        header = (
            "slip",
            "thrust [N]",
            "resistance [N]",
            "pull [N]",
            "pull / weight",
            "efficiency",
            "sinkage [mm]",
            "pitch",
        )
        shown = [int(np.abs(curve.slip - slip).argmin()) for slip in _SHOWN]
        table = [_curve_row(curve, k, weight) for k in shown]
        Table("Drawbar pull and slip on the level", header, table).print()
        for line in self.cautions(curve):
            print(line)

    def cautions(self, curve: DrawbarCurve) -> list[str]:
        """What limits the results, in words."""
        lines = []
        steep = np.flatnonzero(curve.pitch > STEEP_TRIM)
        if steep.size:
            slip = curve.slip[steep[0]]
            angle = math.degrees(STEEP_TRIM)
            lines.append(
                f"Note: from slip {slip:.2f} on, the pull tilts the robot by more than "
                f"{angle:.0f}°; there, a rigid track is a rough model."
            )
        if self.load.slope or self.load.pull:
            slip = self.slip()
            if math.isnan(slip):
                lines.append("Immobilised: no slip suffices for this slope and pull.")
            else:
                lines.append(f"slip straight ahead under this load: {slip:.4f}")
        return lines


def assumptions(soil: Soil) -> list[tuple[str, str]]:
    """A row for each value of a soil that no source states."""
    rows = []
    for name in soil.assumed:
        factor, unit = _UNITS.get(name, (1.0, ""))
        rows.append(
            (f"assumed: {_LABELS[name]}", f"{factor * getattr(soil, name):.3g} {unit}".strip())
        )
    return rows


def of_weight(force: float, weight: float) -> str:
    """A force [N], also in per cent of the weight [N]."""
    return f"{number(force, 1, 'N')} ({number(100 * force / weight, 1, '% of the weight')})"


def _curve_row(curve: DrawbarCurve, k: int, weight: float) -> tuple[str, ...]:
    """The row of the state k."""

    def cell(values: Array, digits: int, factor: float = 1.0) -> str:
        value = factor * float(values[k])
        return number(value, digits) if math.isfinite(value) else MISSING

    return (
        f"{curve.slip[k]:.2f}",
        cell(curve.thrust, 1),
        cell(curve.resistance, 1),
        cell(curve.pull, 1),
        cell(curve.pull, 3, 1 / weight),
        cell(curve.efficiency, 2),
        cell(curve.sinkage, 1, 1e3),
        f"{cell(curve.pitch, 1, math.degrees(1.0))}°",
    )
