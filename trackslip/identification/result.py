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
_MATTERS = 0.1  # difference of two answers that matters to a user [significant changes]: 0.1 % in ε
_REPORTS = "trackslip.reports"  # entry point group of the packages that can draw reports
_SHOWN = 3  # laws in a repr
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
        found = self.drive.alarms if self.drive is not None and self.method == "drive" else ()
        return (*self._multiplier(), *found, *self._contradiction())

    def _multiplier(self) -> list[Alarm]:
        """Odometry taken as encoders, whose multiplier nobody stated."""
        for log in self.logs:
            bag = log.metadata.get("bag")
            if isinstance(bag, Mapping) and bag.get("odometry") and "multiplier" not in log.metadata:
                times = self.answer.get("wheel_separation_multiplier")
                then = f"; the answer is then current × {times.value:.2f}" if times else ""
                line = (
                    f"odometry {bag.get('encoders')} was computed with a wheel_separation_multiplier that the log does "
                    f"not state: give --multiplier (1 if it had none){then}"
                )
                return [Alarm("multiplier", line)]
        return []

    def _contradiction(self) -> list[Alarm]:
        """Steady stretches and whole drives whose values of a law exclude each other, and differ by what matters."""
        if (
            self.steady is None
            or self.drive is None
            or REFERENCE not in self.steady.laws
            or REFERENCE not in self.drive.laws
        ):
            return []
        steady, drive = self.steady.laws[REFERENCE], self.drive.laws[REFERENCE]
        apart = []
        changes = dict(zip(drive.values, FAMILIES[REFERENCE].limits(self.geometry.half_gauge)[2], strict=True))
        for name, change in changes.items():
            ends = [fit.interval95.get(name, (-np.inf, np.inf)) for fit in (steady, drive)]
            low, high = max(end[0] for end in ends), min(end[1] for end in ends)
            if low > high and abs(steady.values[name] - drive.values[name]) > _MATTERS * change:
                apart.append(f"{name} {steady.values[name]:.3g} and {drive.values[name]:.3g}")
        line = (
            f"steady stretches and whole drives contradict each other ({', '.join(apart)}): look at both in the report"
        )
        return [Alarm("contradiction", line)] if apart else []

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
        offset, error = (_mean(fit, key) for key in ("offset", "radius_error"))
        left, right = (_mean(fit, "radius_error", side) for side in ("left", "right"))
        return {
            "wheel_separation_multiplier": Gain(*(1 + end / b for end in offset)),
            "left_wheel_radius_multiplier": Gain(*(1 + end for end in left)),
            "right_wheel_radius_multiplier": Gain(*(1 + end for end in right)),
            "offset": Gain(*offset),
            "radius_error": Gain(*error),
        }

    @property
    def expressible(self) -> str | None:
        """The best of the laws that a differential drive's odometry can express; None if there is none."""
        return self._main().expressible

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
    def reason(self) -> str:
        """Why `best` is the best, in one sentence."""
        return self._main().reason

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
            interval = "held" if ends is None else f"{ends[0]:+.5f} .. {ends[1]:+.5f}".replace("+nan .. +nan", "none")
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


def _mean(fit: FittedLaw, key: str, side: str = "") -> tuple[float, float, float]:
    """A parameter, or the mean of those of both sides, with the ends of its 95 % interval; 0 if the law has none.

    The ends are NaN where nothing was fitted.
    """
    names = [name for name in fit.values if name == key or name.startswith(f"{key}_{side}")]
    value = float(np.mean([fit.values[name] for name in names])) if names else 0.0
    fitted = [list(fit.stderr).index(name) for name in names if name in fit.stderr]
    if not fitted:
        return value, np.nan, np.nan
    errors = np.array([*fit.stderr.values()])[fitted] / len(names)
    error = float(np.sqrt(errors @ fit.correlation[np.ix_(fitted, fitted)] @ errors))
    low, high = np.transpose([fit.interval95[name] for name in names if name in fit.stderr])  # cut at limits
    middle = np.array([fit.values[name] for name in names if name in fit.stderr])
    wide = float(np.max(np.maximum(high - middle, middle - low) / np.maximum(errors * len(names), 1e-300)))
    return value, value - wide * error, value + wide * error


def laws_to_json(laws: Mapping[str, FittedLaw], geometry: RobotGeometry) -> dict[str, Any]:
    """`slip_laws` and `geometry`, as `load_laws` reads them."""
    return laws_content({name: fit.stored for name, fit in laws.items() if fit.values and fit.determined}, geometry)


def identification_to_json(found: Identification) -> dict[str, Any]:
    """`laws_to_json`, `laws` with everything known of each law, `prediction` of drives, and what was left out."""
    steady, drive = found.steady, found.drive
    content: dict[str, Any] = laws_to_json(found.fits(), found.geometry) | {"method": found.method, "best": found.best}
    content["expressible"] = found.expressible
    content["answer"] = {name: gain.to_json() for name, gain in found.answer.items()}
    if steady is not None:
        laws = {name: _steady_law(name, steady) for name in steady.laws}
        content |= {"laws": laws, "samples": len(steady.samples)}
    if drive is not None:
        content["drive"] = {
            "best": drive.best,
            "reason": drive.reason,
            "drives": [one.name for one in drive.drives],
            "score": dict(drive.score),
            "laws": {name: _content(law) for name, law in drive.laws.items()},
        }
        content["look"] = drive.look.to_json()
        content["prediction"] = {
            name: {f"{horizon:g}": asdict(errors) for horizon, errors in by_horizon.items()}
            for name, by_horizon in drive.errors.items()
        }
    outliers = [asdict(outlier) for outlier in found.outliers]
    return content | {
        "outliers": outliers,
        "alarms": [asdict(alarm) for alarm in found.alarms],
        "warnings": list(found.warnings),
    }


def _steady_law(name: str, found: SteadyComparison) -> dict[str, Any]:
    errors = {f"cv_{key}": error for key, error in asdict(found.validation[name]).items()}
    return _content(found.laws[name]) | errors


def _content(law: FittedLaw) -> dict[str, Any]:
    """The fields of a fit, but for some."""
    found = {field.name: getattr(law, field.name) for field in fields(law) if field.name not in _UNSTORED}
    return found | {"correlation": law.correlation.tolist()}
