"""Data sets: TOML files that name a log, the models that predict it, and bounds on their errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, get_args

from experiments.calibrate.config import Parameter
from experiments.common.check import Check
from experiments.common.options import refuse_changed
from experiments.evaluate.config import Config
from experiments.evaluate.prediction import Prediction
from experiments.simulate.options import GroundOptions
from sim.common.settings import build, read_toml
from trackslip.errors import require, require_positive

_AHEAD: Final = 1.0  # time ahead at which errors are bounded [s]
_UNITS: Final = {"position": "m", "heading": "rad"}
_QUANTITIES: Final = tuple(f"{what}_{kind}" for what in _UNITS for kind in ("median", "p90", "rms"))


@dataclass(frozen=True)
class Bound:
    """The largest error that a model may have 1 s ahead, in SI units."""

    row: str
    """Label of the model."""
    quantity: str
    most: float

    def __post_init__(self) -> None:
        is_known = self.quantity in _QUANTITIES
        require(is_known, "quantity", self.quantity, f"one of {', '.join(_QUANTITIES)}")
        require_positive("most", self.most)


@dataclass(frozen=True)
class DataSet:
    """A robot's log, its origin, and the options of its evaluation; file names are relative to the
    data set.
    """

    title: str
    log: Path
    source: str
    licence: str
    robot: tuple[str, ...] = ()
    ground: str | None = None
    law: tuple[str, ...] = ()
    free: tuple[str, ...] = ()
    folds: int = 2
    bounds: tuple[Bound, ...] = ()

    def __post_init__(self) -> None:
        require(self.log.exists(), "log", self.log, "a file beside the data set")
        parameters = get_args(Parameter)
        for name in self.free:
            require(name in parameters, "free", name, f"one of {', '.join(parameters)}")
        self.options(Config((self.log,)))

    def options(self, config: Config) -> Config:
        """`config` with the options in the data set; raises InvalidValueError for an option that
        both of them state.
        """
        stated: dict[str, Any] = {
            "law": self.law,
            "robot": self.robot,
            "ground": GroundOptions(self.ground),
            "free": self.free or None,
            "folds": self.folds,
        }
        defaults = Config(config.logs)
        for name in stated:
            default = getattr(defaults, name)
            refuse_changed(name, getattr(config, name), default, "with a data set, which states it")
        return replace(config, logs=(self.log,), **stated)

    def checks(self, predictions: Sequence[Prediction]) -> list[Check]:
        """A check for each bound."""
        errors = {
            prediction.model.label: prediction.errors.after_seconds.get(_AHEAD)
            for prediction in predictions
        }
        checks = []
        for bound in self.bounds:
            require(bound.row in errors, "bounds", bound.row, f"one of {', '.join(errors)}")
            what, _, kind = bound.quantity.partition("_")
            # NaN, which no bound allows, where the log has no such errors
            statistics = getattr(errors[bound.row], what, None)
            value = getattr(statistics, kind, float("nan"))
            name = f"{bound.row}, {bound.quantity}"
            checks.append(Check(self.title, name, value, bound.most, _UNITS[what]))
        return checks


def load_data_set(path: Path) -> DataSet:
    """Load a data set; raises SettingsFileError for an unreadable file or invalid fields."""
    table = read_toml(path)

    def beside(value: object) -> object:
        """The path of a file beside the data set; other values, such as names, as they are."""
        if isinstance(value, list):
            return [beside(item) for item in value]
        if not isinstance(value, str):
            return value
        file = path.parent / value
        if file.exists():
            return str(file)
        # a law may be one of several in a file
        name, _, law = value.rpartition(":")
        file = path.parent / name
        return f"{file}:{law}" if name and file.exists() else value

    for name in table.keys() & {"log", "robot", "ground", "law"}:
        table[name] = beside(table[name])
    return build(DataSet, table, str(path))
