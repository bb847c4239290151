"""What a report says about laws identified from whole drives: tables, and facts for the text."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees
from typing import Self

import numpy as np

from experiments.report.formats import MISSING, number, pair, significant
from experiments.report.laws import (
    EXTRA_SYMBOLS,
    EXTRA_TITLES,
    SYMBOLS,
    LawRow,
    digits_for,
    shown,
    unit_of,
    unit_of_extra,
)
from trackslip.identification.drive.comparison import DriveComparison
from trackslip.identification.drive.estimate import DriveFit
from trackslip.identification.drive.prediction import HORIZONS, Errors

NO_SLIP = "no slip compensation"
LAW_HEADER = ("law", "parameter", "value ± std. error", "95 % interval")
EXTRA_HEADER = ("of the best law", "", "value ± std. error", "95 % interval")
HELD = "held"
_AHEAD = tuple(f"{horizon:g} s" for horizon in HORIZONS)
POSITION_HEADER = ("law", *_AHEAD, "score")
HEADING_HEADER = ("law", *_AHEAD)
_TOLD = 2.0  # horizon of the errors in the text [s]
_NOISE = {
    "position": ("position of a pose", 1e3, "mm"),
    "heading": ("heading of a pose", degrees(1.0), "°"),
    "slip_forward": ("slip forwards", 1e3, "mm per √m"),
    "slip_sideways": ("slip sideways", 1e3, "mm per √m"),
    "slip_turn": ("slip in turning", 1e3, "mrad per √m"),
}


@dataclass(frozen=True)
class ExtraRow:
    """A parameter that isn't the law's, as printed."""

    title: str
    symbol: str
    value: str  # with standard error and unit
    interval: str
    held: str  # why it was held; empty if it was fitted


@dataclass(frozen=True)
class PredictionRow:
    """How well a law predicts, as printed."""

    law: str  # its name in files and options
    title: str
    position: Sequence[str]  # rms | median for each horizon [m]
    heading: Sequence[str]  # the same [°]; empty without headings
    score: str  # mean ratio of the errors to the smallest [-]
    best: bool


@dataclass(frozen=True)
class DriveFacts:
    """What the template says about an identification from whole drives."""

    drives: int
    duration: str  # of all of them, with unit
    poses: int
    left_out: int
    breaks: int
    headings: bool  # whether any were measured
    shown: str  # the drive in the figure of the path
    best: str  # title of the best law
    gain: str  # how many times smaller its errors are than without compensation; empty if not known
    laws: Sequence[LawRow]
    extras: Sequence[ExtraRow]
    noise: Sequence[tuple[str, str]]
    horizons: Sequence[str]
    predictions: Sequence[PredictionRow]
    main: bool  # whether the laws of the identification are these, not those of steady stretches

    @classmethod
    def of(cls, found: DriveComparison, main: bool) -> Self:
        """The facts about an identification from drives."""
        best = found.laws[found.best]
        duration = sum(float(drive.time[-1] - drive.time[0]) for drive in found.drives)
        headings = any(drive.has_heading for drive in found.drives)
        return cls(
            drives=len(found.drives),
            duration=f"{duration:.0f} s" if duration < 600 else f"{duration / 60:.0f} min",
            poses=best.poses,
            left_out=best.left_out,
            breaks=best.breaks,
            headings=headings,
            shown=found.drives[longest(found)].name,
            best=title_of(found.best),
            gain=_gain(found),
            laws=law_rows(found),
            extras=extra_rows(best),
            noise=[
                (name, significant(factor * best.noise[key], unit))
                for key, (name, factor, unit) in _NOISE.items()
                if headings or key != "heading"
            ],
            horizons=_AHEAD,
            predictions=prediction_rows(found),
            main=main,
        )


def longest(found: DriveComparison) -> int:
    """Index of the drive that lasts longest."""
    return int(np.argmax([drive.time[-1] - drive.time[0] for drive in found.drives]))


def title_of(name: str) -> str:
    """Name of a law among those compared by prediction."""
    return NO_SLIP if name == "none" else shown(name).title


def law_rows(found: DriveComparison) -> list[LawRow]:
    """The laws with their parameters, the best predictions first."""
    return [
        LawRow(name, title_of(name), shown(name).formula, _parameters(found.laws[name]), best=name == found.best)
        for name in found.ranking
    ]


def extra_rows(law: DriveFit) -> list[ExtraRow]:
    """Sensor, clock and drift under a law."""
    rows = []
    for name, value in law.extras.items():
        printed = _printed(law, name, value, *unit_of_extra(name))
        rows.append(ExtraRow(EXTRA_TITLES[name], EXTRA_SYMBOLS[name], *printed, law.held.get(name, "")))
    return rows


def extra_table(rows: Sequence[ExtraRow]) -> list[tuple[str, ...]]:
    """One line per parameter, under EXTRA_HEADER."""
    return [(row.title, row.symbol, row.value, row.interval) for row in rows]


def held_lines(law: DriveFit) -> list[str]:
    """A line for each parameter that was held, with the reason."""
    symbols = SYMBOLS | EXTRA_SYMBOLS
    return [f"held: {symbols[name]} ({name}), {reason}" for name, reason in law.held.items()]


def prediction_rows(found: DriveComparison) -> list[PredictionRow]:
    """Errors of held-out prediction by law, the best first."""
    rows = []
    headings = any(drive.has_heading for drive in found.drives)
    for name in found.ranking:
        errors = found.errors[name]
        position = [_position(errors.get(horizon)) for horizon in HORIZONS]
        heading = [_heading(errors.get(horizon)) for horizon in HORIZONS] if headings else []
        score = number(found.score[name], 3)
        rows.append(PredictionRow(name, title_of(name), position, heading, score, best=name == found.best))
    return rows


def position_table(rows: Sequence[PredictionRow]) -> list[tuple[str, ...]]:
    """One line per law, under POSITION_HEADER."""
    return [(_terminal_name(row), *row.position, row.score) for row in rows]


def heading_table(rows: Sequence[PredictionRow]) -> list[tuple[str, ...]]:
    """One line per law, under HEADING_HEADER; empty without headings."""
    return [(_terminal_name(row), *row.heading) for row in rows if row.heading]


def _terminal_name(row: PredictionRow) -> str:
    return row.title if row.law == "none" else row.law


def _parameters(law: DriveFit) -> list[tuple[str, ...]]:
    return [
        (SYMBOLS.get(name, name), *_printed(law, name, value, *unit_of(law.name, name)))
        for name, value in law.values.items()
    ]


def _printed(law: DriveFit, name: str, value: float, factor: float, unit: str) -> tuple[str, str]:
    """Value with standard error, and 95 % interval, with as many decimals as show two digits of the error."""
    if name not in law.stderr:
        return f"{factor * value:.4g} {unit}".rstrip().replace("-", "−"), HELD
    error = factor * law.stderr[name]
    digits = digits_for(error)
    interval = " to ".join(number(factor * end, digits) for end in law.interval95[name])
    return f"{number(factor * value, digits)} ± {number(error, digits)} {unit}".rstrip(), interval


def _position(errors: Errors | None) -> str:
    return MISSING if errors is None else pair([number(e, 3) for e in (errors.position_rms, errors.position_median)])


def _heading(errors: Errors | None) -> str:
    if errors is None or errors.heading_rms is None or errors.heading_median is None:
        return MISSING
    return pair([number(degrees(error), 2) for error in (errors.heading_rms, errors.heading_median)])


def _gain(found: DriveComparison) -> str:
    """How much better the best law predicts than no compensation does, in words."""
    ours, theirs = (_errors_told(found.errors, name) for name in (found.best, "none"))
    if ours is None or theirs is None or found.best == "none":
        return ""
    parts = [f"position {theirs.position_rms / ours.position_rms:.2g} times"]
    if ours.heading_rms and theirs.heading_rms:
        parts.append(f"heading {theirs.heading_rms / ours.heading_rms:.2g} times")
    return f"{_TOLD:g} s ahead, it predicts {' and '.join(parts)} better than no slip compensation (rms)"


def _errors_told(errors: Mapping[str, Mapping[float, Errors]], name: str) -> Errors | None:
    return errors.get(name, {}).get(_TOLD)
