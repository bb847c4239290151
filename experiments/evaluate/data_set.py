"""Data sets: TOML files that state a log, what predicts it, and bounds of the errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args

from experiments.calibrate.config import Parameter
from experiments.common.check import Check
from experiments.common.options import refuse_changed
from experiments.evaluate.config import MAX_FOLDS, Config
from experiments.evaluate.models import CALIBRATED, FIRST, GAINS, ROBOT, TODAY
from experiments.evaluate.prediction import Prediction, of_laws
from experiments.simulate.options import GroundOptions
from sim.toml_file import build, read_toml
from trackslip.errors import require, require_positive, require_whole

LAWS = "laws"
"""In bounds, the best of the laws."""
_UNITS = {"position": "m", "heading": "rad"}
_QUANTITIES = tuple(f"{what}_{kind}" for what in _UNITS for kind in ("median", "p90", "rms"))


@dataclass(frozen=True)
class Bound:
    """The largest error that a model may have 1 s ahead, in SI units, or with `over` its ratio to another model's."""

    row: str
    """today, two_gains, laws (the best), robot, calibrated, or robot_2 and so on for further robots."""
    quantity: str
    most: float
    over: str = ""

    def __post_init__(self) -> None:
        require(self.quantity in _QUANTITIES, "quantity", self.quantity, f"one of {', '.join(_QUANTITIES)}")
        require_positive("most", self.most)


@dataclass(frozen=True)
class DataSet:
    """A log of a robot, where it is from, and the options of its evaluation; files lie beside the data set."""

    title: str
    log: Path
    source: str
    licence: str
    robot: tuple[str, ...]
    ground: str
    law: tuple[str, ...] = ()
    sensor: tuple[float, ...] = ()
    free: tuple[str, ...] = ()
    folds: int = 2
    bounds: tuple[Bound, ...] = ()

    def __post_init__(self) -> None:
        require(self.log.exists(), "log", self.log, "a file beside the data set")
        require_whole("folds", self.folds, 2, MAX_FOLDS)
        require(len(self.sensor) in (0, 3), "sensor", self.sensor, "x, y and yaw")
        known = {ROBOT, CALIBRATED, TODAY, GAINS, LAWS, *(f"{ROBOT}_{k + 1}" for k in range(1, len(self.robot)))}
        for bound in self.bounds:
            for row in filter(None, (bound.row, bound.over)):
                require(row in known, "bounds", row, f"one of {', '.join(sorted(known))}")
        for name in self.free:
            require(name in get_args(Parameter), "free", name, f"one of {', '.join(get_args(Parameter))}")

    def options(self, config: Config) -> Config:
        """The options with what the data set states; raises InvalidValueError for those that are given besides."""
        stated: dict[str, Any] = {
            "law": self.law,
            "robot": self.robot,
            "ground": GroundOptions(self.ground),
            "folds": self.folds,
        }
        stated |= {"sensor": self.sensor or None, "free": self.free or None}
        for name in stated:
            why = "with a data set, which states it"
            refuse_changed(name, getattr(config, name), getattr(Config(config.path), name), why)
        return replace(config, path=self.log, **stated)

    def checks(self, found: Sequence[Prediction]) -> list[Check]:
        """The bounds as checks."""

        def error(row: str, quantity: str) -> float:
            rows = of_laws(found) if row == LAWS else [one for one in found if one.label == row]
            what, _, kind = quantity.partition("_")
            errors = [getattr(one.errors.after_seconds.get(FIRST), what, None) for one in rows]
            return min((getattr(one, kind) for one in errors if one is not None), default=float("nan"))

        checks = []
        for bound in self.bounds:
            value, unit = error(bound.row, bound.quantity), _UNITS[bound.quantity.partition("_")[0]]
            what = f"{bound.row}, {bound.quantity}"
            if bound.over:
                value, unit, what = value / error(bound.over, bound.quantity), "1", f"{what} over {bound.over}"
            checks.append(Check(self.title, what, value, bound.most, unit))
        return checks


def load_data_set(path: Path) -> DataSet:
    """The data set of a TOML file; raises SettingsFileError for an unreadable one and for invalid fields."""
    table = read_toml(path)

    def beside(value: object) -> object:
        return str(path.parent / value) if isinstance(value, str) and (path.parent / value).exists() else value

    for name, value in table.items():
        if name in ("log", "robot", "ground", "law"):
            table[name] = [beside(one) for one in value] if isinstance(value, list) else beside(value)
    return build(DataSet, table, str(path))
