"""Drawbar tests in a grid on soft soil: pull, sinkage, resistance and efficiency over slip, as
measured and by theory.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any, Final

import numpy as np

from experiments.common.chart import Chart, Curve
from experiments.common.colours import BLACK, BLUE, GREEN, GREY, ORANGE, RED, VERMILLION
from experiments.common.soil import OnSoil
from experiments.common.sweep import Row
from experiments.common.table import MISSING, Table, number
from experiments.grid.plan import PlannedRun
from experiments.simulate.grid_summary import sinking_of
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog
from trackslip.skid_theory import DrawbarCurve, Load

MEASURED: Final = 1 / 3
"""Share of a run, at its end, over which drawbar tests are measured [-]."""
_SETTLED: Final = 0.01  # change of slip between halves of this part, from which it still grows [-]
_LEAST_BELT_SPEED: Final = 1e-3  # below which a slip has no meaning [m/s]
_PULL: Final = "pull.force"  # axis of a sweep
_STRAIGHT: Final = 100.0  # least commanded radius that counts as straight ahead [m]
_COLOURS: Final = (BLUE, ORANGE, GREEN, VERMILLION)
_HEADER: Final = (
    "pull [N]",
    "pull / weight",
    "slip",
    "theory",
    "sinkage [mm]",
    "theory",
    "resistance [N]",
    "theory",
    "efficiency",
    "theory",
    "",
)


def soil_columns(log: RunLog) -> Row:
    """The columns of the run table on a run on soft soil, means over its last third; none on firm
    ground.
    """
    truth = log.truth
    sinking = sinking_of(log)
    if sinking is None or truth is None or truth.sinkage is None or truth.resistance is None:
        return {}
    assert truth.traction is not None
    late = log.time >= log.time[-1] - MEASURED * (log.time[-1] - log.time[0])
    radius = log.metadata["geometry"]["sprocket_radius"] * (1 + log.metadata["radius_error"])
    belts = radius * log.omega[late]
    speed = truth.twist[late, 0]
    row: Row = {
        "sinkage": float(truth.sinkage[late].mean()),
        "resistance": None,
        "drawbar_slip": None,
        "efficiency": None,
        "slip_grows": False,
        "immobilised": sinking.is_immobilised,
    }
    if belts.mean() < _LEAST_BELT_SPEED:
        return row
    row["drawbar_slip"] = float(1 - speed.mean() / belts.mean())
    if sinking.is_immobilised:  # a robot that stands still does no work on the soil ahead of it
        return row

    half = len(belts) // 2
    first = 1 - speed[:half].mean() / belts[:half].mean()
    second = 1 - speed[half:].mean() / belts[half:].mean()
    row["slip_grows"] = bool(abs(second - first) > _SETTLED)
    row["resistance"] = -float(truth.resistance[late].sum(axis=1).mean())
    pull = log.metadata.get("pull", {}).get("force", 0.0)
    power = float((truth.traction[late] * belts).sum(axis=1).mean())
    row["efficiency"] = float(pull * speed.mean() / power)
    return row


@dataclass(frozen=True)
class DrawbarTest:
    """Runs of one robot straight ahead on one soil, with different pulls, and their theory."""

    label: str
    """The values on other axes than the pull; empty if there are none."""
    on_soil: OnSoil
    curve: DrawbarCurve
    pull: Array  # (n,) [N]
    rows: Sequence[Row]  # (n,) of the run table, in the order of the pulls

    @property
    def weight(self) -> float:
        """Weight of the robot [N]."""
        return self.on_soil.weight

    def column(self, name: str) -> Array:
        """A column (n,) of the rows, NaN where it is empty."""
        return np.array([row[name] for row in self.rows], float)

    @property
    def answer(self) -> tuple[str, str]:
        """The largest pull with which the robot still drove, and that of theory."""
        drove = [not row["immobilised"] for row in self.rows]
        name = "largest pull / weight"
        if self.label:
            name += f", {self.label}"
        theory = f"{self.curve.pull[self.curve.most] / self.weight:.3f} by theory"
        if not any(drove):
            return name, f"immobilised by all pulls; {theory}"
        return name, f"{self.pull[drove].max() / self.weight:.3f} driven; {theory}"

    def table(self) -> Table:
        """Measured values beside those of theory under the same pull."""
        rows = []
        for pull, row in zip(self.pull.tolist(), self.rows, strict=True):
            theory = self._theory(pull)
            pairs = (
                ("drawbar_slip", "slip", 1.0, 3),
                ("sinkage", "sinkage", 1e3, 1),
                ("resistance", "resistance", 1.0, 1),
                ("efficiency", "efficiency", 1.0, 2),
            )
            cells = []
            for measured, predicted, factor, digits in pairs:
                cells.append(_cell(row[measured], factor, digits))
                cells.append(_cell(theory.get(predicted), factor, digits))
            pulls = (number(pull, 1), number(pull / self.weight, 3))
            rows.append((*pulls, *cells, _remark(row)))
        title = "Drawbar tests: last third of each run, and theory at the same pull"
        if self.label:
            title += f"; {self.label}"
        return Table(title, _HEADER, rows, "r")

    def _theory(self, pull: float) -> dict[str, float]:
        """What theory says at a pull [N]; nothing for a robot that is immobilised."""
        curve = self.curve
        if pull > curve.pull[curve.most]:
            return {}
        upto = slice(curve.most + 1)

        def from_rest(name: str, at_rest: float) -> Array:
            """Values of the curve up to the largest pull, after that without slip."""
            return np.append(at_rest, getattr(curve, name)[upto])

        # without slip, there is no thrust, and the resistance would have to be pulled
        on_soil = self.on_soil
        slips = from_rest("slip", 0.0)
        slip = float(np.interp(pull, from_rest("pull", -on_soil.resistance), slips))
        sinkage = float(np.interp(slip, slips, from_rest("sinkage", on_soil.sinkage)))
        resistance = float(np.interp(slip, slips, from_rest("resistance", on_soil.resistance)))
        pitch = float(np.interp(slip, slips, from_rest("pitch", 0.0)))
        power = (pull + resistance) * math.cos(pitch)  # of the belts, over their speed
        return {
            "slip": slip,
            "sinkage": sinkage,
            "resistance": resistance,
            "efficiency": pull * (1 - slip) / power,
        }

    def summary(self) -> dict[str, Any]:
        """Entries in summary.json."""
        columns = ("drawbar_slip", "sinkage", "resistance", "efficiency")
        return {
            "label": self.label,
            "weight": self.weight,
            "pull": self.pull,
            "run": [row["run"] for row in self.rows],
            **{name: self.column(name) for name in columns},
            "theory": {name: getattr(self.curve, name) for name in self.curve.__dataclass_fields__},
        }


def _cell(value: float | None, factor: float, digits: int) -> str:
    return MISSING if value is None else number(factor * value, digits)


def _remark(row: Row) -> str:
    """What is wrong with a run, in a word or two."""
    if row["immobilised"]:
        return "immobilised"
    return "slip still grows" if row["slip_grows"] else ""


def drawbar_tests(runs: Sequence[PlannedRun], rows: Sequence[Row]) -> list[DrawbarTest]:
    """The drawbar tests among the runs of a sweep, which have these rows: those straight ahead on
    level soft soil that succeeded, grouped by their values on the other axes than the pull.
    """
    chosen = []
    for run, row in zip(runs, rows, strict=True):
        setting = run.setting.specification
        has_theory = len(setting.parameters.axles) in (0, 2)
        is_soft = setting.ground.soil is not None and has_theory
        is_level = setting.ground.slope == 0
        is_straight = run.cell.radius >= _STRAIGHT
        if is_soft and is_level and is_straight and row.get("drawbar_slip") is not None:
            chosen.append((_label(run), run, row))
    chosen.sort(key=lambda each: each[0])
    tests = []
    for label, group in groupby(chosen, key=lambda each: each[0]):
        members = sorted(group, key=lambda each: each[1].setting.specification.pull.force)
        setting = members[0][1].setting.specification
        assert setting.ground.soil is not None
        load = Load(hitch_height=setting.pull.height)
        on_soil = OnSoil(setting.parameters, setting.ground.soil, load)
        pull = np.array([run.setting.specification.pull.force for _, run, _ in members])
        tests.append(
            DrawbarTest(label, on_soil, on_soil.curve(), pull, [row for _, _, row in members])
        )
    return tests


def _label(run: PlannedRun) -> str:
    """A run's values on the axes of a sweep that aren't those of a drawbar test."""
    others = {name: value for name, value in run.setting.axes.items() if name != _PULL}
    return " ".join(f"{name}={value}" for name, value in others.items())


def drawbar_charts(tests: Sequence[DrawbarTest]) -> list[Chart]:
    """Pull, efficiency, sinkage and resistance over slip, as measured and by theory."""
    quantities = (
        ("Drawbar pull", "pull / weight [–]", "pull", lambda test: 1 / test.weight),
        ("Tractive efficiency", "efficiency [–]", "efficiency", lambda test: 1.0),
        ("Sinkage", "sinkage [mm]", "sinkage", lambda test: 1e3),
        ("Resistance", "resistance / weight [–]", "resistance", lambda test: 1 / test.weight),
    )
    charts = []
    for title, label, name, factor_of in quantities:
        curves: list[Curve] = []
        for k, test in enumerate(tests[: len(_COLOURS)]):
            factor = factor_of(test)
            values = test.pull if name == "pull" else test.column(name)
            theory = np.maximum(factor * getattr(test.curve, name), 0.0)
            colour = _COLOURS[k] if len(tests) > 1 else BLACK
            curves += _curves(test, factor * values, theory, colour)
        charts.append(Chart(title, "slip [–]", label, curves, xlim=(0.0, 1.02), has_zero=True))
    return charts


def _curves(test: DrawbarTest, values: Array, theory: Array, colour: str) -> list[Curve]:
    """Theory as a line; the measured values (n,) as marks that tell immobilised runs, and runs
    whose slip still grows.
    """
    label = f"{test.label}, " if test.label else ""
    line_colour = GREY if colour == BLACK else colour
    curves = [Curve(test.curve.slip, theory, f"{label}theory", line_colour)]
    slip = np.minimum(test.column("drawbar_slip"), 1.0)
    is_stuck = np.array([bool(row["immobilised"]) for row in test.rows])
    grows = np.array([bool(row["slip_grows"]) for row in test.rows]) & ~is_stuck
    kinds = (
        (~is_stuck & ~grows, f"{label}measured", colour, "o"),
        (grows, "slip still grows", ORANGE if colour == BLACK else colour, "s"),
        (is_stuck, "immobilised", RED, "x"),
    )
    for which, name, mark_colour, marker in kinds:
        if which.any():
            curves.append(
                Curve(slip[which], values[which], name, mark_colour, 0.0, "-", marker, 5.0)
            )
    return curves
