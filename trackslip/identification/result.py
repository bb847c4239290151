"""The result of an identification: laws, intervals and the best law, as tables and for a summary.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from html import escape
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Literal

from trackslip.doubts import severity
from trackslip.errors import OutputError, TrackslipError, counted
from trackslip.identification.comparison import Comparison, DriveComparison, SteadyComparison
from trackslip.identification.fitted import FittedLaw
from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import RobotGeometry
from trackslip.logs.runlog import Refused, RunLog
from trackslip.slip.base import SlipLaw
from trackslip.slip.families import FAMILIES
from trackslip.slip.law_file import laws_content

Method = Literal["steady", "drive"]
"""Ways to identify laws: from stretches of constant sprocket speeds, or from whole drives."""
_REPORTS = "trackslip.reports"  # entry point group of the packages that can draw reports
_SHOWN = 3  # laws in a repr
_UNSTORED = ("name", "law", "fit")  # fields of fits
_HEADER = ("law", "parameter", "value", "95 % interval")


@dataclass(frozen=True)
class Identification:
    """Laws identified from logs, and what was left out on the way.

    `repr` shows the best laws as a table, a notebook all of them.
    """

    geometry: RobotGeometry
    """Nominal geometry of the robot."""
    method: Method
    """Source of `best`, `laws` and `intervals`: steady stretches or whole drives."""
    steady: SteadyComparison | None
    """Laws of steady stretches; None if there are too few."""
    drive: DriveComparison | None
    """Laws of whole drives; None if they were not evaluated."""
    outliers: tuple[Refused, ...]
    """Runs that gave no sample or were left out of the fits."""
    warnings: tuple[str, ...]
    """Alarms, doubts and remarks, one line each."""
    logs: tuple[RunLog, ...] = ()
    """The runs that the laws were identified from, if there were any."""

    @property
    def alarms(self) -> tuple[str, ...]:
        """The warnings that say not to trust the laws as they are."""
        return tuple(line for line in self.warnings if severity(line) == "alarm")

    @property
    def samples(self) -> SlipSamples:
        """The steady samples; raises TrackslipError if there are none."""
        return self.comparison.samples

    @property
    def comparison(self) -> SteadyComparison:
        """The fits to steady samples; raises TrackslipError if there are none."""
        if self.steady is None:
            raise TrackslipError("the laws were identified from whole drives: there are no steady samples")
        return self.steady

    @property
    def best(self) -> str:
        """Name of the law that predicts motion best; of laws that predict it equally well, the simplest."""
        return self._main().best

    @property
    def laws(self) -> dict[str, SlipLaw]:
        """The identified laws by name, the best predictions first."""
        return {name: self.fits()[name].law for name in self._main().ranking}

    @property
    def intervals(self) -> dict[str, Mapping[str, tuple[float, float]]]:
        """95 % interval of every fitted parameter by law and parameter, in the parameter's unit."""
        return {name: self.fits()[name].interval95 for name in self._main().ranking}

    def _main(self) -> Comparison:
        return self.drive if self.method == "drive" and self.drive is not None else self.comparison

    def fits(self) -> Mapping[str, FittedLaw]:
        """The fits by law, of the method that identified."""
        return self._main().laws

    def report(self, path: str | Path) -> Path:
        """Write the report, one self-contained HTML page, to a file, or as `report.html` to a folder; returns its path.

        Raises:
            TrackslipError: if the package that draws reports is not installed.
            OutputError: if the file cannot be written.
        """
        file = Path(path)
        file = file / "report.html" if file.is_dir() else file
        renderers = tuple(entry_points(group=_REPORTS, name="identification"))
        if not renderers:
            raise TrackslipError(f"report: no package with an entry point in the group {_REPORTS!r} is installed")
        html: str = renderers[0].load()(self)
        try:
            file.write_text(html, encoding="utf-8")
        except OSError as error:
            raise OutputError(f"{file}: cannot be written ({error.strerror})") from error
        return file

    def __repr__(self) -> str:
        shown = self._ranking()[:_SHOWN]
        rows = [_HEADER, *(row for name in shown for row in self._rows(name))]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
        more = len(self.fits()) - len(shown)
        return "\n".join([self._title(), *lines, *([f"and {more} more, see .laws"] if more else []), *self._notes()])

    def _repr_html_(self) -> str:
        """The table of all laws, for notebooks."""
        head = "".join(f"<th>{text}</th>" for text in _HEADER)
        rows = [row for name in self._ranking() for row in self._rows(name)]
        body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
        notes = "".join(f"<br>{escape(note)}" for note in self._notes())
        return f"<p>{escape(self._title())}{notes}</p><table><tr>{head}</tr>{body}</table>"

    def _ranking(self) -> list[str]:
        """Names of the laws with parameters, the best first."""
        fits = self.fits()
        return sorted((name for name in self._main().ranking if fits[name].values), key=lambda name: name != self.best)

    def _rows(self, name: str) -> list[tuple[str, ...]]:
        """A row per parameter of a law."""
        fit = self.fits()[name]
        rows: list[tuple[str, ...]] = []
        for key, value in fit.values.items():
            ends = fit.interval95.get(key)
            unit = FAMILIES[name].parameters[key].unit or "-"
            label = "" if rows else f"{name} (best)" if name == self.best else name
            interval = "held" if ends is None else f"{ends[0]:+.5f} .. {ends[1]:+.5f}"
            rows.append((label, f"{key} [{unit}]", f"{value:+.5f}", interval))
        return rows

    def _title(self) -> str:
        size = f"b = {self.geometry.half_gauge:g} m, r = {self.geometry.sprocket_radius:g} m"
        drive = self.drive
        source = (
            counted(len(drive.drives), "drive")
            if self.method == "drive" and drive
            else counted(len(self.samples), "steady sample")
        )
        return f"Slip laws from {source} ({size}); best: {self.best}"

    def _notes(self) -> list[str]:
        left_out = f"{counted(len(self.outliers), 'run')} left out, " if self.outliers else ""
        return [f"{left_out}{counted(len(self.warnings), 'warning')}, see .warnings"] if self.warnings else []


def laws_to_json(laws: Mapping[str, FittedLaw], geometry: RobotGeometry) -> dict[str, Any]:
    """`slip_laws` and `geometry`, as `load_laws` reads them."""
    return laws_content({name: fit.stored for name, fit in laws.items() if fit.values and fit.determined}, geometry)


def identification_to_json(found: Identification) -> dict[str, Any]:
    """`laws_to_json`, `laws` with everything known of each law, `prediction` of drives, and what was left out."""
    steady, drive = found.steady, found.drive
    content: dict[str, Any] = laws_to_json(found.fits(), found.geometry) | {"method": found.method, "best": found.best}
    if steady is not None:
        laws = {name: _steady_law(name, steady) for name in steady.laws}
        content |= {"laws": laws, "samples": len(steady.samples)}
    if drive is not None:
        content["drive"] = {
            "best": drive.best,
            "reason": drive.reason,
            "drives": [one.name for one in drive.drives],
            "score": dict(drive.score),
            "laws": {name: _content(law, _UNSTORED) for name, law in drive.laws.items()},
            "clock_profile": drive.clock and {"offset": drive.clock.offset.tolist(), "rise": drive.clock.rise.tolist()},
            "warnings": list(drive.warnings),
        }
        content["prediction"] = {
            name: {f"{horizon:g}": asdict(errors) for horizon, errors in by_horizon.items()}
            for name, by_horizon in drive.errors.items()
        }
    outliers = [asdict(outlier) for outlier in found.outliers]
    return content | {"outliers": outliers, "alarms": list(found.alarms), "warnings": list(found.warnings)}


def _steady_law(name: str, found: SteadyComparison) -> dict[str, Any]:
    errors = {f"cv_{key}": error for key, error in asdict(found.validation[name]).items()}
    law = _content(found.laws[name], (*_UNSTORED, "likelihood"))
    return law | {"aicc": found.aicc[name], "weight": found.weight[name]} | errors


def _content(law: FittedLaw, unstored: Sequence[str]) -> dict[str, Any]:
    """The fields of a fit, but for some."""
    found = {field.name: getattr(law, field.name) for field in fields(law) if field.name not in unstored}
    lack = found.get("lack_of_fit")
    return found | {"correlation": law.correlation.tolist()} | ({"lack_of_fit": asdict(lack)} if lack else {})
