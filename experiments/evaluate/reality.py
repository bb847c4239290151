"""Logs of real robots, and their motion predicted on parts held out: without a fit, by slip laws, by the simulator."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.common.check import Check
from sim.calibration.calibration import Calibration, calibrate
from sim.calibration.candidate import Candidate
from sim.calibration.targets import Drives, SteadyRows
from sim.ground.named import load_ground
from sim.log_replay import Replayer, predictions
from sim.robot.named import load_parameters
from sim.toml_file import build, read_named
from trackslip import se2
from trackslip.errors import LogError, counted, require, require_positive, require_whole
from trackslip.identification import drive_prediction as drives
from trackslip.identification.drive_law import REFERENCE, DriveFit, fit_drives
from trackslip.identification.drives import drives_of
from trackslip.identification.fitted import FittedLaw, fit_law
from trackslip.identification.samples import SlipSamples
from trackslip.identification.source import ReadOptions, Source, read_source
from trackslip.identification.steady_fit import fit
from trackslip.identification.weighting import WeightedRuns
from trackslip.kinematics import Array, body_twist
from trackslip.metrics import rms
from trackslip.se2 import Mounting
from trackslip.slip.families import FAMILIES

FOLDER = Path(__file__).parents[2] / "examples" / "logs"
"""Folder of the shipped data sets; an installed wheel doesn't have it."""
HORIZONS = (1.0, 1.8, 5.0)
"""Times ahead at which drives are predicted [s]."""
DRIVE_LAWS = (REFERENCE, "turn_loss", "turn_loss_sides", "centrifugal")
STEADY_LAWS = ("icr", "turn_loss_sides", "icr_sides")
"""The laws that are fitted; others were never best."""
LAWS, DATA_SHEET, CALIBRATED, TRANSFERRED = "laws", "data_sheet", "calibrated", "transferred"
LAW_TRANSFERRED, SCATTER, MEASURED = "law_transferred", "scatter", "measured"
"""Rows besides those of single laws and of drive_prediction; LAWS stands for the best one."""
_ROWS = (drives.TODAY, drives.GAINS, LAWS, DATA_SHEET, CALIBRATED, TRANSFERRED, LAW_TRANSFERRED)
_WINDOW = 6.5  # duration of the windows into which whole drives are cut [s]
_MAX_FOLDS = 10
_LEAST_WAY, _LEAST_TURN = 0.5, 0.3  # in HORIZONS[0], of a drive that is drawn [m, rad]


@dataclass(frozen=True)
class SteadyErrors:
    """Root mean square errors of steady motion; `rest` is without the rows apart."""

    v: float  # [m/s]
    w: float  # [rad/s]
    v_rest: float
    w_rest: float


UNITS = {"v": "m/s", "w": "rad/s", "position": "m", "heading": "rad"}
"""Units of errors, by the first part of their names."""
_ERRORS = (*SteadyErrors.__annotations__, *drives.PredictionErrors.__annotations__)


@dataclass(frozen=True)
class Bound:
    """The largest error that a row of the table may have; of drives, at HORIZONS[0]."""

    row: str
    quantity: str
    """A field of SteadyErrors or PredictionErrors."""
    most: float
    """In SI units; with `over`, a ratio."""
    over: str = ""
    """The row whose error divides the other's."""

    def __post_init__(self) -> None:
        for name, row in (("row", self.row), ("over", self.over or LAWS)):
            require(row in _ROWS, name, row, f"one of {', '.join(_ROWS)}")
        require(self.quantity in _ERRORS, "quantity", self.quantity, f"one of {', '.join(_ERRORS)}")
        require_positive("most", self.most)


@dataclass(frozen=True)
class DataSet:
    """A log of a real robot, where it is from, and what to do with it. Files are named from the data set's folder."""

    title: str
    log: Path
    source: str
    licence: str
    robot: str
    """Name or file of the robot as in its data sheet."""
    ground: str
    """Name or file of the ground, likewise."""
    sensor: tuple[float, ...] = ()
    """Place of the poses' sensor, ahead and to the left of the middle, and its heading there [m, m, rad]; or empty."""
    free: tuple[str, ...] = ()
    """Parameters of the simulator to calibrate."""
    folds: int = 2
    """Parts, in the order of the log, each of which is predicted by fits to the others."""
    apart: tuple[int, ...] = ()
    """Numbers of rows of steady driving without which errors are also given."""
    transfer: str = ""
    """Data set whose fits are carried over to this ground."""
    bounds: tuple[Bound, ...] = ()

    def __post_init__(self) -> None:
        require(self.log.exists(), "log", self.log, "a file beside the data set")
        require_whole("folds", self.folds, 2, _MAX_FOLDS)
        require(len(self.sensor) in (0, 3), "sensor", self.sensor, "x, y and yaw")
        load_parameters(self.robot)
        load_ground(self.ground)

    @property
    def base(self) -> Candidate:
        """The simulated robot of the data sheet."""
        return Candidate(load_parameters(self.robot)[0], load_ground(self.ground), Mounting(*self.sensor))


@dataclass(frozen=True)
class Findings:
    """Predictions of a data set."""

    name: str
    data: DataSet
    laws: Mapping[str, FittedLaw]
    """Laws fitted to all of it."""
    best: str
    """The law that predicts best."""
    rows: Mapping[str, Mapping[float, Any]]
    """PredictionErrors by row and time ahead [s]; or SteadyErrors, at 0 s."""
    notes: Sequence[str]
    """What was left out of the log."""
    calibration: Calibration | None = None
    """Fit of the simulator to all of it."""
    samples: SlipSamples | None = None
    """Of steady driving, n rows."""
    twists: Mapping[str, Array] = field(default_factory=dict)
    """Predictions (n, 2) of these, by row of the table."""
    tracks: Mapping[str, Array] = field(default_factory=dict)
    """Paths (k, 3) of the sensor in a typical window: MEASURED, and by row of the table."""

    def error(self, row: str, quantity: str) -> float:
        """An error of a row, NaN if there is none; of LAWS, the smallest one."""
        known = [
            next(iter(self.rows[name].values())) for name in (self.laws if row == LAWS else (row,)) if name in self.rows
        ]
        return min((getattr(one, quantity, np.nan) for one in known), default=np.nan)

    @property
    def checks(self) -> list[Check]:
        """The bounds of the data set."""
        found = []
        for one in self.data.bounds:
            value, unit = self.error(one.row, one.quantity), UNITS[one.quantity.partition("_")[0]]
            if one.over:
                value, unit = value / self.error(one.over, one.quantity), "1"
            what = f"{one.row}, {one.quantity}{f' over {one.over}' if one.over else ''}"
            found.append(Check(self.name, what, value, one.most, unit))
        return found


def shipped() -> dict[str, Path]:
    """Files of the shipped data sets, by name."""
    return {path.stem: path for path in sorted(FOLDER.glob("*.toml"))}


def load_data_set(source: str) -> DataSet:
    """A shipped data set, or one of a TOML file.

    Raises InvalidValueError for another source, SettingsFileError for an unreadable file and invalid fields.
    """
    path = shipped().get(source, Path(source))
    table = read_named("dataset", str(path), shipped())
    for name in ("log", "robot", "ground", "transfer"):
        if isinstance(value := table.get(name), str) and (name == "log" or (path.parent / value).is_file()):
            table[name] = str(path.parent / value)
    return build(DataSet, table, str(path))


def findings(source: str, known: dict[str, Findings], threads: int = 0) -> Findings:
    """Predictions of a data set, which are added to the `known` ones.

    Raises TrackslipError for a data set, a log or a robot that can't be used.
    """
    path = str(shipped().get(source, source))
    if path not in known:
        data = load_data_set(path)
        geometry = load_parameters(data.robot)[0].geometry
        log = read_source(data.log, ReadOptions(geometry.half_gauge, geometry.sprocket_radius))
        other = None
        if data.transfer:
            allowed = "a data set that has no transfer"
            require(not load_data_set(data.transfer).transfer, f"{path}: transfer", data.transfer, allowed)
            other = findings(data.transfer, known, threads)
        name = Path(path).stem
        known[path] = _of_rows(name, data, log, threads) if log.rows else _of_drives(name, data, log, other, threads)
    return known[path]


def _of_rows(name: str, data: DataSet, source: Source, threads: int) -> Findings:
    """Predict steady driving."""
    samples, geometry = source.sampling.samples, source.geometry
    folds, rows = fold_labels(samples.run, data.folds, source.name), np.arange(len(samples))
    kept = (folds != np.unique(folds)[:, None]).astype(float)
    if 2 * kept.sum(axis=1).min() <= max(len(FAMILIES[law].names) for law in STEADY_LAWS):
        raise LogError(f"{source.name}: has {counted(len(samples), 'usable row')}, too few for folds = {data.folds}")
    plain = body_twist(samples.omega, 0.0, geometry)
    gains = np.einsum("fn,nc->fc", kept, plain * samples.twist) / np.einsum("fn,nc->fc", kept, plain**2)
    runs = WeightedRuns.of(samples, geometry).weighted(kept)
    by_law = {law: fit(FAMILIES[law], runs).twist[folds, rows] for law in STEADY_LAWS}
    base, target = data.base, SteadyRows(samples, geometry, threads=threads)
    sheet = target.predicted(base)[:2].T
    twists = {drives.TODAY: plain, drives.GAINS: plain * gains[folds], **by_law, DATA_SHEET: sheet}
    found = None
    if data.free:
        found = calibrate(target, base, data.free, folds[target.layout.cluster])
        twists[CALIBRATED] = np.array([target.predicted(one)[:2].T for one in found.folds])[folds, rows]
    rest = ~np.isin(samples.run, [f"row {row}" for row in data.apart])
    missed = {row: (twist - samples.twist, rest) for row, twist in twists.items()} | {SCATTER: scatter(samples, rest)}
    errors = {
        row: {0.0: SteadyErrors(*(rms(one) if len(one) else np.nan for one in (*error.T, *error[kept].T)))}
        for row, (error, kept) in missed.items()
    }
    laws = {law: fit_law(law, samples, geometry, bootstraps=0, vague=True) for law in STEADY_LAWS}
    best = min(laws, key=lambda law: errors[law][0.0].w)
    notes = [*map(str, source.sampling.refused)]
    return Findings(name, data, laws, best, errors, notes, found, samples, twists)


def scatter(samples: SlipSamples, rest: np.ndarray) -> tuple[Array, np.ndarray]:
    """Second differences (m, 2), as large as errors of single rows, and (m,) bool of those in the `rest` (n,).

    They are taken along rows that share the speed of one sprocket, at equal steps of the other one's.
    """
    omega = samples.omega.round(6)
    side = int(len(np.unique(omega[:, 1])) < len(np.unique(omega[:, 0])))
    order = np.lexsort((omega[:, 1 - side], omega[:, side]))
    three = np.stack([order[:-2], order[1:-1], order[2:]])  # (3, m)
    steps = np.diff(omega[three], axis=0)
    three = three[:, (np.abs(steps[1] - steps[0]) < 1e-5).all(axis=1) & (steps[0, :, side] == 0)]
    return np.diff(samples.twist[three], 2, axis=0)[0] / 6**0.5, np.asarray(rest[three].all(axis=0))


def _of_drives(name: str, data: DataSet, source: Source, other: Findings | None, threads: int) -> Findings:
    """Predict drives, all rows the same pairs of poses; and by the laws of an `other` data set."""
    logs = [part for log in source.logs for part in log.cut(_WINDOW)]
    prepared, refused = drives_of(logs)
    if bare := next((drive.name for drive in prepared if not drive.has_heading), ""):
        raise LogError(f"{source.name}: run {bare!r} has no headings (phi), which predictions start from")
    usable = {drive.name for drive in prepared}
    logs = [log for log in logs if log.run in usable]
    commands = [log.run if log.command is None else tuple(log.command.mean(axis=0).round(3)) for log in logs]
    reference = fit_drives(REFERENCE, prepared, source.geometry)
    folds = fold_labels(commands, data.folds, source.name)
    pairs = drives.ScoredPairs.of(reference.fit, HORIZONS, folds)
    if not len(pairs.start):
        raise LogError(f"{source.name}: no poses {HORIZONS[0]:g} s apart between which the robot moves")
    laws = {law: fit_drives(law, prepared, source.geometry, reference=reference) for law in DRIVE_LAWS}
    found = drives.baselines(pairs, source.geometry, None)
    found |= {law: drives.held_out(one.fit, pairs) for law, one in laws.items()}
    errors = {row: one.errors() for row, one in found.items()}
    best = min(laws, key=lambda law: next(iter(errors[law].values())).position_median)
    model, values = laws[best].fit.model, found[best].values
    clocks = values[:, model.index("clock_offset")]
    base = data.base
    late = [replace(base, clock=clock) for clock in clocks.tolist()]
    simulated = {DATA_SHEET: late}
    calibration = None
    if data.free:
        target = Drives(logs, source.geometry, threads=threads)
        calibration = calibrate(target, base, data.free, folds[target.log])
        simulated[CALIBRATED] = list(calibration.folds)
    if other is not None and isinstance(theirs := other.laws[other.best], DriveFit):
        carried = np.tile(theirs.fit.values, (len(clocks), 1))
        carried[:, theirs.fit.model.index("clock_offset")] = clocks
        found[LAW_TRANSFERRED] = drives.predicted(theirs.fit.model, carried, pairs.part, pairs)
        if other.calibration is not None:
            fitted = other.calibration.candidate.with_values({"friction": base.ground.along})
            simulated[TRANSFERRED] = [replace(fitted, clock=one.clock) for one in late]
    run = lru_cache(partial(Replayer(logs).run, threads=threads))
    for row, candidates in simulated.items():
        of_fold = [predictions(run(one.robot, one.ground), pairs, one.sensor, one.clock) for one in candidates]
        error = np.array([one.error for one in of_fold])[pairs.part, np.arange(len(pairs.part))]
        found[row] = replace(of_fold[0], error=error)
    rows = {row: one.errors() for row, one in found.items()}
    notes = [*source.notes, *map(str, (*source.refused, *refused))]
    tracks = dict[str, Array]()
    if (pair := _typical(pairs, found[best])) is not None:
        window, part, nodes = pairs.drive[pair], pairs.part[pair], pairs.nodes
        seen = np.arange(*nodes.first[window : window + 2])
        seen = seen[np.isfinite(nodes.pose[seen]).all(axis=1)]
        path = model.of_sensor(values[part], model.steps(values[part], nodes.timeline, np.zeros(0, int)).path)
        path[:, 2] += values[part, model.index("sensor_yaw")]
        tracks = {MEASURED: nodes.pose[seen], best: path[seen]}
        for row, candidates in simulated.items():
            one = candidates[part]
            tracks[row] = run(one.robot, one.ground).sensor_at(window, one.sensor, nodes.time[seen] + one.clock)
        tracks = {row: se2.between(poses[0], poses) for row, poses in tracks.items()}
    return Findings(name, data, laws, best, rows, notes, calibration, tracks=tracks)


def _typical(pairs: drives.ScoredPairs, predicted: drives.DrivePredictions) -> int | None:
    """The pair whose predicted position has the median error of those that move and turn far; None if none does."""
    x, y, turn = np.abs(pairs.nodes.pose[pairs.end] - pairs.nodes.pose[pairs.start]).T
    far = np.flatnonzero((np.hypot(x, y) > _LEAST_WAY) & (turn > _LEAST_TURN) & (pairs.horizon == HORIZONS[0]))
    return int(far[np.argsort(predicted.sizes[far, 0], kind="stable")[len(far) // 2]]) if len(far) else None


def fold_labels(keys: Sequence[Any], count: int, log: str) -> np.ndarray:
    """Labels (n,) of the folds, parts of about equal size in order; what has the same key is in the same part.

    Raises LogError, with the name of the log, if it has too few different keys.
    """
    rank = {key: k for k, key in enumerate(dict.fromkeys(keys))}
    if len(rank) < count:
        raise LogError(f"{log}: has {counted(len(rank), 'different command')}, too few for folds = {count}")
    return np.array([rank[key] * count // len(rank) for key in keys])
