"""The report on an evaluation: its answer, one table of errors, and figures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import cycle
from math import degrees, nan
from typing import Any, Final

import numpy as np

from experiments.calibrate.calibration import parameter_table
from experiments.common import style
from experiments.common.chart import WIDE, Chart, dots, law_curve
from experiments.common.check import Check, checks_table
from experiments.common.colours import BLACK, GREY, VERMILLION
from experiments.common.laws import law_cell, shown
from experiments.common.page import Answer, Page, Plot, Section
from experiments.common.table import Cell, Table, number, percent, significant
from experiments.evaluate.prediction import AHEAD, Prediction, winner
from sim.calibration.calibration import Calibration
from trackslip.errors import counted
from trackslip.identification.drive_comparison import TODAY
from trackslip.identification.prediction import PredictionErrors, Statistics
from trackslip.laws.file import NO_SLIP
from trackslip.odometry.evaluation import Trajectory

_HEADER: Final = (
    "ahead",
    "model",
    "pairs",
    "position [m]",
    "90 % below",
    "rms",
    "heading [deg]",
    "90 % below",
    "rms",
    "drift",
    "turn",
)
_NOTE: Final = (
    "All models predict the same motion: from every measured pose to the one nearest to the time "
    "or distance ahead. Errors contain the noise of both poses. Drift and turn: mean errors in "
    "position and heading over the time or the distance ahead."
)
_DOTS: Final = "Half of the errors are below the dot, 90 % of the errors below the end of the line."
_BEGINS: Final = (
    "The drive that goes far and turns most. Every path begins at its first measured pose, "
    "or fits all positions."
)
# colours of laws that are there again; no law in `experiments.common.laws` has them
OTHER_COLOURS: Final = (VERMILLION, "#882255", "#525252")


@dataclass(frozen=True)
class Report:
    """The results of an evaluation, for the terminal and for the page."""

    title: str
    source: str
    predictions: Sequence[Prediction]
    checks: Sequence[Check]
    fit: Calibration | None
    """The fit of the calibrated robot."""
    notes: Sequence[str]

    def print(self) -> None:
        """Print the tables, the warnings, the gain, and how many bounds hold."""
        for table in self._tables:
            table.print()
        for note in self.notes:
            print(f"warning: {note}")
        for line in (self._gain, self._verdict):
            if line:
                print(line)

    def page(self, manifest: Mapping[str, Any], command: str) -> Page:
        """The page with answer, tables and figures."""
        best, length, unit = self._winner
        errors = best.ahead(length, unit)
        assert errors is not None
        position, far, _, heading, turned, _ = _cells(errors)
        error = f"{position} m" if errors.position else f"{heading}°"
        title = f"Best after {length:g} {unit}: {best.model.label}, {error} off"
        facts = []
        if errors.position:
            facts.append(("position", f"median {position} m, 90 % of errors below {far} m"))
        if errors.heading:
            facts.append(("heading", f"median {heading}°, 90 % of errors below {turned}°"))
        alarms = []
        if not all(check.holds for check in self.checks):
            alarms = [self._verdict]
            facts.insert(0, (f"best after {length:g} {unit}", f"{best.model.label}, {error} off"))
        lines = [f"{line}." for line in (self._gain, self._verdict) if line not in ("", *alarms)]
        answer = Answer(title, facts, lines, self.notes, alarms)

        drive = max(best.errors.trajectories, key=_extent)
        draw_errors = partial(_errors_ahead, self.predictions)
        draw_paths = partial(path_chart, self.predictions, drive.name)
        plots = [
            Plot("errors_ahead", draw_errors, "Errors of all models", _DOTS),
            Plot("paths", draw_paths, f"Paths of {drive.name}", _BEGINS),
        ]
        sections = [Section("Errors", [*plots, *self._tables])]
        return Page(self.title, command, manifest, sections, [self.source], answer)

    @cached_property
    def _winner(self) -> tuple[Prediction, float, str]:
        return winner(self.predictions)

    @property
    def _tables(self) -> list[Table]:
        bounds = [checks_table("Bounds, 1 s ahead", self.checks)] if self.checks else []
        fit = [parameter_table("The calibrated robot", self.fit)] if self.fit else []
        return [*bounds, self._errors, *fit]

    @property
    def _errors(self) -> Table:
        """Errors of all models by time and distance ahead."""
        rows: list[tuple[str | Cell, ...]] = []
        best, *compared = self._winner
        for length, unit in AHEAD:
            ahead = f"{length:g} {unit}"
            for prediction in self.predictions:
                errors = prediction.ahead(length, unit)
                model = prediction.model
                if errors is None:
                    continue
                is_best = prediction is best and [length, unit] == compared
                name = replace(law_cell(model.name, is_best, formula=False), text=model.label)
                pairs = f"{errors.count:,}"
                rates = _rates(errors, length, unit)
                rows.append((ahead, name, pairs, *_cells(errors), *rates))
                ahead = ""
        title = "Errors: median, the error that 90 % stay below, and rms"
        return Table(title, _HEADER, rows, "llr", _NOTE)

    @property
    def _verdict(self) -> str:
        if not self.checks:
            return ""
        held = sum(check.holds for check in self.checks)
        return f"{held} of {counted(len(self.checks), 'check')} passed"

    @property
    def _gain(self) -> str:
        """A line that compares the best model with no slip compensation; empty if no model is
        better.
        """
        best, length, unit = self._winner
        without_law = [each for each in self.predictions if each.model.name in (TODAY, NO_SLIP)]
        if not without_law or without_law[0] is best:
            return ""
        better = []
        for what in ("position", "heading"):
            errors = getattr(best.ahead(length, unit), what)
            without = getattr(without_law[0].ahead(length, unit), what)
            if errors and errors.median > 0:
                factor = without.median / errors.median
                better.append(f"{what} {significant(factor)} times better")
        if not better:
            return ""
        return (
            f"{best.model.label}, after {length:g} {unit}, compared with no slip "
            f"compensation: {', '.join(better)}"
        )


def _extent(drive: Trajectory) -> float:
    """How far a drive goes and how much it turns, to choose the one to draw [m rad]."""
    distance = np.ptp(drive.distance)
    turn = np.ptp(drive.estimated[:, 2])
    return float(distance * turn)


def _cells(errors: PredictionErrors) -> list[str]:
    """Median, 90 % quantile and rms of the errors in position [m] and heading [deg]."""
    return [
        *_statistics(errors.position, 1.0, 3),
        *_statistics(errors.heading, degrees(1.0), 2),
    ]


def _statistics(part: Statistics | None, factor: float, digits: int) -> list[str]:
    """Median, 90 % quantile and rms of errors, times `factor`."""
    values = (part.median, part.p90, part.rms) if part else (nan, nan, nan)
    return [number(factor * value, digits) for value in values]


def _rates(errors: PredictionErrors, length: float, unit: str) -> tuple[str, str]:
    """Mean errors in position and heading per metre or per second ahead."""
    position = errors.position.mean / length if errors.position else nan
    heading = errors.heading.mean / length if errors.heading else nan
    drift = percent(position) if unit == "m" else significant(position, "m/s")
    return drift, significant(degrees(heading), f"°/{unit}")


@style.styled
def _errors_ahead(predictions: Sequence[Prediction]) -> style.Panels:
    """Median errors at the length where models are compared, with lines up to the 90 %
    quantiles.
    """
    _, length, unit = winner(predictions)
    height = 1.2 + 0.28 * len(predictions)
    keys = [
        style.key("median", color=GREY, marker="o", ls="none"),
        style.key("up to 90 % of errors", color=GREY),
    ]
    labels = [prediction.model.label for prediction in predictions]
    figures = []
    for what, sign, factor in (("position", "m", 1.0), ("heading", "°", degrees(1.0))):
        label = f"error after {length:g} {unit} [{sign}]"
        figure, axis = style.panel(what.capitalize(), label, "", height)
        for k, prediction in enumerate(predictions):
            errors = getattr(prediction.ahead(length, unit), what)
            if errors is not None:
                ends = factor * np.array([errors.median, errors.p90])
                colour = shown(prediction.model.name).colour
                axis.plot(ends, [k, k], "o-", markevery=[0], color=colour)
        axis.set_xscale("log")
        style.log_ticks(axis.xaxis)
        axis.set_yticks(range(len(predictions)), labels)
        axis.set_ylim(len(predictions) - 0.5, -0.5)
        style.legend_below(figure, keys)
        figures.append(figure)
    return tuple(figures)


def path_chart(predictions: Sequence[Prediction], name: str) -> Chart:
    """Measured and predicted paths of a drive.

    Each law has its colour. A law that is there again, as with a gyro or from another file, has
    another one.
    """
    measured = predictions[0].drive(name).measured
    rows = style.thin(len(measured), 1500)
    curves = [dots(measured[rows], "measured", BLACK)]
    others = cycle(OTHER_COLOURS)
    drawn = set()
    for prediction in predictions:
        path = prediction.drive(name).placed[rows]
        model = prediction.model
        curve = law_curve(path[:, 0], path[:, 1], model.name, model.label)
        if model.name in drawn:
            curve = replace(curve, colour=next(others))
        drawn.add(model.name)
        curves.append(curve)
    return Chart("", "x [m]", "y [m]", curves, 5.4, WIDE, is_map=True)
