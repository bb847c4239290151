"""The report of an evaluation: its answer, one table of errors, and figures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import degrees
from typing import Any

from experiments.calibrate.calibration import parameter_table
from experiments.common.check import Check, checks_table
from experiments.common.page import Answer, Page, Plot, Section
from experiments.common.table import Cell, Table, number, percent, significant
from experiments.evaluate import figures
from experiments.evaluate.log import Log
from experiments.evaluate.models import TODAY
from experiments.evaluate.prediction import FARTHEST, Prediction, best, decisive
from sim.calibration.calibration import Calibration
from trackslip.errors import counted
from trackslip.odometry.evaluation import LENGTHS, PoseErrors
from trackslip.slip.law_file import NO_SLIP

_HEADER = ("ahead", "model", "pairs", "position", "90 %", "rms [m]", "heading", "90 %", "rms [deg]", "per metre")
_METHOD = (
    "All models predict the same pairs of measured poses: the motion from every pose to the one nearest to the given "
    "time or distance ahead, as Kümmerle et al. (2009) and KITTI do. Errors contain the noise of both poses. Without "
    "headings, each motion starts with the heading at which the prediction fits the positions of the last 10 s. Per "
    "metre is the sum of the errors over that of the distances, which are the encoders', without slip. A log in folds "
    "is predicted in parts, each by what was fitted to the others."
)


@dataclass(frozen=True)
class Report:
    """What the terminal and the page show."""

    title: str
    origin: str
    """Where the log is from."""
    log: Log
    found: Sequence[Prediction]
    checks: Sequence[Check]
    fit: Calibration | None
    notes: Sequence[str]

    def print(self) -> None:
        """Print the tables, warnings, the gain and how many bounds hold."""
        for table in self._tables.values():
            table.print()
        for line in (*(f"warning: {note}" for note in self.notes), self._gain, self._verdict):
            if line:
                print(line)

    def page(self, manifest: Mapping[str, Any], command: str) -> Page:
        """The page."""
        dots = "Dots: medians. Lines: to the errors that 90 % stay below."
        plot = Plot("errors_ahead", partial(figures.errors_ahead, self.found), "Errors of all models", dots)
        tables = [Section(heading, [table]) for heading, table in self._tables.items() if heading != "Errors"]
        sections = [
            Section("Errors", [plot, self._tables["Errors"]]),
            Section("A path", [self._path()]) if self.log.logs else None,
            *tables,
            Section("How errors are measured", [_METHOD], folded=True),
        ]
        drives = self.found[0].errors.drives
        way, duration = sum(drive.way for drive in drives), sum(drive.duration for drive in drives)
        driven = f"{counted(len(drives), 'drive')}: {way:.0f} m by the encoders in {duration:.0f} s"
        if not self.log.logs:
            driven = f"{counted(len(drives), 'row')} of steady driving, as if driven for 1 s"
        intro = f"Motion is predicted from the encoders of {driven}.{self.origin}"
        return Page(self.title, command, manifest, sections, [intro], self._answer)

    @property
    def _tables(self) -> dict[str, Table]:
        tables = {"Bounds": checks_table("Bounds, 1 s ahead", self.checks)} if self.checks else {}
        tables["Errors"] = self._errors
        if self.fit is not None:
            tables["The calibrated robot"] = parameter_table("Parameters of the calibrated robot", self.fit)
        return tables

    @property
    def _errors(self) -> Table:
        """Errors of all models by time and distance ahead."""
        rows = list[tuple[str | Cell, ...]]()
        for length, unit in (*((at, "s") for at in LENGTHS), (FARTHEST, "m")):
            chosen = best(self.found) if (length, unit) == decisive(self.found) else None
            known = [(one, errors) for one in self.found if (errors := one.ahead(length, unit)) is not None]
            for k, (one, errors) in enumerate(known):
                name = Cell(figures.title(one), one.label, mark="best" if one is chosen else "")
                per_metre = ""
                if unit == "m":
                    turn = significant(degrees(errors.heading_per_way), "°")
                    per_metre = f"{percent(errors.position_per_way)}, {turn}"
                ahead = "" if k else f"{length:g} {unit}"
                rows.append((ahead, name, f"{errors.count:,}", *_cells(errors), per_metre))
        return Table("Errors: median, 90 % and rms", _HEADER, rows, "llr")

    @property
    def _verdict(self) -> str:
        held = sum(check.holds for check in self.checks)
        return f"{held} of {counted(len(self.checks), 'check')} passed" if self.checks else ""

    @property
    def _gain(self) -> str:
        """The best model compared with no slip compensation."""
        chosen, (length, unit) = best(self.found), decisive(self.found)
        without = next((one for one in self.found if one.name in (TODAY, NO_SLIP)), chosen)
        better = []
        for what in ("position", "heading"):
            ours, theirs = (getattr(one.ahead(length, unit), what, None) for one in (chosen, without))
            if ours and theirs and ours.median > 0 and chosen is not without:
                better.append(f"{what} {significant(theirs.median / ours.median)} times better")
        line = f"{chosen.label}, after {length:g} {unit}, compared with no slip compensation: {', '.join(better)}"
        return line if better else ""

    def _path(self) -> Plot:
        drive = figures.typical(self.found)
        caption = "A typical drive of those that go far; every path begins at its first measured pose."
        if not drive.has_heading:
            caption = "As no heading was measured, paths are moved so that they fit the measured positions best."
        return Plot("paths", partial(figures.paths, self.found), f"Paths of {drive.name}", caption)

    @property
    def _answer(self) -> Answer:
        chosen, (length, unit) = best(self.found), decisive(self.found)
        position, far, _, heading, turned, _ = _cells(chosen.ahead(length, unit))
        facts = [("position, median and 90 %", f"{position} and {far} m")]
        facts += [("heading, median and 90 %", f"{heading}° and {turned}°")]
        facts += [("bounds", self._verdict)] if self.checks else []
        title = f"Best after {length:g} {unit}: {figures.title(chosen)}, {position} m off"
        return Answer(title, facts, [f"{self._gain}."] if self._gain else [], self.notes)


def _cells(errors: PoseErrors | None) -> list[str]:
    """Median, 90 % and rms of position [m] and heading [deg]."""
    cells = []
    for what, factor, digits in (("position", 1.0, 3), ("heading", degrees(1.0), 2)):
        part = getattr(errors, what, None)
        values = (part.median, part.p90, part.rms) if part else (None, None, None)
        cells += [number(None if value is None else factor * value, digits) for value in values]
    return cells
