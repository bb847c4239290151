"""What an identification found: laws, their intervals, and which law is best; as tables and in a summary.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from html import escape
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from trackslip.errors import OutputError, TrackslipError
from trackslip.identification.comparison import Comparison
from trackslip.identification.fitted import FittedLaw
from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import RobotGeometry
from trackslip.logs.refused import Refused
from trackslip.logs.runlog import RunLog
from trackslip.slip.base import SlipLaw
from trackslip.slip.families import FAMILIES
from trackslip.slip.law_file import laws_content

_REPORTS = "trackslip.reports"  # entry point group of the packages that can draw reports
_SHOWN = 3  # laws in a repr
_HEADER = ("law", "parameter", "value", "95 % interval")


@dataclass(frozen=True)
class Identification:
    """Laws identified from samples, and what was left out on the way.

    `repr` shows the best laws as a table, a notebook all of them.
    """

    geometry: RobotGeometry
    """Nominal geometry of the robot."""
    samples: SlipSamples
    """The samples that the laws were fitted to."""
    outliers: tuple[Refused, ...]
    """Runs that gave no sample or were left out of the fits."""
    comparison: Comparison
    """The fits in full."""
    warnings: tuple[str, ...]
    """What a reader should know, one line each."""
    logs: tuple[RunLog, ...] = ()
    """The runs the samples were taken from, if there were any."""

    @property
    def best(self) -> str:
        """Name of the best law: the simplest whose AICc is within 2 of the smallest."""
        return self.comparison.best

    @property
    def laws(self) -> dict[str, SlipLaw]:
        """The identified laws by name, in order of their AICc, smallest first."""
        return {name: self.comparison.laws[name].law for name in self.comparison.ranking}

    @property
    def intervals(self) -> dict[str, Mapping[str, tuple[float, float]]]:
        """95 % interval of every parameter by law and parameter, in the parameter's unit."""
        return {name: self.comparison.laws[name].interval95 for name in self.comparison.ranking}

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
        more = len(self.comparison.laws) - len(shown)
        return "\n".join([self._title(), *lines, *([f"and {more} more, see .laws"] if more else []), *self._notes()])

    def _repr_html_(self) -> str:
        """The table of all laws, for notebooks."""
        head = "".join(f"<th>{text}</th>" for text in _HEADER)
        rows = [row for name in self._ranking() for row in self._rows(name)]
        body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
        notes = "".join(f"<br>{escape(note)}" for note in self._notes())
        return f"<p>{escape(self._title())}{notes}</p><table><tr>{head}</tr>{body}</table>"

    def _ranking(self) -> list[str]:
        """Names of the laws with parameters, the best first, the others by AICc."""
        names = [name for name in self.comparison.ranking if self.comparison.laws[name].values]
        return sorted(names, key=lambda name: name != self.best)

    def _rows(self, name: str) -> list[tuple[str, ...]]:
        """A row per parameter of a law."""
        fit = self.comparison.laws[name]
        rows: list[tuple[str, ...]] = []
        for key, value in fit.values.items():
            low, high = fit.interval95[key]
            unit = FAMILIES[name].parameters[key].unit or "-"
            label = "" if rows else f"{name} (best)" if name == self.best else name
            rows.append((label, f"{key} [{unit}]", f"{value:+.5f}", f"{low:+.5f} .. {high:+.5f}"))
        return rows

    def _title(self) -> str:
        size = f"b = {self.geometry.half_gauge:g} m, r = {self.geometry.sprocket_radius:g} m"
        return f"Slip laws from {len(self.samples)} runs ({size}); best: {self.best}"

    def _notes(self) -> list[str]:
        left_out = f"{len(self.outliers)} run(s) left out, " if self.outliers else ""
        return [f"{left_out}{len(self.warnings)} warning(s), see .warnings"] if self.warnings else []


def laws_to_json(laws: Mapping[str, FittedLaw], geometry: RobotGeometry) -> dict[str, Any]:
    """`slip_laws` and `geometry`, as `load_laws` reads them."""
    described = {
        name: {"values": fit.values, "stderr": fit.stderr, "rms": fit.rms} for name, fit in laws.items() if fit.values
    }
    return laws_content(described, geometry)


def identification_to_json(found: Identification) -> dict[str, Any]:
    """`laws_to_json`, and `laws` with everything known of each law, and what was left out."""
    return laws_to_json(found.comparison.laws, found.geometry) | {
        "laws": {name: _law_to_json(name, found.comparison) for name in found.comparison.laws},
        "best": found.best,
        "samples": len(found.samples),
        "outliers": [asdict(outlier) for outlier in found.outliers],
        "warnings": list(found.warnings),
    }


def _law_to_json(name: str, comparison: Comparison) -> dict[str, Any]:
    found = asdict(comparison.laws[name])
    for key in ("name", "law", "likelihood"):
        del found[key]
    found["correlation"] = found["correlation"].tolist()
    errors = {f"cv_{key}": error for key, error in asdict(comparison.validation[name]).items()}
    return found | {"aicc": comparison.aicc[name], "weight": comparison.weight[name]} | errors
