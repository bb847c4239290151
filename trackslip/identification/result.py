"""Results of identifications: laws, intervals and the best law, for summary.json and the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from trackslip.drives.first_look import Alarm
from trackslip.errors import OutputError, TrackslipError, counted
from trackslip.identification.answer import TOO_LITTLE, answer_of, undetermined
from trackslip.identification.comparison import REFERENCE, Comparison, FittedLaw
from trackslip.identification.drive_comparison import TODAY, DriveComparison
from trackslip.identification.prediction import FAR_AHEAD
from trackslip.identification.samples import SlipSamples
from trackslip.identification.steady import SteadyComparison
from trackslip.intervals import Gain
from trackslip.kinematics import RobotGeometry
from trackslip.laws.base import SlipLaw
from trackslip.laws.families import FAMILIES
from trackslip.laws.file import laws_content
from trackslip.logs.runlog import Refused, RunLog
from trackslip.viewable import Viewable

Method = Literal["steady", "drive"]
"""How laws are identified: from stretches of constant sprocket speeds, or from whole drives."""
# largest half-width of a useful interval for a multiplier, which is 1 to 2 for tracks [-]
_VAGUE: Final = 0.5
_FEW_SAMPLES: Final = 6  # number of steady samples below which their number explains wide intervals
# share of a significant change in a parameter by which steady stretches and whole drives may differ
_NOTICED: Final = 0.1


def _odometry_of(log: RunLog) -> str:
    """The topic or the columns of odometry that replaced encoders; empty if it didn't."""
    bag = log.metadata.get("bag")
    if isinstance(bag, Mapping) and bag.get("odometry"):
        return str(bag.get("encoders"))
    return str(log.metadata.get("odometry", ""))


@dataclass(frozen=True)
class Identification(Viewable):
    """Laws identified from logs, and the runs left out; `print` shows the main values."""

    geometry: RobotGeometry
    """Nominal geometry of the robot."""
    method: Method
    """Whether `best`, `laws` and `intervals` come from steady stretches or whole drives."""
    steady: SteadyComparison | None
    """Laws from steady stretches; None if these are too few."""
    drive: DriveComparison | None
    """Laws from whole drives; None if whole drives were not used."""
    outliers: tuple[Refused, ...]
    """Runs that yielded no sample or were left out of the fits."""
    warnings: tuple[str, ...]
    """Remarks on runs and fits, one line each."""
    logs: tuple[RunLog, ...] = ()
    """The runs from which the laws were identified; empty if the log has samples instead of
    traces.
    """

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """Reasons not to trust the best law."""
        drive = self.drive.alarms if self.drive is not None and self.method == "drive" else ()
        alarms = [
            *self._unstated_multiplier(),
            *self._untold(drive),
            *drive,
            *self._contradiction(),
        ]
        # a law that is worse than none is the first to be known
        return tuple(sorted(alarms, key=lambda alarm: alarm.kind != TODAY))

    def _untold(self, others: Sequence[Alarm]) -> list[Alarm]:
        """Return an alarm with the cause if the driving hardly determines D; none if `others` name
        it, or if the robot turns enough in whole drives.
        """
        key = "wheel_separation_multiplier"
        times = self.answer.get(key)
        if times is None or others or not (key in self.undetermined or times.error > _VAGUE):
            return []
        if key in self.undetermined:
            return [Alarm("turns", "the driving doesn't determine D: drive turns to both sides")]
        if self.method == "steady":
            return [Alarm("scatter", self._why_samples_are_vague(times))]
        if self.drive is not None and not self.drive.look.turns_to_one_side:
            return []
        return [Alarm("turns", "the driving hardly determines D: drive turns to both sides")]

    def _why_samples_are_vague(self, times: Gain) -> str:
        """The reason for a wide interval of the separation multiplier from steady samples, and the
        remedy.
        """
        samples = self.samples
        vague = f"wheel_separation_multiplier is known to ± {times.error:.2g} only"
        turns = samples.omega[:, 1] - samples.omega[:, 0]
        if len(samples) < _FEW_SAMPLES:
            return (
                f"{vague}: {counted(len(samples), 'sample')} are too few: take {_FEW_SAMPLES} or "
                "more, straight ahead and in turns to both sides"
            )
        if min(np.sum(turns > 0), np.sum(turns < 0)) == 0:
            return f"{vague}: drive turns to both sides"
        assert self.expressible is not None
        missed = self.comparison.laws[self.expressible].rms
        return (
            f"{vague}: the samples scatter by {100 * missed:.2g} % of the belt speed about law "
            f"{self.expressible}: measure longer, and check the rows that are far off in the report"
        )

    def _unstated_multiplier(self) -> list[Alarm]:
        """Return an alarm if odometry with an unknown multiplier was used in place of encoders."""
        for log in self.logs:
            odometry = _odometry_of(log)
            if odometry and "multiplier" not in log.metadata:
                times = self.answer.get("wheel_separation_multiplier")
                then = f"; the answer is then current × {times.value:.2f}" if times else ""
                line = (
                    f"the odometry in {odometry} was computed with a "
                    "wheel_separation_multiplier that the log does "
                    f"not state: give --multiplier (1 if it had none){then}"
                )
                return [Alarm("multiplier", line)]
        return []

    def _contradiction(self) -> list[Alarm]:
        """Return an alarm if values from steady stretches and whole drives differ and intervals
        don't overlap.
        """
        if self.steady is None or self.drive is None:
            return []
        if REFERENCE not in self.steady.laws or REFERENCE not in self.drive.laws:
            return []
        steady = self.steady.laws[REFERENCE]
        drive = self.drive.laws[REFERENCE]
        _, _, scales = FAMILIES[REFERENCE].limits(self.geometry.half_gauge)
        apart = list[str]()
        for name, scale in zip(drive.values, scales.tolist(), strict=True):
            steady_low, steady_high = steady.interval95.get(name, (-np.inf, np.inf))
            drive_low, drive_high = drive.interval95.get(name, (-np.inf, np.inf))
            overlap = max(steady_low, drive_low) <= min(steady_high, drive_high)
            difference = abs(steady.values[name] - drive.values[name])
            if not overlap and difference > _NOTICED * scale:
                apart.append(f"{name} {steady.values[name]:.3g} and {drive.values[name]:.3g}")
        if not apart:
            return []
        line = (
            f"steady stretches and whole drives contradict each other ({', '.join(apart)}): look "
            "at both in the report"
        )
        return [Alarm("contradiction", line)]

    @property
    def answer(self) -> dict[str, Gain]:
        """The main values, with 95 % intervals: multipliers for a differential drive's odometry, D
        [m] and ε.

        The keys are `wheel_separation_multiplier`, `left_wheel_radius_multiplier`,
        `right_wheel_radius_multiplier`, `offset` and `radius_error`. The values come from the law
        `expressible`. Values in `undetermined` are NaN; an interval's ends are NaN if there is too
        little driving.
        """
        if self.expressible is None:
            return {}
        return answer_of(self.main.laws[self.expressible], self.geometry.half_gauge)

    @property
    def undetermined(self) -> dict[str, str]:
        """For each value of the answer that the driving doesn't determine, a line with the
        manoeuvre that would determine it.
        """
        if self.expressible is None:
            return {}
        return undetermined(self.main.laws[self.expressible])

    @property
    def main(self) -> Comparison:
        """The comparison in which `best` was chosen."""
        return self.drive if self.method == "drive" and self.drive is not None else self.comparison

    @property
    def comparison(self) -> SteadyComparison:
        """The fits to steady samples; raises TrackslipError if there are none."""
        if self.steady is None:
            raise TrackslipError(
                "the laws were identified from whole drives: there are no steady samples"
            )
        return self.steady

    @property
    def samples(self) -> SlipSamples:
        """The steady samples; raises TrackslipError if there are none."""
        return self.comparison.samples

    @property
    def best(self) -> str:
        """Name of the law that predicts motion best or, among laws that predict it equally well,
        the simplest.
        """
        return self.main.best

    @property
    def expressible(self) -> str | None:
        """The law of a differential drive that gives the answer: `diff_drive`, or `icr_radius` if
        the radii of left and right don't differ; None if there is none.
        """
        return self.main.expressible

    @property
    def laws(self) -> dict[str, SlipLaw]:
        """The identified laws by name, the best first."""
        return {name: fit.law for name, fit in self.main.laws.items()}

    @property
    def intervals(self) -> dict[str, Mapping[str, tuple[float, float]]]:
        """95 % intervals of all fitted parameters, by law and parameter, in the parameters'
        units.
        """
        return {name: fit.interval95 for name, fit in self.main.laws.items()}

    def report(self, path: str | Path) -> Path:
        """Write the report, a self-contained HTML page, to a file or to `report.html` in a folder;
        returns its path.

        Raises:
            TrackslipError: if no installed package renders reports.
            OutputError: if the file cannot be written.
        """
        file = Path(path)
        file = file / "report.html" if file.is_dir() else file
        renderers = tuple(entry_points(group="trackslip.reports", name="identification"))
        if not renderers:
            raise TrackslipError(
                "report: no package with an entry point in the group 'trackslip.reports' is "
                "installed"
            )
        html: str = renderers[0].load()(self)
        try:
            file.write_text(html, encoding="utf-8")
        except OSError as error:
            raise OutputError(f"{file}: cannot be written ({error.strerror})") from error
        return file

    def __repr__(self) -> str:
        drive = self.drive if self.method == "drive" else None
        source = (
            counted(len(drive.look.drives), "drive")
            if drive
            else counted(len(self.samples), "steady sample")
        )
        size = f"b = {self.geometry.half_gauge:g} m, r = {self.geometry.sprocket_radius:g} m"
        lines = [f"Slip laws from {source} ({size}); best: {self.best}"]
        lines += [f"ALARM: {alarm.line}" for alarm in self.alarms]
        lines += [f"{name:<28}  {self._value(name)}" for name in self.answer]
        if self.warnings:
            lines.append(f"{counted(len(self.warnings), 'warning')}, see .warnings")
        return "\n".join(lines)

    def _value(self, name: str) -> str:
        """A value of the answer as text: with its interval, or what would determine it."""
        gain = self.answer[name]
        if np.isnan(gain.value):
            return self.undetermined[name]
        if np.isnan(gain.low):
            return f"{gain.value:.5f} ({TOO_LITTLE})"
        return f"{gain.value:.5f} ({gain.low:.5f} to {gain.high:.5f})"


def identification_to_json(result: Identification) -> dict[str, Any]:
    """The content of summary.json: laws in the form that `load_laws` reads, their details,
    predictions and outliers.
    """
    stored = {name: _stored(fit) for name, fit in result.main.laws.items() if fit.values}
    content: dict[str, Any] = laws_content(stored, result.geometry)
    content["method"] = result.method
    content["best"] = result.best
    content["expressible"] = result.expressible
    content["answer"] = {name: gain.to_json() for name, gain in result.answer.items()}
    content["undetermined"] = result.undetermined
    if result.steady is not None:
        content["samples"] = len(result.steady.samples)
        content["laws"] = _steady_content(result.steady)
    if result.drive is not None:
        content |= _drive_content(result.drive)
    content["outliers"] = [asdict(outlier) for outlier in result.outliers]
    content["alarms"] = [asdict(alarm) for alarm in result.alarms]
    content["warnings"] = list(result.warnings)
    return content


def _steady_content(steady: SteadyComparison) -> dict[str, dict[str, Any]]:
    """Laws from steady samples by name, with their errors at left-out radii."""
    content = {name: _content(law) for name, law in steady.laws.items()}
    for name, errors in steady.validation.items():
        if errors is not None:
            content[name] |= {f"cv_{key}": error for key, error in vars(errors).items()}
    return content


def _drive_content(drive: DriveComparison) -> dict[str, Any]:
    """Laws from whole drives, the first look at these, and errors of predictions."""
    laws = {name: _content(law) for name, law in drive.laws.items()}
    names = [part.name for part in drive.look.drives]

    # errors by law, and by horizon in s or m
    prediction = dict[str, dict[str, Any]]()
    for law, by_horizon in drive.errors.items():
        prediction[law] = {}
        for horizon, errors in by_horizon.items():
            prediction[law][f"{horizon:g}"] = asdict(errors)
    for law, errors in drive.far_errors.items():
        prediction[law][f"{FAR_AHEAD:g} m"] = asdict(errors)

    compared = {
        "best": drive.best,
        "reason": drive.reason,
        "drives": names,
        "score": dict(drive.score),
        "laws": laws,
    }
    return {"drive": compared, "look": drive.look.to_json(), "prediction": prediction}


def _stored(law: FittedLaw) -> dict[str, Any]:
    """A law in the form that `load_laws` reads; standard errors are None for values that were
    held.
    """
    errors = {name: law.stderr.get(name) for name in law.values}
    return {"values": law.values, "stderr": errors, "interval95": law.interval95}


def _content(law: FittedLaw) -> dict[str, Any]:
    """The fields of a fit that summary.json contains."""
    unstored = ("name", "law", "fit", "missed", "pairs")
    names = [field.name for field in fields(law) if field.name not in unstored]
    content = {name: getattr(law, name) for name in names}
    content["correlation"] = law.correlation.tolist()
    return content
