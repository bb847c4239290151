"""The result of an identification: laws, intervals and the best law, as tables and for a summary.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from html import escape
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Literal

import numpy as np

from trackslip.errors import OutputError, TrackslipError, counted
from trackslip.identification.comparison import Comparison, DriveComparison
from trackslip.identification.first_look import Alarm
from trackslip.identification.fitted import FittedLaw, Gain
from trackslip.identification.law_fit import REFERENCE
from trackslip.identification.samples import SlipSamples
from trackslip.identification.steady_comparison import SteadyComparison
from trackslip.kinematics import RobotGeometry
from trackslip.laws.base import SlipLaw
from trackslip.laws.families import FAMILIES
from trackslip.laws.file import laws_content
from trackslip.logs.runlog import Refused, RunLog

Method = Literal["steady", "drive"]
"""Ways to identify laws: from stretches of constant sprocket speeds, or from whole drives."""
_REPORTS = "trackslip.reports"  # entry point group of the packages that can draw reports
_UNSTORED = ("name", "law", "fit", "missed", "pairs")  # fields of fits
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
    def alarms(self) -> tuple[Alarm, ...]:
        """Reasons not to trust the best law as it is."""
        drive = self.drive.alarms if self.drive is not None and self.method == "drive" else ()
        lines = {"multiplier": self._unstated_multiplier(), "contradiction": self._contradiction()}
        first, last = (tuple(Alarm(kind, line) for line in [lines[kind]] if line) for kind in lines)
        return (*first, *drive, *last)

    def _unstated_multiplier(self) -> str:
        """A line on odometry taken as encoders, whose multiplier nobody stated; empty if there is none."""
        for log in self.logs:
            bag = log.metadata.get("bag")
            if isinstance(bag, Mapping) and bag.get("odometry") and "multiplier" not in log.metadata:
                times = self.answer.get("wheel_separation_multiplier")
                then = f"; the answer is then current × {times.value:.2f}" if times else ""
                return (
                    f"odometry {bag.get('encoders')} was computed with a wheel_separation_multiplier that the log does "
                    f"not state: give --multiplier (1 if it had none){then}"
                )
        return ""

    def _contradiction(self) -> str:
        """A line on steady stretches and whole drives whose values of a law exclude each other and differ much."""
        fits = [by.laws.get(REFERENCE) for by in (self.steady, self.drive) if by is not None]
        steady, drive = fits if len(fits) == 2 else (None, None)
        if steady is None or drive is None:
            return ""
        apart = []
        for name, change in zip(drive.values, FAMILIES[REFERENCE].limits(self.geometry.half_gauge)[2], strict=True):
            lows, highs = zip(*(fit.interval95.get(name, (-np.inf, np.inf)) for fit in (steady, drive)), strict=True)
            if max(lows) > min(highs) and abs(steady.values[name] - drive.values[name]) > 0.1 * change:
                apart.append(f"{name} {steady.values[name]:.3g} and {drive.values[name]:.3g}")
        line = (
            f"steady stretches and whole drives contradict each other ({', '.join(apart)}): look at both in the report"
        )
        return line if apart else ""

    @property
    def answer(self) -> dict[str, Gain]:
        """What people look for, with 95 % intervals: multipliers of a differential drive's odometry, D [m] and ε.

        Ends of an interval are NaN where there is none: of what the law doesn't have, or too little driving.
        `wheel_separation_multiplier`, `left_wheel_radius_multiplier`, `right_wheel_radius_multiplier`, `offset` and
        `radius_error`, of the best law if it has constant ICRs, else of the best of those.
        """
        if self.expressible is None:
            return {}
        fit, b = self.fits()[self.expressible], self.geometry.half_gauge
        offset = _mean(fit, "offset")
        radii = {side: _mean(fit, "radius_error", side) for side in ("left", "right")}
        return {
            "wheel_separation_multiplier": Gain(*(1 + end / b for end in offset)),
            **{f"{side}_wheel_radius_multiplier": Gain(*(1 + end for end in error)) for side, error in radii.items()},
            "offset": offset,
            "radius_error": _mean(fit, "radius_error"),
        }

    @property
    def expressible(self) -> str | None:
        """The best of the laws that a differential drive's odometry can express; None if there is none."""
        return self._main.expressible

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
        return self._main.best

    @property
    def reason(self) -> str:
        """Why `best` is the best, in one sentence."""
        return self._main.reason

    @property
    def laws(self) -> dict[str, SlipLaw]:
        """The identified laws by name, the best predictions first."""
        return {name: self.fits()[name].law for name in self._main.ranking}

    @property
    def intervals(self) -> dict[str, Mapping[str, tuple[float, float]]]:
        """95 % interval of every fitted parameter by law and parameter, in the parameter's unit."""
        return {name: self.fits()[name].interval95 for name in self._main.ranking}

    @property
    def _main(self) -> Comparison:
        return self.drive if self.method == "drive" and self.drive is not None else self.comparison

    def fits(self) -> Mapping[str, FittedLaw]:
        """The fits by law, of the method that identified."""
        return self._main.laws

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
        names = self._ranking()
        rows = [_HEADER, *(row for name in names[:3] for row in self._rows(name))]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
        more = [f"and {len(names) - 3} more, see .laws"] if len(names) > 3 else []
        return "\n".join([*self._title(), *lines, *more])

    def _repr_html_(self) -> str:
        """The table of all laws, for notebooks."""
        rows = [row for name in self._ranking() for row in self._rows(name)]
        cells = ["".join(f"<td>{escape(cell)}</td>" for cell in row) for row in (_HEADER, *rows)]
        title, table = "<br>".join(map(escape, self._title())), "".join(f"<tr>{row}</tr>" for row in cells)
        return f"<p>{title}</p><table>{table}</table>"

    def _ranking(self) -> list[str]:
        """Names of the laws with parameters, the best first."""
        fits = self.fits()
        return sorted((name for name in self._main.ranking if fits[name].values), key=lambda name: name != self.best)

    def _rows(self, name: str) -> list[tuple[str, ...]]:
        """A row per parameter of a law."""
        fit, rows = self.fits()[name], list[tuple[str, ...]]()
        for key, value in fit.values.items():
            ends = fit.interval95.get(key)
            unit = FAMILIES[name].parameters[key].unit or "-"
            label = "" if rows else f"{name} (best)" if name == self.best else name
            interval = "held" if ends is None else f"{ends[0]:+.5f} .. {ends[1]:+.5f}".replace("+nan .. +nan", "none")
            rows.append((label, f"{key} [{unit}]", f"{value:+.5f}", interval))
        return rows

    def _title(self) -> list[str]:
        """Where the laws are from, and what was left out."""
        size = f"b = {self.geometry.half_gauge:g} m, r = {self.geometry.sprocket_radius:g} m"
        drives = self.drive.drives if self.method == "drive" and self.drive else None
        source = counted(len(self.samples), "steady sample") if drives is None else counted(len(drives), "drive")
        title = f"Slip laws from {source} ({size}); best: {self.best}"
        out = f"{counted(len(self.outliers), 'run')} left out, " if self.outliers else ""
        return [title, f"{out}{counted(len(self.warnings), 'warning')}, see .warnings"] if self.warnings else [title]


def _mean(fit: FittedLaw, key: str, side: str = "") -> Gain:
    """A parameter, or the mean of those of both sides, with the ends of its 95 % interval; 0 if the law has none.

    The ends are NaN where nothing was fitted.
    """
    names = [name for name in fit.values if name == key or name.startswith(f"{key}_{side}")]
    value = float(np.mean([fit.values[name] for name in names])) if names else 0.0
    names = [name for name in names if name in fit.stderr]
    if not names:
        return Gain(value, np.nan, np.nan)
    rows = [list(fit.stderr).index(name) for name in names]
    share = np.array([fit.stderr[name] for name in names]) / len(names)
    error = float(np.sqrt(share @ fit.correlation[np.ix_(rows, rows)] @ share))
    widths = [
        np.abs(np.subtract(fit.interval95[name], fit.values[name])).max() for name in names
    ]  # one end: at a limit
    wide = float(np.max(np.array(widths) / np.maximum(share * len(names), 1e-300)))
    return Gain(value, value - wide * error, value + wide * error)


def laws_to_json(laws: Mapping[str, FittedLaw], geometry: RobotGeometry) -> dict[str, Any]:
    """`slip_laws` and `geometry`, as `load_laws` reads them."""
    return laws_content({name: fit.stored for name, fit in laws.items() if fit.values and fit.determined}, geometry)


def identification_to_json(found: Identification) -> dict[str, Any]:
    """`laws_to_json`, `laws` with everything known of each law, `prediction` of drives, and what was left out."""
    steady, drive = found.steady, found.drive
    content: dict[str, Any] = laws_to_json(found.fits(), found.geometry) | {
        "method": found.method,
        "best": found.best,
        "expressible": found.expressible,
        "answer": {name: gain.to_json() for name, gain in found.answer.items()},
    }
    if steady is not None:
        content["samples"] = len(steady.samples)
        content["laws"] = {
            name: _content(law) | {f"cv_{key}": error for key, error in asdict(steady.validation[name]).items()}
            for name, law in steady.laws.items()
        }
    if drive is not None:
        content["drive"] = {
            "best": drive.best,
            "reason": drive.reason,
            "drives": [part.name for part in drive.drives],
            "score": dict(drive.score),
            "laws": {name: _content(law) for name, law in drive.laws.items()},
        }
        content["look"] = drive.look.to_json()
        content["prediction"] = {
            name: {f"{horizon:g}": asdict(errors) for horizon, errors in by_horizon.items()}
            for name, by_horizon in drive.errors.items()
        }
    return content | {
        "outliers": [asdict(outlier) for outlier in found.outliers],
        "alarms": [asdict(alarm) for alarm in found.alarms],
        "warnings": list(found.warnings),
    }


def _content(law: FittedLaw) -> dict[str, Any]:
    """The fields of a fit, but for some."""
    content = {field.name: getattr(law, field.name) for field in fields(law) if field.name not in _UNSTORED}
    return content | {"correlation": law.correlation.tolist()}
