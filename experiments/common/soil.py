"""What theory says about a robot on soft soil, as tables and as entries of summaries."""

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from experiments.common.table import MISSING, Table, number
from sim.robot.parameters import RobotParameters
from trackslip.errors import require
from trackslip.kinematics import Array
from trackslip.skid_theory import (
    Contact,
    DrawbarCurve,
    Load,
    Soil,
    Tracks,
    Wheels,
    drawbar_curve,
    most_slope,
    roll,
    slip_for,
)
from trackslip.skid_theory.soil import Rolling

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
    """A robot on soft soil, with its load."""

    robot: RobotParameters
    soil: Soil
    load: Load

    def __post_init__(self) -> None:
        axles = self.robot.axles
        allowed = "two on soft soil; theory doesn't know how more of them share the weight"
        require(len(axles) in (0, 2), "axles", list(axles), allowed)
        require(self.load.uphill == 0, "uphill", self.load.uphill, "0 on soft soil: straight up")

    @property
    def weight(self) -> float:
        """Weight of the robot [N]."""
        return self.robot.mass * _GRAVITY

    @property
    def gear(self) -> Tracks | Wheels:
        """The tracks or wheels, for the theory."""
        return self.wheels if self.robot.axles else self.tracks

    @property
    def tracks(self) -> Tracks:
        """The tracks, for the theory."""
        robot = self.robot
        return Tracks(
            length=robot.contact_length,
            width=robot.track_width,
            weight=self.weight,
            com_x=robot.com_x,
            com_height=robot.com_height,
        )

    @property
    def wheels(self) -> Wheels:
        """The wheels, for the theory."""
        robot = self.robot
        rear, front = robot.axles
        return Wheels(
            length=front - rear,
            radius=robot.sprocket_radius,
            width=robot.track_width,
            weight=self.weight,
            com_x=robot.com_x,
            com_height=robot.com_height,
        )

    @property
    def rolling(self) -> tuple[Rolling, Rolling]:
        """How a front wheel, and a rear wheel in its rut, roll under a quarter of the weight each,
        without slip.
        """
        wheels = self.wheels
        front = roll(self.soil, wheels, self.weight / 4)
        return front, roll(self.soil, wheels, self.weight / 4, front.rut)

    @property
    def sinkage(self) -> float:
        """Sinkage under an even pressure, or of the rear wheels under even loads, without slip
        [m].
        """
        if self.robot.axles:
            return float(self.rolling[1].rut[0])
        return float(self.soil.sinkage(self.tracks.pressure, self.robot.track_width))

    @property
    def pressure(self) -> float:
        """Mean pressure under the tracks, or under the front wheels [Pa]."""
        if self.robot.axles:
            return float(self.rolling[0].pressure.mean())
        return self.tracks.pressure

    @property
    def resistance(self) -> float:
        """Resistance of compaction under an even pressure or even loads, without slip [N]."""
        if self.robot.axles:
            return 2 * sum(float(rolling.resistance[0]) for rolling in self.rolling)
        width = self.robot.track_width
        return float(2 * width * self.soil.work(self.sinkage, width))

    def curve(self) -> DrawbarCurve:
        """The drawbar-slip curve on the level, with the pull at the load's hitch."""
        return drawbar_curve(self.soil, self.gear, hitch_height=self.load.hitch_height)

    def turning(self) -> tuple[Contact, float, Load]:
        """Contact, shear modulus [m] and load that make `steady_turns` a theory of turning in soil.

        Cohesion and bulldozing under the mean pressure are friction, the resistance is a pull.
        """
        load = self.load
        shear = self.soil.shear
        pull = load.pull + self.resistance / self.weight
        if not self.robot.axles:
            width = self.robot.track_width
            friction = self.soil.friction(self.pressure, self.sinkage, width).tolist()
            contact = self.robot.contact_theory(*friction)
            return contact, shear, Load(load.slope, load.uphill, pull, load.hitch_height)

        # means over the wheels, sheared on their patches as under their arcs
        wheels = self.wheels
        area = 0.0
        pushed = 0.0
        distance = 0.0
        for rolling in self.rolling:
            area += 2 * wheels.width * float(rolling.entry[0])
            pushed += 2 * float(wheels.bulldozing(self.soil, rolling.rut)[0])
            distance += float(np.average(rolling.behind[0], weights=rolling.pressure[0])) / 2
        along = math.tan(self.soil.friction_angle) + self.soil.cohesion * area / self.weight
        contact = self.robot.contact_theory(along, along + pushed / self.weight)
        shear *= self.robot.patch_length / (2 * distance)
        moment = load.pull * load.hitch_height + (pull - load.pull) * wheels.radius
        return contact, shear, Load(load.slope, load.uphill, pull, moment / pull)

    def slip(self) -> float:
        """Slip straight ahead under the load, NaN for a robot that is immobilised [-]."""
        pull = self.load.pull * self.weight
        return slip_for(self.soil, self.gear, pull, self.load.slope, self.load.hitch_height)

    def summary(self, curve: DrawbarCurve) -> dict[str, Any]:
        """Entries of a command's summary."""
        return {
            "soil": self.soil,
            "track_width": self.robot.track_width,
            "pressure": self.pressure,
            "sinkage": self.sinkage,
            "resistance": self.resistance,
            "drawbar": {name: getattr(curve, name) for name in curve.__dataclass_fields__},
            "most_pull": {"pull": curve.pull[curve.most], "slip": curve.slip[curve.most]},
            "most_efficiency": {
                "efficiency": curve.efficiency[curve.best],
                "slip": curve.slip[curve.best],
            },
            "most_slope": most_slope(self.soil, self.gear),
            "slip_under_load": self.slip(),
        }

    def print(self, curve: DrawbarCurve) -> None:
        """Print what the robot does on this soil, and its drawbar-slip curve."""
        weight = self.weight
        most = curve.most
        best = curve.best
        most_pull = float(curve.pull[most])
        rows = [
            ("soil", self.soil.source or "as given"),
            *assumptions(self.soil),
            *self._sinkage_rows(),
            ("resistance", of_weight(self.resistance, weight)),
            ("largest pull", f"{of_weight(most_pull, weight)}, at slip {curve.slip[most]:.2f}"),
            (
                "largest tractive efficiency",
                f"{number(float(curve.efficiency[best]), 2)}, at slip {curve.slip[best]:.3f}, "
                f"pull {of_weight(float(curve.pull[best]), weight)}",
            ),
            ("steepest slope", number(math.degrees(most_slope(self.soil, self.gear)), 1, "°")),
        ]
        title = f"Soft soil: theory of rigid {self.robot.contact}"
        Table(title, ("quantity", "value"), rows).print()
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

    def _sinkage_rows(self) -> list[tuple[str, str]]:
        """Rows on the size, pressure and sinkage of the tracks or wheels."""
        width = number(1e3 * self.robot.track_width, 0, "mm")
        pressure = number(1e-3 * self.pressure, 2, "kPa")
        rut = number(1e3 * self.sinkage, 2, "mm")
        if not self.robot.axles:
            return [
                ("track", f"{width} wide"),
                ("pressure", pressure),
                ("sinkage, level and without slip", rut),
            ]
        radius = number(1e3 * self.robot.sprocket_radius, 0, "mm")
        front = number(1e3 * float(self.rolling[0].rut[0]), 2, "mm")
        return [
            ("wheel", f"{width} wide, radius {radius}"),
            ("mean pressure, front wheels", pressure),
            ("sinkage of front and rear wheels, level and without slip", f"{front}, {rut}"),
        ]

    def cautions(self, curve: DrawbarCurve) -> list[str]:
        """What limits the results, in words."""
        lines = []
        steep = np.flatnonzero(curve.pitch > STEEP_TRIM)
        if steep.size and not self.robot.axles:
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
        cell(curve.efficiency, 2) if curve.pull[k] > 0 else MISSING,
        cell(curve.sinkage, 1, 1e3),
        f"{cell(curve.pitch, 1, math.degrees(1.0))}°",
    )
